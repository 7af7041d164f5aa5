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
from collections.abc import Iterator
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

WIDE = {
    ("uniform", 2): (0.85, 0.86), ("uniform", 3): (0.85, 0.92),
    ("two sizes", 2): (0.87, 0.89), ("two sizes", 3): (0.85, 0.92),
}  # fmt: skip
"""Those of many sizes by dimension; of spheres over the estimate."""

FEWEST = {"uniform": 3, "two sizes": 10}
"""Particles of more than half of the largest radius; a pack with fewer is left out."""

NAMES = {2: "discs", 3: "spheres"}


def uniform(count: int, ratio: float) -> np.ndarray:
    """(N,) radii from 1 to the ratio, by volume uniform: the number density falls as r^-3."""
    u = (np.random.default_rng(1).permutation(count) + 0.5) / count
    return (1.0 - u * (1.0 - ratio**-2.0)) ** -0.5


def two_sizes(dimension: int, count: int, ratio: float) -> np.ndarray:
    """(N,) radii 1 and `ratio`, in the shares of Furnas."""
    packed = DISORDERED[dimension]
    small = (1.0 - packed) * ratio**dimension  # of each large one
    return np.where(np.arange(count) < round(count / (1.0 + small)), ratio, 1.0)


def measured(dimension: int, radius: np.ndarray, fraction: float) -> tuple[float, float]:
    """Solid fraction at which none overlaps, and processor time [s]."""
    side = float(regions.ball_size(dimension) * np.sum(radius**dimension) / fraction) ** (1.0 / dimension)
    region = regions.box([0.0] * dimension, [side] * dimension, [True] * dimension)
    begin = time.process_time()
    _, part = grown_pack(region, radius, 1.0, 1)
    return fraction * part**dimension, time.process_time() - begin


def packs(dimension: int, count: int, wide: int, ratios: list[float]) -> Iterator[tuple[str, str, np.ndarray]]:
    """Kind, description and radii (N,) of the packs of a dimension."""
    name = NAMES[dimension]
    yield "equal", f"{count} equal {name}", np.ones(count)
    for ratio in ratios:
        for kind, radius in (("uniform", uniform(wide, ratio)), ("two sizes", two_sizes(dimension, wide, ratio))):
            if np.sum(radius > 0.5 * ratio) >= FEWEST[kind]:
                yield kind, f"{wide} {name}, {kind}, 1 : {ratio:g}", radius


def main() -> None:
    """Runs the benchmark; writes results/{grown,wide}_packs.{json,md}."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    for name, value in (("--spheres", 5000), ("--discs", 1000), ("--wide", 5000)):
        parser.add_argument(name, type=int, default=value, help="0: left out")
    parser.add_argument("--ratios", type=float, nargs="*", default=[10.0, 50.0])
    given = parser.parse_args()
    rows: dict[str, list[dict[str, Any]]] = {"grown_packs": [], "wide_packs": []}
    for dimension, count in ((2, given.discs), (3, given.spheres)):
        packed = DISORDERED[dimension]
        for kind, what, radius in packs(dimension, count, given.wide, given.ratios):
            if not len(radius):
                continue
            estimate = close_packing(radius) if dimension == 3 else None
            scale = 1.0 if estimate is None or kind == "equal" else estimate
            for asked in EQUAL[dimension] if kind == "equal" else WIDE[kind, dimension]:
                reached, seconds = measured(dimension, radius, asked * scale)
                file = "grown_packs" if kind == "equal" else "wide_packs"
                rows[file].append({
                    "particles": what, "estimate": estimate, "asked": asked * scale, "reached": reached,
                    "furnas": packed + (1.0 - packed) * packed if kind == "two sizes" else None, "seconds": seconds,
                })  # fmt: skip
                text = table(rows[file])
                harness.save(file, {"packs": rows[file]}, text)
                print(text.splitlines()[-1], flush=True)


def table(rows: list[dict[str, Any]]) -> str:
    """As Markdown."""
    lines = [
        "| particles | estimate | limit of Furnas | solid fraction asked | reached | processor time [s] |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for row in rows:
        limits = " | ".join("" if row[name] is None else f"{row[name]:.3f}" for name in ("estimate", "furnas"))
        lines.append(
            f"| {row['particles']} | {limits} | {row['asked']:.3f} | {row['reached']:.3f} | {row['seconds']:.1f} |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
