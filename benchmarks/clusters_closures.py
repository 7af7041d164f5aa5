"""The closures that `benchmarks/clusters.py` compares, and how they are trained on its fine runs."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.clusters_runs import Case, simulated, terminal_speed
from benchmarks.clusters_seen import make_seen
from jaxdem.closures import DragClosure, InvariantClosure, RadlSundaresan, load_closure, save_closure
from jaxdem.closures.invariant import FEATURES, WIDE
from jaxdem.closures.network import layer_name
from jaxdem.errors import InputError
from jaxdem.train.dataset import make_dataset
from jaxdem.train.dataset_file import Dataset, read_dataset
from jaxdem.train.fit import fit_filtered
from jaxdem.train.fit_settings import FitSettings

COARSENED = (2, 4, 8)
"""Fine cells along a side of the coarse cells that a closure is trained for: 6, 12 and 24 diameters."""
FRACTION = ("solid_fraction", "log_filter_over_diameter")
FITS: dict[str, tuple[tuple[int, ...], tuple[str, ...], int, bool]] = {
    "regression": ((), FEATURES, 1, False),
    "network": ((8,), FEATURES, 1, False),
    "network2": ((8,), FEATURES, 2, False),
    "fraction": ((8,), FRACTION, 2, False),
    "bounded": ((8,), FEATURES, 2, True),
    "gradient": ((8,), (*FRACTION, "void_fraction_gradient_size"), 2, True),
}
"""What is fitted: hidden layers, features, on how many of the training runs, and whether the factor on the drag is at
most one. Without a hidden layer the logarithm of the factor is linear in the features."""
AGAIN = {"gradient_s1": 1, "gradient_s2": 2}
"""Closures that are trained once more, as the part of the name before the line says, and the seeds of the training."""
ANEW = ("regression_anew", "network_anew")
"""Closures that are trained once more, on another fine run at the same solid fraction."""
SEEN_FEATURES = ("solid_fraction", "log_solid_fraction")
SEEN_FITS: dict[str, tuple[str, tuple[str, ...]]] = {
    "balance": ("balance", SEEN_FEATURES),
    "squares": ("mse", SEEN_FEATURES),
    "wide": ("balance", (*SEEN_FEATURES, WIDE)),
}
"""Closures that are fitted to what parcels see: loss and features of the fit."""
NUDGED_FITS: dict[str, tuple[str, tuple[str, ...]]] = {
    "meshes": ("balance", ("solid_fraction", "log_filter_over_diameter", "log_solid_fraction", WIDE)),
}
"""The same for closures of nudged runs on several meshes: `wide` with the size of the cells."""
HELD_OUT = 0.15
"""Part of the time of the first training run, at its end, on which closures are judged and not trained."""


def closure_of(case: Case, folder: Path) -> DragClosure | None:
    """What the case names: "" none, "radl" the model of Radl and Sundaresan for its grain, else NAME.closure.h5."""
    if not case.closure:
        return None
    if case.closure == "radl":
        return RadlSundaresan.of_grain(terminal_speed(case), case.diameter)
    return load_closure(folder / f"{case.closure}.closure.h5")[0]


def train(cases: Sequence[Case], folder: Path, seed: int = 0) -> None:
    """The closures of `FITS`, fitted to samples of fine runs; what is there is not done again."""
    datasets = [_dataset(case, folder) for case in cases]
    for name in FITS:
        _fit(name, name, datasets, folder, seed)


def train_again(cases: Sequence[Case], other: Case, folder: Path) -> None:
    """The closures of `AGAIN`, and those of `ANEW` fitted to the fine run `other`; what is there is not done again."""
    datasets = [_dataset(case, folder) for case in cases]
    for name, seed in AGAIN.items():
        _fit(name, name.split("_")[0], datasets, folder, seed)
    for name in ANEW:
        _fit(name, name.split("_")[0], [_dataset(other, folder)], folder, 0)


def _dataset(case: Case, folder: Path) -> Dataset:
    """One sample a relaxation time of a fine run, on the meshes of `COARSENED`."""
    file = folder / f"{case.folder}.dataset.h5"
    if not file.exists():
        make_dataset(simulated(case, folder).path, file, COARSENED, every=max(1, round(1.0 / case.samples)))
    return read_dataset(file)


def _fit(name: str, fit: str, datasets: Sequence[Dataset], folder: Path, seed: int) -> None:
    """The closure NAME.closure.h5, as `fit` of `FITS`; the end of the first run is held out."""
    path, (hidden, features, number, bounded) = folder / f"{name}.closure.h5", FITS[fit]
    if not path.exists():
        early, late = parted(datasets[0])
        settings = FitSettings.filtered(hidden=hidden, features=features, seed=seed, epochs=40, bounded=bounded)
        found = fit_filtered([early, *datasets[1:number], late], settings)
        save_closure(path, found.closure, found.metadata)


@dataclasses.dataclass(frozen=True)
class Seen:
    """A fine run for training, as parcels of 4 on cells of 24 diameters see it.

    Attributes:
        case: of the run, with samples.
        draws: see `clusters_seen.thinned`.
        dropped: relaxation times at the start that are left out.
    """

    case: Case
    draws: int
    dropped: float


def seen_datasets(runs: Sequence[Seen], folder: Path, scales: Mapping[float, float] | None = None) -> list[Dataset]:
    """What parcels see of fine runs, and the end of the first run, on which a fit is judged.

    It is trained on too: runs of other solid fractions are the test.

    Args:
        runs: fine runs.
        folder: of all runs.
        scales: factor on the forces of the run of a solid fraction, 1 where there is none [-].
    """
    datasets: list[Dataset] = []
    for one in runs:
        file, scale = folder / f"{one.case.folder}.seen.h5", (scales or {}).get(one.case.solid_fraction, 1.0)
        if not file.exists():
            make_seen(one.case, simulated(one.case, folder), file, draws=one.draws, dropped=one.dropped)
        dataset = read_dataset(file)
        datasets.append(with_forces(dataset, dict.fromkeys(dataset.groups, scale)))
    return [*datasets, parted(datasets[0])[1]]


def with_forces(dataset: Dataset, scales: Mapping[int, float]) -> Dataset:
    """The dataset with the target forces of each coarsening times a factor [-]."""
    groups = {
        n: dataclasses.replace(group, target_force=scales[n] * group.target_force)
        for n, group in dataset.groups.items()
    }
    return dataclasses.replace(dataset, groups=groups)


def fit_seen(name: str, fit: str, datasets: Sequence[Dataset], folder: Path, seed: int = 0) -> DragClosure:
    """The closure NAME.closure.h5, fitted as `fit` of `SEEN_FITS` or `NUDGED_FITS`, once."""
    path, (loss, features) = folder / f"{name}.closure.h5", (SEEN_FITS | NUDGED_FITS)[fit]
    if not path.exists():
        settings = FitSettings.filtered(
            features=features, loss=loss, bounded=True, seed=seed, epochs=300, batch=4000, learning_rate=2e-2
        )
        found = fit_filtered(datasets, settings)
        save_closure(path, found.closure, found.metadata)
    return load_closure(path)[0]


def train_seen(runs: Sequence[Seen], folder: Path, seed: int = 0) -> None:
    """The closures of `SEEN_FITS`, fitted to all samples of fine runs."""
    datasets = seen_datasets(runs, folder)
    for name in SEEN_FITS:
        fit_seen(name, name, datasets, folder, seed)


def parted(dataset: Dataset) -> tuple[Dataset, Dataset]:
    """The samples of a run before and in the last part `HELD_OUT` of its time, as datasets of two runs."""
    end = (1.0 - HELD_OUT) * max(float(group.time.max()) for group in dataset.groups.values())
    early = {n: group.select(group.time <= end) for n, group in dataset.groups.items()}
    late = {n: group.select(group.time > end) for n, group in dataset.groups.items()}
    return (
        dataclasses.replace(dataset, groups=early),
        dataclasses.replace(dataset, groups=late, run=f"{dataset.run} (end)"),
    )


def scaled(closure: DragClosure, strength: float) -> InvariantClosure:
    """The closure with the logarithm of its factor times `strength`, as far as that is not bounded."""
    if not isinstance(closure, InvariantClosure):
        raise InputError("closure", type(closure).__name__, "has no last layer to scale", "Give an InvariantClosure.")
    last = layer_name(len(closure.hidden))
    layer = {name: strength * values for name, values in closure.weights[last].items()}
    return dataclasses.replace(closure, weights=closure.weights | {last: layer})


def tuned(cases: Sequence[Case], slips: Sequence[float], folder: Path, steps: int = 3) -> Path:
    """The network with the strength that gives coarse runs the slip of the fine ones: a search by statistics alone.

    With e(k) the mean over the cases of ln(slip / fine slip) at the strength k of `scaled`, k goes from 0 (no model)
    and 1 (the network as it is) by the secant rule. The one with the smallest |e| becomes NAME.closure.h5, with the
    NAME of `tuned_name` for the first case.

    Args:
        cases: coarse runs without closure.
        slips: mean slip of the fine run of each, in terminal speeds.
        folder: of all runs.
        steps: further strengths after 0 and 1.
    """
    from benchmarks.clusters_measures import measured

    name = tuned_name(cases[0])
    path, network = folder / f"{name}.closure.h5", folder / "network.closure.h5"
    if path.exists():
        return path
    closure, metadata = load_closure(network)
    tried: dict[float, float] = {}
    for step in range(2 + steps):
        strength = float(step) if step < 2 else _secant(tried)
        trial = f"{name}_k{strength:.3f}"
        errors = []
        for case, slip in zip(cases, slips, strict=True):
            own = dataclasses.replace(case, closure=trial if strength else "")
            run = simulated(own, folder, scaled(closure, strength) if strength else None)
            errors.append(math.log(measured(own, run)["slip"]["mean"] / slip))
        tried[strength] = float(np.mean(errors))
    best = min(tried, key=lambda strength: abs(tried[strength]))
    save_closure(path, scaled(closure, best), {**metadata, "strength": best, "tried": tried})
    return path


def tuned_name(case: Case) -> str:
    """Of the closure that is tuned for runs on this mesh with these parcels."""
    return f"tuned_c{case.cell:g}_l{case.parcel}"


def _secant(tried: dict[float, float]) -> float:
    """The next strength, between 0 and 3, by the two with the smallest errors."""
    (a, e), (b, f) = sorted(tried.items(), key=lambda item: abs(item[1]))[:2]
    return min(3.0, max(0.0, a - e * (b - a) / (f - e))) if f != e else a
