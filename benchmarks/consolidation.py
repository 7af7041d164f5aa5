"""Consolidation of packs other than that of the verification case: other solid fractions, seeds, sizes and frictions.

    python benchmarks/consolidation.py --columns 8 --layers 32 --solid-fraction 0.81
    python benchmarks/consolidation.py --columns 5 --layers 12 --seeds 1 2 3 4
    python benchmarks/consolidation.py --columns 5 --layers 12 --friction 0

See `tests/cases/consolidation.py`. A line of the table for each seed.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jax

from tests.cases.consolidation import Found, Pack, errors, measured

HEAD = (
    "| columns | layers | solid fraction | friction | seed | modulus [kPa] | permeability [m2/(Pa s)] | M K [m2/s] "
    "| c_v by the decay [m2/s] | pressure, largest error over the step | settlement, over that of the end |"
)


def line(pack: Pack, seed: int, found: Found) -> str:
    """A row of the table."""
    pressure, settled = errors(found)
    figures = (
        pack.columns, pack.layers, pack.solid_fraction, pack.friction, seed, f"{found.modulus / 1e3:.4g}",
        f"{found.permeability:.3g}", f"{found.coefficient:.4g}", f"{found.measured:.4g}", f"{pressure:.3f}",
        f"{settled:.3f}",
    )  # fmt: skip
    return f"| {' | '.join(map(str, figures))} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--columns", type=int, default=8, help="mean diameters across, at least 5")
    parser.add_argument("--layers", type=int, default=32, help="mean diameters from floor to piston")
    parser.add_argument(
        "--solid-fraction", type=float, default=0.8, help="of the section, of the grown pack; small packs reach less"
    )
    parser.add_argument("--friction", type=float, default=0.4, help="between the grains")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1], help="of the places of the grains")
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    print(HEAD)
    print("| --- " * HEAD.count(" | ") + "| --- |")
    for seed in given.seeds:
        pack = Pack(given.columns, given.layers, given.solid_fraction, given.friction, seed)
        print(line(pack, seed, measured(pack)), flush=True)


if __name__ == "__main__":
    main()
