"""What parcels on a coarse mesh would see of a fine run: its samples with every sixteenth grain as a parcel of 4."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from benchmarks.clusters_measures import DROPPED, uniform_drag, with_error
from benchmarks.clusters_runs import RELAXATION, Case
from jaxdem.errors import required
from jaxdem.fluid.grid import cell_average
from jaxdem.io import Run
from jaxdem.train.dataset import CoarseView, described
from jaxdem.train.dataset_file import write_dataset

OF_GRAINS = ("drag_force", "pressure_gradient_force", "viscous_force")
"""Forces in samples; a parcel has that of all its grains."""


def view_of(case: Case, cell: float, parcel: int) -> CoarseView:
    """The mesh of a run beside the fine run `case`, with its parcels, seen from the fine mesh."""
    return CoarseView(dataclasses.replace(case, parcel=parcel, samples=0).scene(), round(cell / case.cell))


def thinned(sample: dict[str, np.ndarray], parcel: int, draws: int, seed: int) -> list[dict[str, np.ndarray]]:
    """Samples in which each of a random part 1/l^2 of the grains stands for a parcel of l; no grain is in two of them.

    A parcel has the place and the velocity of its grain and l^2 times its force, so that sums over parcels are those
    over the grains in the mean. Places are less even than those of real parcels, which keep each other at a distance.

    Args:
        sample: of a run with grains.
        parcel: l.
        draws: number of samples to make, at most l^2.
        seed: of the choice.
    """
    grains = parcel**2
    order = np.random.default_rng(seed).permutation(len(sample["position"]))
    many = round(len(order) / grains)
    found = []
    for draw in range(draws):
        rows = order[draw * many : (draw + 1) * many]
        own = {name: sample[name][rows] for name in ("position", "particle_velocity", "solid_fraction")}
        found.append(sample | own | {name: grains * sample[name][rows] for name in OF_GRAINS})
    return found


def make_seen(
    case: Case, run: Run, file: Path, cell: float = 24.0, parcel: int = 4, draws: int = 4, dropped: float = DROPPED
) -> None:
    """Writes the dataset of a fine run as parcels on cells of so many diameters would see it.

    Args:
        case: of the run.
        run: with samples.
        file: to write.
        cell: side of the coarse cells, in diameters.
        parcel: l.
        draws: see `thinned`.
        dropped: relaxation times at the start that are left out.
    """
    samples, view = required(run.samples, "samples of the run"), view_of(case, cell, parcel)
    collected = []
    for number in _late(case, samples.times, dropped):
        for sample in thinned(samples.frame(number), parcel, draws, number):
            collected.append(view.rows(sample, float(samples.times[number])))
    write_dataset(file, described(run), {round(cell / case.cell): view.group(collected)})


def filtered_drag(case: Case, run: Run, cell: float = 24.0) -> dict[str, float]:
    """Drag on a grain that a run on a coarse mesh has to apply, over that of the uniform state, as mean and error.

    It is the fluid force of the fine run less the pressure and viscous force that the coarse mesh applies itself. The
    drag of the fine run alone is smaller: within clusters that the coarse mesh does not resolve, the pressure gradient
    carries a part of the weight.
    """
    samples, view = required(run.samples, "samples of the run"), view_of(case, cell, 1)
    series = []
    for number in _late(case, samples.times, DROPPED):
        rows = view.rows(samples.frame(number), float(samples.times[number]))
        fluid = samples.frame(number)
        void = fluid["void_fraction"]
        gas = np.asarray(cell_average(tuple(fluid[f"face_velocity_{axis}"] for axis in range(2)))[1])
        slip = float((void * gas).sum() / void.sum() - fluid["particle_velocity"][:, 1].mean())
        series.append(float(rows["target_force"][:, 1].mean()) / float(uniform_drag(case, slip)))
    return with_error(np.asarray(series), max(6, round((case.times - DROPPED) / 5)))


def _late(case: Case, times: np.ndarray, dropped: float) -> list[int]:
    """Numbers of the samples after the start, one a relaxation time at most."""
    every = max(1, round(1.0 / case.samples))
    return [n for n in range(every - 1, len(times), every) if times[n] > (dropped - 0.5) * RELAXATION]
