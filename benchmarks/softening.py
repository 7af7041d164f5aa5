"""What softer contacts change: error of the nine metrics against run time, from 7 MPa to 70 GPa.

    python benchmarks/softening.py [--end 0.5] [--count 1500] [--seeds 2]

`scenes/injection_demo.toml` up to `--end`, each Young's modulus with its automatic contact step, for packs jittered
from different seeds. Errors are those of `jaxdem.metrics.errors` against the stiffest run of the same seed, averaged
over the seeds. The last row is the noise: the stiffest runs of two seeds against each other.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from jaxdem import metrics
from tests.cases.steps import time_steps

MODULI = (7e6, 7e7, 7e8, 7e9, 7e10)
SCENE = Path(__file__).parents[1] / "scenes" / "injection_demo.toml"


def run(modulus: float, seed: int, arguments: argparse.Namespace) -> dict[str, Any]:
    """History, wall times [s] and contact step of one run."""
    overrides = {
        "seed": seed,
        "contact.young_modulus": modulus,
        "particles.count": arguments.count,
        "time.end": arguments.end,
        "time.output_interval": arguments.end / 20,
        "output.checkpoint_interval": 1e9,
    }
    scene = jaxdem.load_scene(SCENE, overrides)
    with tempfile.TemporaryDirectory() as folder:
        done = jaxdem.simulate(scene, Path(folder) / "run")
        history = {name: column.tolist() for name, column in done.history.items()}
        summary = done.summary
    steps = time_steps(scene)
    return {
        "modulus": modulus,
        "seed": seed,
        "valid": summary["valid"],
        "wall_s": summary["wall_time_s"] - summary["stages_s"]["compile"],
        "contact_step": steps.contact,
        "contact_steps": summary["counts"]["contact_steps"],
        "expected_overlap": steps.expected_overlap,
        "history": history,
    }


def main() -> None:
    """All runs, softest first, then the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--end", type=float, default=0.5)
    parser.add_argument("--count", type=int, default=1500)
    parser.add_argument("--seeds", type=int, default=2)
    arguments = parser.parse_args()
    runs = {}
    for modulus in MODULI:
        for seed in range(arguments.seeds):
            runs[modulus, seed] = run(modulus, seed, arguments)
            print(f"{modulus:.0e} Pa, seed {seed}: {runs[modulus, seed]['wall_s']:.1f} s", flush=True)
    names = [metric.name for metric in metrics.METRICS]
    rows = ["| E [Pa] | contact step [s] | overlap expected [d] | run [s] | " + " | ".join(names) + " |"]
    rows.append("| --- " * (4 + len(names)) + "|")
    result: dict[str, Any] = {"end": arguments.end, "count": arguments.count, "rows": []}
    seeds = range(arguments.seeds)
    for modulus in MODULI:
        errors = [metrics.errors(runs[modulus, seed]["history"], runs[MODULI[-1], seed]["history"]) for seed in seeds]
        mean = {name: sum(error[name] for error in errors) / len(errors) for name in names}
        first = runs[modulus, 0]
        wall = harness.spread([runs[modulus, seed]["wall_s"] for seed in seeds])
        result["rows"].append({"modulus": modulus, "wall_s": wall, "error": mean, "errors": errors})
        rows.append(
            f"| {modulus:.0e} | {first['contact_step']:.2e} | {first['expected_overlap']:.2g} | "
            f"{wall['lowest']:.0f}-{wall['highest']:.0f} | " + " | ".join(f"{mean[name]:.2g}" for name in names) + " |"
        )
    if arguments.seeds > 1:
        floor = metrics.errors(runs[MODULI[-1], 1]["history"], runs[MODULI[-1], 0]["history"])
        result["floor"] = floor
        rows.append("| another seed | | | | " + " | ".join(f"{floor[name]:.2g}" for name in names) + " |")
    result["runs"] = list(runs.values())
    harness.write("softening", result, "\n".join(rows))


if __name__ == "__main__":
    main()
