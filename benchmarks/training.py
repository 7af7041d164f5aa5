"""Cost of training the paper's network with the paper's settings, and of training eight of them at once.

    python benchmarks/training.py [--epochs 20] [--rounds 5] [--samples 250000]

The loop is that of `jaxdem train` on synthetic samples: velocities and void fraction in, Koch-Hill drag out, both
normalised. With fewer epochs than the paper's 2000 the time of 2000 is extrapolated; `--epochs 2000` runs all of them.
Below 200 epochs the loop reads every loss, so the next shuffle cannot run at the same time as the device.

Eight at once is `minimize` with eight networks, as an ensemble of eight calls it: mapped in one program on an
accelerator, a thread each on a CPU; mapped is measured on both. `PJRT_NPROC=1` in the environment gives XLA one thread.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

from benchmarks import harness
from benchmarks.drag_cost import DIMENSION, random_inputs
from jaxdem.closures import KochHill, PaperNetwork
from jaxdem.train.fit_loop import Network, Outcome, Plan, Progress, minimize
from jaxdem.train.fit_settings import FitSettings
from jaxdem.train.recipe_paper import PaperLoss

NETWORKS = 8
PAPER_S = 1856.0
"""Seconds of 2000 epochs of Davydzenka & Tahmasebi (2022), J. Fluid Mech. 938, A20."""
TARGETS_S = (900.0, 600.0)
"""Seconds of as many epochs that this project aims at."""

Rows = tuple[jax.Array, jax.Array]


def synthetic_samples(count: int) -> Rows:
    """Normalised inputs (M, 5) and drag forces (M, 2) [-], in the precision and form that `fit_paper` trains on."""
    inputs = random_inputs(count, jnp.float32)
    force = KochHill()(inputs).coefficient[:, None] * inputs.slip_velocity

    def normalised(values: jax.Array) -> jax.Array:
        return (values - jnp.mean(values, axis=0)[None]) / jnp.std(values, axis=0)[None]

    return normalised(PaperNetwork.features(inputs)), normalised(force)


def network(settings: FitSettings, seed: int) -> PaperNetwork:
    """The paper's network with the initial weights of a seed."""
    return PaperNetwork.initial(DIMENSION, hidden=settings.hidden, activation=settings.activation, seed=seed)


def train(
    settings: FitSettings,
    data: Rows,
    seeds: Sequence[int],
    progress: Progress | None = None,
    mapped: bool | None = None,
) -> list[Outcome]:
    """Networks of these seeds, trained at once."""
    plan = Plan(PaperLoss(settings.loss, settings.activation), settings.batch, settings.epochs, settings.schedule)
    networks = [Network(network(settings, seed).weights, data, settings.learning_rate, seed) for seed in seeds]
    return minimize(plan, networks, progress, mapped)


def single_training(settings: FitSettings, data: Rows) -> dict[str, Any]:
    """Trains one network: seconds per epoch, of the start with its compilation, and of it all."""
    reached = [(0, time.perf_counter())]
    (outcome,) = train(settings, data, [settings.seed], lambda epoch, *_: reached.append((epoch, time.perf_counter())))
    epochs, times = np.array([e for e, _ in reached]), np.array([t for _, t in reached])
    # The first report comes after the compilation.
    seconds = np.diff(times)[1:] / np.diff(epochs)[1:]
    return {
        "epochs": settings.epochs,
        "seconds_per_epoch": harness.spread(seconds.tolist()),
        "seconds_until_first_report": float(times[1] - times[0]),
        "seconds": float(times[-1] - times[0]),
        "first_and_last_loss": [outcome.history[0], outcome.history[-1]],
    }


def eight_trainings(settings: FitSettings, data: Rows, rounds: int) -> dict[str, Any]:
    """Seconds that an epoch of `NETWORKS` networks takes, one after the other and at once, in turns."""
    short, seeds = dataclasses.replace(settings, epochs=2), list(range(NETWORKS))
    ways: dict[str, Callable[[], list[Outcome]]] = {
        "one_by_one": lambda: [train(short, data, [seed])[0] for seed in seeds],
        "at_once": lambda: train(short, data, seeds),
        "mapped": lambda: train(short, data, seeds, mapped=True),
    }
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    losses = {}
    for _ in range(rounds + 1):  # the first round compiles
        for name, way in ways.items():
            start = time.perf_counter()
            outcomes = way()
            seconds[name].append((time.perf_counter() - start) / short.epochs)
            losses[name] = [outcome.history[-1] for outcome in outcomes]
    alone = seconds["one_by_one"][1:]
    return {
        "networks": NETWORKS,
        **{name: harness.spread(values[1:]) for name, values in seconds.items()},
        **{
            f"{name}_over_one_by_one": harness.spread(
                [value / one for value, one in zip(seconds[name][1:], alone, strict=True)]
            )
            for name in ("at_once", "mapped")
        },
        "losses": losses,
    }


def table_of(result: dict[str, Any]) -> str:
    """One row a figure, with the paper's and the targets in their own rows."""
    alone, eight, epochs = result["single"], result["eight"], result["paper_epochs"]
    whole = "measured" if result["measured_whole"] else f"extrapolated from {alone['epochs']} epochs"

    def spread(values: dict[str, float]) -> str:
        return f"{values['median']:.3g} ({values['lowest']:.3g}-{values['highest']:.3g})"

    def memory(peak: dict[str, int | None]) -> str:
        own, device = f"process {peak['peak_bytes'] / 1e9:.2f}", peak["device_peak_bytes"]
        return own if device is None else f"{own}, device {device / 1e9:.2f}"

    rows = [
        ("one network, s per epoch", spread(alone["seconds_per_epoch"])),
        ("until the first report, with compilation, s", f"{alone['seconds_until_first_report']:.3g}"),
        (f"{epochs} epochs, {whole}, s", f"{result['seconds_of_all_epochs']:.0f}"),
        (f"{epochs} epochs, Davydzenka & Tahmasebi (2022), s", f"{PAPER_S:.0f}"),
        (f"{epochs} epochs, targets, s", " and ".join(f"{target:.0f}" for target in TARGETS_S)),
        (f"{NETWORKS} networks one after the other, s per epoch", spread(eight["one_by_one"])),
        (f"{NETWORKS} networks at once, s per epoch", spread(eight["at_once"])),
        (f"{NETWORKS} networks mapped in one program, s per epoch", spread(eight["mapped"])),
        ("at once / one after the other", spread(eight["at_once_over_one_by_one"])),
        ("mapped / one after the other", spread(eight["mapped_over_one_by_one"])),
        ("peak memory of one training, GB", memory(result["peak_memory_single"])),
        (f"peak memory with {NETWORKS} at once, GB", memory(result["peak_memory"])),
    ]
    caption = (
        f"{result['settings']['samples']} synthetic samples, batches of {result['settings']['batch']}, "
        f"network {'-'.join(map(str, result['settings']['hidden']))}, Adamax, on {result['device']}; "
        "median (range)."
    )
    return "\n".join([caption, "", "| | |", "| --- | --- |", *(f"| {name} | {value} |" for name, value in rows)])


def main() -> None:
    """One training, then eight, then the table."""
    paper = FitSettings()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--epochs", type=int, default=20, help="epochs of the single network")
    parser.add_argument("--rounds", type=int, default=5, help="epochs of the eight networks")
    parser.add_argument("--samples", type=int, default=paper.samples)
    arguments = parser.parse_args()
    if not 6 <= arguments.epochs <= paper.epochs:
        parser.error(f"--epochs: 6 (the first compiles, the median needs five) to {paper.epochs}")
    settings = dataclasses.replace(paper, epochs=arguments.epochs, samples=arguments.samples)
    data = jax.block_until_ready(synthetic_samples(settings.samples))
    alone = single_training(settings, data)
    peak_single = harness.peak_memory()
    eight = eight_trainings(settings, data, arguments.rounds)
    remaining = max(0, paper.epochs - settings.epochs)
    result = {
        "device": jax.devices()[0].device_kind,
        "settings": dataclasses.asdict(settings),
        "paper_epochs": paper.epochs,
        "single": alone,
        "measured_whole": remaining == 0,
        "seconds_of_all_epochs": alone["seconds"] + remaining * alone["seconds_per_epoch"]["median"],
        "paper_s": PAPER_S,
        "targets_s": TARGETS_S,
        "eight": eight,
        "peak_memory_single": peak_single,
        "peak_memory": harness.peak_memory(),
    }
    harness.write("training", result, table_of(result))


if __name__ == "__main__":
    main()
