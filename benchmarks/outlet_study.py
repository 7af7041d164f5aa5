"""What another treatment of outlets changes in the pressures of the injection study: same runs, two versions of jaxdem.

    python benchmarks/outlet_study.py BEFORE AFTER

Each folder holds the study's runs `fine`, `coarse_2`, `coarse_4` and, if there are any, other packs (`fine_seed_1`,
...), to 3.4 s: `jaxdem run scenes/injection.toml` with `--set contact.young_modulus=7e6`,
`--set contact.maximum_overlap=0.3`, `--set time.end=3.4`, `--set fluid.cells=[150,25]` or `[75,12]`, `--set seed=1`.
Prints a table and writes results/outlet_study.json and .md.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

from benchmarks import harness
from jaxdem.io import Run
from studies.measure import errors, mean
from studies.tables import Cell, Table

PRESSURE = "fluid_pressure_mean"
WHAT = {
    "fine_seed_1": "another pack, 4 cm",
    "fine_seed_2": "a third pack, 4 cm",
    "coarse_2": "8 cm",
    "coarse_4": "16 cm",
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    arguments = parser.parse_args()
    both = (arguments.before, arguments.after)
    names = [name for name in WHAT if all((folder / name).is_dir() for folder in both)]
    runs = [{name: Run(folder / name) for name in ("fine", *names)} for folder in both]
    found: dict[str, dict[str, dict[str, float]]] = {"before": {}, "after": {}, "after_against_before": {}}
    rows: list[list[Cell]] = []
    for name in names:
        pair = [errors(version[name], version["fine"]) for version in runs]
        found["before"][name], found["after"][name] = pair
        rows.append([f"{WHAT[name]} against 4 cm", *(100 * e[PRESSURE] for e in pair), *(100 * mean(e) for e in pair)])
    for name in ("fine", *names):
        error = errors(runs[1][name], runs[0][name])
        found["after_against_before"][name] = error
        what = WHAT.get(name, "4 cm")
        rows.append([f"{what}, after against before", None, 100 * error[PRESSURE], None, 100 * mean(error)])
    headings = [
        "run",
        "pressure, before [%]",
        "pressure, after [%]",
        "mean of nine, before [%]",
        "mean of nine, after [%]",
    ]
    table = Table("", headings, rows).markdown().split("\n\n", 1)[1]
    harness.write("outlet_study", found, table)


if __name__ == "__main__":
    main()
