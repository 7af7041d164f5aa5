"""Mean and scatter of forces on spheres by their flow, as a closure of neighbours has them."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from jaxdem.closures.neighbor_range import conditions, quartic
from jaxdem.closures.neighbors import NeighborClosure
from jaxdem.train.sphere_moments import Targets, group_moments, predicted, targets_of, with_carried
from jaxdem.train.spheres import RANDOM_SIDE, Floats, SphereGroup, random_group

SMALLEST_SCATTER = 1e-6
"""Floor of the scatter of a force over the mean force, for forces that have none."""
PARTS = (1, 2, 1, 2)
"""Components of force along, force across, torque about and torque across."""


def with_mean(
    closure: NeighborClosure, groups: Sequence[SphereGroup], values: Sequence[tuple[Floats, ...]]
) -> NeighborClosure:
    """The closure whose mean over these arrays is zero at their Re and solid fraction, as near as `mean` can do it.

    Between the solid fractions of the data the mean is that of random arrays, see `between`; between the Reynolds
    numbers it changes by less than a hundredth.
    """
    random = between(groups, closure.half_box)
    groups = [*groups, *random]
    values = [
        *values,
        *(with_carried(closure, group, group_moments(closure.basis, group, closure.wake)) for group in random),
    ]
    bare = dataclasses.replace(closure, mean=jnp.zeros(8, jnp.float32))
    means = [predicted(bare, *one).along.mean(dtype=np.float64) for one in zip(groups, values, strict=True)]
    factors = np.linalg.lstsq(terms_of(groups), np.asarray(means), rcond=None)[0]
    return dataclasses.replace(closure, mean=jnp.asarray(factors, jnp.float32))


def between(groups: Sequence[SphereGroup], reach: float) -> list[SphereGroup]:
    """Random arrays at the solid fractions in the middle between those of the groups, at their Reynolds numbers."""
    fractions = sorted({group.solid_fraction for group in groups})
    middles = [0.5 * (one + other) for one, other in itertools.pairwise(fractions)]
    flows = sorted({group.reynolds for group in groups})
    return [random_group(flow, middle, max(RANDOM_SIDE, 2.0 * reach)) for middle in middles for flow in flows]


def with_scale(closure: NeighborClosure, groups: Sequence[SphereGroup]) -> NeighborClosure:
    """The closure with the scatter of these groups."""
    scatter = [scatter_of(targets_of(group)) for group in groups]
    factors = np.linalg.lstsq(terms_of(groups)[:, :6], np.log(np.maximum(scatter, SMALLEST_SCATTER)), rcond=None)[0]
    return dataclasses.replace(closure, scale=jnp.asarray(factors.T, jnp.float32))


def scatter_of(found: Targets) -> list[float]:
    """Of force along, force across, torque about and torque across."""
    parts = (found.along, found.across, found.torque[:, 0], found.torque[:, 1:])
    return [float(np.std(part)) for part in parts]


def known_of(groups: Sequence[SphereGroup]) -> np.ndarray:
    """(groups, 3) `conditions` of their flows."""
    flows = ([group.reynolds for group in groups], [group.solid_fraction for group in groups])
    return np.asarray(conditions(*(jnp.asarray(flow, jnp.float32) for flow in flows)))


def terms_of(groups: Sequence[SphereGroup]) -> np.ndarray:
    """(groups, 8) `quartic` terms of their flows."""
    return np.asarray(quartic(jnp.asarray(known_of(groups))), np.float64)
