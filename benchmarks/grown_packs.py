"""How dense grown packs become, of one size and of many, and how long that takes.

    python benchmarks/grown_packs.py [--spheres 5000] [--discs 1000] [--wide 5000] [--ratios 10 50]

Spheres and discs in periodic boxes that they fill to a given solid fraction: processor time of laying them out, and the
fraction at which none overlaps where the pack was not reached. "uniform" is a distribution by volume that is uniform in
radius; "two sizes" have the share by volume at which small spheres fill the voids of large ones. The estimate for
spheres of many sizes is that of Farr and Groot (`particles/close_packing.py`); beside it stands the limit of Furnas for
two sizes whose ratio has no bound, P + (1 - P) P with P of equal ones.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

from benchmarks import harness
from jaxdem.particles import regions
from jaxdem.particles.close_packing import close_packing
from jaxdem.particles.growth import DISORDERED, grown_pack

EQUAL = {2: (0.80, 0.82, 0.83, 0.839), 3: (0.58, 0.60, 0.62, 0.63)}
"""Solid fractions of equal particles by dimension (of areas in 2-D) [-]."""

WIDE = {2: (0.88, 0.90, 0.92), 3: (0.95, 0.97, 0.99)}
"""Those of many sizes; of spheres over the estimate."""

FEWEST = 10
"""Large particles of a pack of two sizes; with fewer it is left out."""

NAMES = {2: "discs", 3: "spheres"}


def uniform(count: int, ratio: float) -> np.ndarray:
    """(N,) radii from 1 to the ratio, by volume uniform: the number density falls as r^-3."""
    u = (np.random.default_rng(1).permutation(count) + 0.5) / count
    return (1.0 - u * (1.0 - ratio**-2.0)) ** -0.5


def two_sizes(dimension: int, count: int, ratio: float) -> np.ndarray:
    """(N,) radii 1 and `ratio`, in the shares of Furnas."""
    packed = DISORDERED[dimension]
    small = (1.0 - packed) * ratio**dimension  # of each large one
    return np.where(np.arange(count) < max(round(count / (1.0 + small)), 1), ratio, 1.0)


def measured(dimension: int, radius: np.ndarray, fraction: float) -> tuple[float, float]:
    """Solid fraction at which none overlaps, and processor time [s]."""
    side = float(regions.ball_size(dimension) * np.sum(radius**dimension) / fraction) ** (1.0 / dimension)
    region = regions.box([0.0] * dimension, [side] * dimension, [True] * dimension)
    begin = time.process_time()
    _, part = grown_pack(region, radius, 1.0, 1)
    return fraction * part**dimension, time.process_time() - begin


def main() -> None:
    """Runs the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    for name, value in (("--spheres", 5000), ("--discs", 1000), ("--wide", 5000)):
        parser.add_argument(name, type=int, default=value)
    parser.add_argument("--ratios", type=float, nargs="*", default=[10.0, 50.0])
    given = parser.parse_args()
    rows: list[dict[str, Any]] = []
    lines = [
        "| particles | estimate | limit of Furnas | solid fraction asked | reached | processor time [s] |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for dimension, count in ((2, given.discs), (3, given.spheres)):
        name, packed = NAMES[dimension], DISORDERED[dimension]
        packs = [(f"{count} equal {name}", np.ones(count), EQUAL[dimension])] if count else []
        for ratio in given.ratios:
            packs.append((f"{given.wide} {name}, uniform, 1 : {ratio:g}", uniform(given.wide, ratio), WIDE[dimension]))
            radius = two_sizes(dimension, given.wide, ratio)
            if np.sum(radius > 1.0) >= FEWEST:
                packs.append((f"{given.wide} {name}, two sizes, 1 : {ratio:g}", radius, WIDE[dimension]))
        for what, radius, fractions in packs:
            estimate = close_packing(radius) if dimension == 3 else None
            furnas = packed + (1.0 - packed) * packed if "two" in what else None
            for asked in fractions:
                fraction = asked * estimate if estimate is not None and "equal" not in what else asked
                reached, seconds = measured(dimension, radius, fraction)
                rows.append({
                    "particles": what, "estimate": estimate, "furnas": furnas, "asked": fraction, "reached": reached,
                    "seconds": seconds,
                })  # fmt: skip
                limits = " | ".join("" if x is None else f"{x:.3f}" for x in (estimate, furnas))
                lines.append(f"| {what} | {limits} | {fraction:.3f} | {reached:.4f} | {seconds:.1f} |")
                print(lines[-1], file=sys.stderr, flush=True)
                harness.save("grown_packs", {"packs": rows}, "\n".join(lines))
    print("\n".join(lines))


if __name__ == "__main__":
    main()
