"""Injection with parcels: error against processor time, of parcels of 1, 2 and 4 grain diameters on 4, 8 and 16 cm.

    python benchmarks/parcels.py --runs DIR [--only PATTERN ...] [--table] [--pictures FOLDER]

`scenes/injection.toml` with the contacts of the injection study (7 MPa), up to `END`. The reference is the run of
grains on cells of 4 cm; its noise is that of two other packs. Runs are kept in DIR. Those that are complete are not run
again, and those that were stopped go on. --only makes the runs whose names match (`l2_*`); --table makes none. One
process on one core (`taskset -c 0`) measures processor time.

Names of runs: `l2_8cm_sharp_trained_seed_1` are parcels of two diameters on cells of 8 cm with the sharp fluid, the
closure that was trained on parcels of two diameters, and another jitter of the pack.
"""

from __future__ import annotations

import argparse
import dataclasses
import fnmatch
import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from jaxdem import metrics
from jaxdem.io import Run
from jaxdem.run.scene_run import simulate_once
from jaxdem.study import SHARP, fit_to_files
from jaxdem.train.dataset import make_dataset
from jaxdem.train.dataset_file import SEEING
from jaxdem.train.fit_settings import FitSettings

SCENES = Path(__file__).parents[1] / "scenes"
END = 2.5
"""Simulated [s]; runs that go further are taken too, up to here."""
GRAINS, CELLS = 20_000, {4: [300, 50], 8: [150, 25], 16: [75, 12]}
SOFT: dict[str, Any] = {"contact.young_modulus": 7e6, "contact.maximum_overlap": 0.3}
"""Contacts of the injection study."""
DECONVOLVED: dict[str, Any] = SHARP | {"coupling.deconvolution": 0.17}
FLUIDS: dict[str, dict[str, Any]] = {"plain": {}, "sharp": SHARP, "deconvolved": DECONVOLVED}
SEEDS = (0, 1, 2)
TRAINING, TRAINING_GRAINS, TRAINING_END = "training_injection.toml", 15_000, 3.0
FIT = FitSettings.filtered(coarsenings=(1, 2, 4))


@dataclasses.dataclass(frozen=True)
class Case:
    """One kind of run, done with each of some packs.

    Attributes:
        ratio: l, diameters of a grain in one of a parcel.
        mesh: side of the cells [cm].
        fluid: name in `FLUIDS`.
        trained: whether it has the closure that was trained on parcels of this size.
        more: further keys, by the name of what they change.
        seeds: of the packs.
    """

    ratio: int
    mesh: int
    fluid: str = "plain"
    trained: bool = False
    more: str = ""
    seeds: tuple[int, ...] = SEEDS

    @property
    def name(self) -> str:
        """Of the first run."""
        words = [f"l{self.ratio}", f"{self.mesh}cm"]
        words += [self.fluid] * (self.fluid != "plain") + ["trained"] * self.trained + [self.more] * bool(self.more)
        return "_".join(words)

    def folder(self, seed: int) -> str:
        """Of the run with one of the packs."""
        return self.name if seed == 0 else f"{self.name}_seed_{seed}"

    def keys(self, seed: int, runs: Path) -> dict[str, Any]:
        """What it changes of the scene."""
        keys = SOFT | FLUIDS[self.fluid] | MORE.get(self.more, {})
        keys |= {"seed": seed, "time.end": END, "fluid.cells": CELLS[self.mesh]}
        if self.more == "merged":
            keys["start"] = {"from": str(runs / Case(1, 4).folder(seed)), "time": 0.0}
            return keys | {"particles.coarse_grain": float(self.ratio)}
        keys |= parcels(self.ratio, GRAINS)
        if self.trained:
            keys["closure.file"] = str(runs / closure_name(self.ratio, self.fluid))
        return keys


MORE: dict[str, dict[str, Any]] = {
    "kernel_2": {"coupling.kernel_width": {"diameters": 3.0, "cells": 1.0}},
    "kernel_4": {"coupling.kernel_width": {"diameters": 6.0, "cells": 1.0}},
    "narrow_2": {"coupling.kernel_width": {"diameters": 0.75, "cells": 0.5}},
    "narrow_4": {"coupling.kernel_width": {"diameters": 0.375, "cells": 0.5}},
    "tuned": {"coupling.kernel_width": {"diameters": 0.75, "cells": 0.5}, "contact.restitution": 0.9},
    "inelastic": {"contact.restitution": 0.2},
    "elastic": {"contact.restitution": 0.9},
}
"""For the error budget: kernels of grains as wide as those of parcels, and of parcels as narrow as those of grains;
impacts that lose more and less, since parcels collide l times as rarely; of both what made the error smaller."""


SPACING = {1: 1.01, 2: 1.01, 4: 1.0}
"""Of the packs, in diameters: at the scene's 1.01 its polygon holds 1,239 of the 1,250 parcels of l = 4."""


def parcels(ratio: int, grains: int) -> dict[str, Any]:
    """Keys of a scene with parcels in place of its grains."""
    if ratio == 1:
        return {}
    keys = {"particles.coarse_grain": float(ratio), "particles.count": grains // ratio**2}
    return keys | {"particles.pack.spacing": SPACING[ratio]}


def cases() -> Iterator[Case]:
    """All, the cheap ones first where the order is free."""
    yield Case(1, 4)
    for ratio in (4, 2):
        yield Case(ratio, 4)
        for mesh in (8, 16):
            yield Case(ratio, mesh)
            for fluid in ("sharp", "deconvolved"):
                yield Case(ratio, mesh, fluid)
                yield Case(ratio, mesh, fluid, trained=True)
        yield Case(ratio, 4, more="merged", seeds=(0,))
        mesh = 4 * ratio
        for more in (f"narrow_{ratio}", "inelastic", "elastic"):
            yield Case(ratio, mesh, "sharp", more=more, seeds=SEEDS if more == "elastic" else (0,))
    yield Case(2, 8, "sharp", more="tuned")
    yield Case(2, 8, "sharp", trained=True, more="elastic")
    yield Case(1, 16, "sharp")
    yield Case(1, 8, "sharp", seeds=(0,))
    yield Case(1, 4, more="kernel_4", seeds=(0,))
    yield Case(1, 4, more="kernel_2", seeds=(0,))
    yield Case(1, 16, seeds=(0,))
    yield Case(1, 8, seeds=(0,))


def closure_name(ratio: int, fluid: str) -> str:
    """File of the closure trained on parcels of this size through the kernels of this fluid."""
    return f"l{ratio}_{fluid}.closure.h5"


def run_of(scene: jaxdem.Scene, folder: Path) -> Run:
    """The run, with the times of this process over simulated time beside its directory."""
    log, clock = folder.with_name(folder.name + ".clock.json"), []
    before = json.loads(log.read_text()) if log.exists() else []

    def begin() -> Any:
        return lambda now, _: clock.append((now, time.process_time()))

    try:
        return simulate_once(scene, folder, begin)
    finally:
        if clock:
            log.write_text(json.dumps([*before, clock]))


def reaches_the_end(folder: Path) -> bool:
    """Whether there is a run that has come to `END` at least."""
    if not (folder / "history.csv").exists():
        return False
    times = jaxdem.load_run(folder).times
    return len(times) > 0 and float(times[-1]) > END - 1e-9


def processor_time(folder: Path) -> float:
    """Of a run up to `END` without compiling [s]: from the first output of a process, when all is compiled, to its last
    one, times the part of the time that this is. NaN for a run of which less than half was measured."""
    log, simulated, used = folder.with_name(folder.name + ".clock.json"), 0.0, 0.0
    for clock in json.loads(log.read_text()) if log.exists() else []:
        within = [(now, spent) for now, spent in clock if now < END + 1e-9]
        (begin, first), (end, last) = within[min(1, len(within) - 1)], within[-1]
        simulated, used = simulated + end - begin, used + last - first
    return used * END / simulated if simulated > 0.5 * END else float("nan")


def train(ratio: int, fluid: str, runs: Path) -> None:
    """The closure of parcels of one size: run of the training scene on 4 cm, dataset, fit of the recipe `filtered`."""
    out = runs / closure_name(ratio, fluid)
    if out.exists():
        return
    begin = time.process_time()
    keys = SOFT | parcels(ratio, TRAINING_GRAINS) | {"time.end": TRAINING_END, "output.samples": 0.05}
    name = f"training_l{ratio}"
    simulate_once(jaxdem.load_scene(SCENES / TRAINING, keys), runs / name, lambda: lambda *_: None)
    dataset = runs / f"{name}_{fluid}.h5"
    kernel = {key: value for key, value in FLUIDS[fluid].items() if key.startswith(SEEING)}
    if not dataset.exists():
        make_dataset(runs / name, dataset, (1, 2, 4), overrides=kernel)
    fit_to_files("filtered", [dataset], FIT, out, lambda _: None)
    (runs / f"{out.name}.json").write_text(json.dumps(time.process_time() - begin))


def make(runs: Path, patterns: list[str]) -> None:
    """All runs whose names match one of the patterns."""
    for case in cases():
        for seed in case.seeds:
            name = case.folder(seed)
            if patterns and not any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns):
                continue
            if case.trained:
                train(case.ratio, case.fluid, runs)
            begin = time.process_time()
            if reaches_the_end(runs / name):
                continue
            run = run_of(jaxdem.load_scene(SCENES / "injection.toml", case.keys(seed, runs)), runs / name)
            told = "valid" if run.summary["valid"] else run.summary["reason"]
            print(f"{name}: {told}, {time.process_time() - begin:.0f} s, {processor_time(runs / name):.1f}", flush=True)


def history_of(folder: Path) -> dict[str, np.ndarray]:
    """What is compared of a run: its history up to `END`."""
    history = {name: np.asarray(column) for name, column in jaxdem.load_run(folder).history.items()}
    return {name: column[history["time"] < END + 1e-9] for name, column in history.items()}


def rows_of(runs: Path) -> list[dict[str, Any]]:
    """One row a case of which there is a run: nine errors and their mean [-] by pack, processor time by pack [s]."""
    reference, rows = history_of(runs / "l1_4cm"), []
    for case in cases():
        packs = [seed for seed in case.seeds if reaches_the_end(runs / case.folder(seed))]
        packs = [seed for seed in packs if seed or case.name != "l1_4cm"]  # not the reference itself
        if not packs:
            continue
        errors = [metrics.errors(history_of(runs / case.folder(seed)), reference) for seed in packs]
        row = {"name": case.name, "l": case.ratio, "cells_cm": case.mesh, "packs": packs, "errors": errors}
        row["mean_errors"] = [float(np.mean(list(one.values()))) for one in errors]
        row["processor_s"] = [processor_time(runs / case.folder(seed)) for seed in packs]
        if case.trained:
            row["training_s"] = json.loads((runs / f"{closure_name(case.ratio, case.fluid)}.json").read_text())
        if case.more == "merged":
            row["merged"] = jaxdem.load_run(runs / case.name).summary["start"]["merged"]
        rows.append(row)
    return rows


def noise_of(rows: list[dict[str, Any]]) -> float:
    """Mean error of the fine run with other packs [-]; NaN where they were not run."""
    found = [row["mean_errors"] for row in rows if row["name"] == "l1_4cm"]
    return float(np.mean(found)) if found else float("nan")


def table_of(rows: list[dict[str, Any]], reference_s: float) -> str:
    """One line a case; the first is the noise."""
    noise = noise_of(rows)
    names = list(rows[0]["errors"][0])
    heads = ["run", "packs", "time [s]", "times faster", "mean error (range) [%]", "over noise"]
    lines = [f"| {' | '.join([*heads, *(name.replace('_mean', '').replace('_', ' ') for name in names)])} |"]
    lines += ["| --- " * (len(heads) + len(names)) + "|"]
    for row in rows:
        time_s, mean = float(np.nanmedian(row["processor_s"])), float(np.mean(row["mean_errors"]))
        low, high = (100.0 * f(row["mean_errors"]) for f in (min, max))
        spread = f" ({low:.1f}-{high:.1f})" if len(row["packs"]) > 1 else ""
        name = row["name"] + (", noise" if row["name"] == "l1_4cm" else "")
        cells = [name, str(len(row["packs"])), f"{time_s:.1f}", f"{reference_s / time_s:.1f}"]
        cells += [f"{100.0 * mean:.1f}{spread}", f"{mean / noise:.2f}"]
        cells += [f"{100.0 * np.mean([one[name] for one in row['errors']]):.1f}" for name in names]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def draw(rows: list[dict[str, Any]], reference_s: float, path: Path) -> None:
    """Mean error over processor time; bars are the range over the packs."""
    from jaxdem.report import style

    noise = 100.0 * noise_of(rows)
    with style.look():
        figure = style.new_figure(8.0, 4.2)
        axes = figure.subplots()
        axes.axhline(noise, color=style.NOISE, label="noise")
        axes.axhline(1.5 * noise, color=style.NOISE, linestyle="--", label="1.5 times the noise")
        axes.axvline(reference_s / 5.0, color="black", linestyle=":", label="5 times faster than the fine run")
        hidden = (*(name for name in MORE if name != "elastic"), "merged")
        shown = [row for row in rows if not row["name"].endswith(hidden)]
        for row in shown:
            mean = 100.0 * np.array(row["mean_errors"])
            look = "x" if row["name"].endswith("elastic") else {4: "o", 8: "s", 16: "^"}[row["cells_cm"]]
            colour = style.COLOURS[{1: 0, 2: 1, 4: 2}[row["l"]]]
            fluid = next((name for name in ("sharp", "deconvolved") if name in row["name"]), "plain")
            full = {"plain": "none", "sharp": colour, "deconvolved": "black"}[fluid]
            size, middle = 9 if "trained" in row["name"] else 6, mean.mean()
            axes.errorbar(
                np.nanmedian(row["processor_s"]), middle, [[middle - mean.min()], [mean.max() - middle]],
                fmt=look, color=colour, markerfacecolor=full, capsize=3, markersize=size,
            )  # fmt: skip
        for ratio, colour in zip((1, 2, 4), style.COLOURS, strict=False):
            axes.plot([], [], "o", color=colour, label=f"l = {ratio}")
        for mesh, look in ((4, "o"), (8, "s"), (16, "^")):
            axes.plot([], [], look, color="black", markerfacecolor="none", label=f"cells of {mesh} cm")
        axes.plot([], [], "x", color="black", label="restitution 0.9")
        axes.plot([], [], "o", color="black", label="filled: sharp fluid")
        axes.plot([], [], "o", color="black", markersize=9, label="large: trained closure")
        axes.set(xscale="log", ylim=(0.0, None), xlabel=f"processor time of {END:g} s, one core [s]")
        axes.set_xticks([1, 2, 5, 10, 20, 50, 100], ["1", "2", "5", "10", "20", "50", "100"])
        axes.set(ylabel="mean error of nine metrics [%]", xlim=(1.0, 130.0))
        figure.legend(loc="outside right", fontsize=8)
        style.save(figure, path, dpi=110)


def draw_packs(runs: Path, path: Path, at: float = 1.0) -> None:
    """Grains and parcels at a time [s], coloured by their speed."""
    from matplotlib.collections import EllipseCollection
    from PIL import Image

    from jaxdem.report import style

    names = {"l1_4cm": "grains, cells of 4 cm", "l2_8cm_sharp": "l = 2, cells of 8 cm, sharp fluid"}
    names |= {"l4_16cm_sharp": "l = 4, cells of 16 cm, sharp fluid"}
    with style.look():
        figure = style.new_figure(8.0, 6.2)
        for axes, (name, title) in zip(figure.subplots(3, 1, sharex=True), names.items(), strict=True):
            run = jaxdem.load_run(runs / name)
            frame = run.particles(int(np.argmin(np.abs(np.asarray(run.times) - at))))
            size = 2.0 * np.broadcast_to(frame["radius"], len(frame["position"]))
            discs = EllipseCollection(
                size, size, np.zeros(len(size)), units="xy", offsets=frame["position"][:, :2],
                transOffset=axes.transData, array=np.linalg.norm(frame["velocity"], axis=1), cmap="viridis",
            )  # fmt: skip
            discs.set_clim(0.0, 2.0)
            axes.add_collection(discs)
            axes.set(xlim=(0.0, 8.0), ylim=(0.0, 2.0), aspect="equal", ylabel="z [m]")
            axes.set_title(f"{title}, {len(size):,} particles", fontsize=9)
        axes.set_xlabel("x [m]")
        figure.colorbar(discs, ax=figure.axes, label="speed [m/s]", shrink=0.6)
        style.save(figure, path, dpi=100)
    with Image.open(path) as picture:  # 64 colours: a third of the size
        picture.convert("RGB").quantize(64).save(path, optimize=True)


def main() -> None:
    """The runs, then the table and the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=Path, required=True, help="folder in which the runs are kept")
    parser.add_argument("--only", nargs="*", default=[], help="patterns of the names of runs that are made")
    parser.add_argument("--table", action="store_true", help="no run; the table of those that are there")
    parser.add_argument("--pictures", type=Path, help="folder for parcels_error.png and parcels_packs.png")
    arguments = parser.parse_args()
    arguments.runs.mkdir(parents=True, exist_ok=True)
    if not arguments.table:
        make(arguments.runs, arguments.only)
    if arguments.only:
        return
    rows, reference_s = rows_of(arguments.runs), processor_time(arguments.runs / "l1_4cm")
    harness.write("parcels", {"end": END, "reference_s": reference_s, "rows": rows}, table_of(rows, reference_s))
    if arguments.pictures:
        draw(rows, reference_s, arguments.pictures / "parcels_error.png")
        draw_packs(arguments.runs, arguments.pictures / "parcels_packs.png")


if __name__ == "__main__":
    main()
