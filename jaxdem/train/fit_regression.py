"""Plain regressions that stand beside the networks in every report."""

from __future__ import annotations

from functools import partial

import jax
import numpy as np

from jaxdem.closures.base import DragInputs
from jaxdem.closures.invariant import InvariantClosure, PreparedInputs
from jaxdem.closures.network import PaperNetwork
from jaxdem.train.dataset_file import Group
from jaxdem.train.fit_evaluate import Forces, Predictor, float32_inputs, map_rows


@jax.jit
def prepare_rows(closure: InvariantClosure, inputs: DragInputs) -> PreparedInputs:
    """What `InvariantClosure.prepare` gives, compiled once for all closures of one structure."""
    return closure.prepare(inputs)


def fit_regression(closure: InvariantClosure, prepared: PreparedInputs, target: Forces, weight: Forces) -> Predictor:
    """Plain regression beside the network: force = (a_0 + sum_k a_k z_k) base force + sum_t b_t term vector.

    z are the closure's normalised features, a and b the weighted least-squares solution; no gate, no bounds.

    Args:
        closure: gives features, base law and terms; its weights do not enter.
        prepared: of the training rows (M).
        target: (M, D) [N].
        weight: (M,) [1/N2].

    Returns:
        A function from a `Group` to forces (M, D) [N].
    """
    mean, scale = np.asarray(closure.feature_mean), np.asarray(closure.feature_scale)

    def columns(rows: PreparedInputs) -> Forces:
        base_force = np.asarray(rows.coefficient)[:, None] * np.asarray(rows.slip)
        normalised = (np.asarray(rows.features, np.float64) - mean[None]) / scale[None]
        factors = np.concatenate([np.ones((len(normalised), 1)), normalised], axis=1)
        along_slip = factors[:, :, None] * base_force[:, None, :]
        if rows.term_vectors is None:
            return along_slip
        return np.concatenate([along_slip, np.asarray(rows.term_vectors)], axis=1)

    solution = least_squares(columns(prepared), target, weight)
    return lambda group: np.einsum("mkd,k->md", columns(map_rows(partial(prepare_rows, closure), group)), solution)


def paper_features(group: Group) -> Forces:
    """(M, 2 D + 1) what `PaperNetwork` sees, in double precision."""
    return np.asarray(PaperNetwork.features(float32_inputs(group)), np.float64)


def linear_force(inputs: Forces, forces: Forces) -> Predictor:
    """Least-squares linear map from the paper network's inputs to the force, as a function of a group."""
    solution = np.linalg.lstsq(np.pad(inputs, ((0, 0), (0, 1)), constant_values=1.0), forces, rcond=None)[0]
    return lambda group: paper_features(group) @ solution[:-1] + solution[-1][None]


def least_squares(columns: Forces, target: Forces, weight: Forces) -> Forces:
    """(K,) a that minimises sum_i w_i |sum_k a_k columns_ik - target_i|^2.

    Args:
        columns: (M, K, D).
        target: (M, D).
        weight: (M,).
    """
    root = np.sqrt(weight.astype(np.float64))
    matrix = (columns * root[:, None, None]).transpose(0, 2, 1).reshape(-1, columns.shape[1])
    return np.linalg.lstsq(matrix, (target * root[:, None]).reshape(-1), rcond=None)[0]
