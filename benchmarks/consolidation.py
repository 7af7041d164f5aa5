"""Consolidation of packs other than that of the verification case: other solid fractions, seeds, sizes and frictions.

    python benchmarks/consolidation.py --columns 8 --layers 32 --solid-fraction 0.80 0.81
    python benchmarks/consolidation.py --columns 5 --layers 12 --seeds 1 2 3 4
    python benchmarks/consolidation.py --columns 5 --layers 12 --friction 0

See `tests/cases/consolidation.py`. A row for each pack; rows of other packs are kept.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jax

from benchmarks import harness
from tests.cases.consolidation import Pack, errors, measured

COLUMNS = {
    "columns": "columns", "layers": "layers", "solid fraction": "solid_fraction", "friction": "friction",
    "seed": "seed", "modulus [kPa]": "modulus_kpa", "permeability [m2/(Pa s)]": "permeability",
    "M K [m2/s]": "coefficient", "c_v by the decay [m2/s]": "decay",
    "pressure, largest error over the step": "pressure_off",
    "settlement, largest error over that of the end": "settlement_off", "processor [s]": "processor_s",
}  # fmt: skip
"""Of the table: heading and name in a row."""


def row_of(pack: Pack) -> dict[str, Any]:
    """What a pack did: stiffness, permeability, consolidation and its errors, and the processor time."""
    before = time.process_time()
    found = measured(pack)
    pressure, settled = errors(found)
    return pack._asdict() | {
        "modulus_kpa": found.modulus / 1e3,
        "permeability": found.permeability,
        "coefficient": found.coefficient,
        "decay": found.measured,
        "pressure_off": pressure,
        "settlement_off": settled,
        "processor_s": time.process_time() - before,
    }


def table(rows: list[dict[str, Any]]) -> str:
    """One line a pack."""
    lines = [list(COLUMNS), ["---"] * len(COLUMNS)]
    lines += [[f"{row[name]:.3g}" for name in COLUMNS.values()] for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main() -> None:
    """The packs, one after the other; each is saved as it is there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--columns", type=int, default=8, help="mean diameters across, at least 5")
    parser.add_argument("--layers", type=int, default=32, help="mean diameters from floor to piston")
    parser.add_argument(
        "--solid-fraction", type=float, nargs="+", default=[0.8], help="of the section, grown; small packs reach less"
    )
    parser.add_argument("--friction", type=float, default=0.4, help="between the grains")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1], help="of the places of the grains")
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    known = harness.RESULTS / "consolidation.json"
    rows = json.loads(known.read_text())["rows"] if known.exists() else []
    for fraction, seed in itertools.product(given.solid_fraction, given.seeds):
        pack = Pack(given.columns, given.layers, fraction, given.friction, seed)
        row = row_of(pack)
        others = [one for one in rows if any(one[name] != row[name] for name in Pack._fields)]
        rows = sorted([*others, row], key=lambda one: [one[name] for name in Pack._fields])
        print(table([row]).splitlines()[-1], flush=True)
        harness.save("consolidation", {"rows": rows}, table(rows))
    print(table(rows))


if __name__ == "__main__":
    main()
