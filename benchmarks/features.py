"""What each option of a scene costs when it is on, and that it costs nothing when it is off.

    python benchmarks/features.py [--count 1500] [--repetitions 7] [--only WORD ...]

One small injection scene, and the same scene with one more option. The cost is the time of a coupled step over that of
the plain scene (both timed in turns, from the same state) and the number of instructions of the compiled program. Where
an option has a value that turns it off, the program with that value is compared with the plain one, text by text.
"""

from __future__ import annotations

import argparse
import json
import re
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import jax

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from jaxdem.closures import SubgridClosure, save_closure
from jaxdem.step import step

SCENE = Path(__file__).parents[1] / "scenes" / "injection_demo.toml"
SUBGRID = Path(tempfile.gettempdir()) / "jaxdem_features.subgrid.h5"
"""An untrained subgrid stress: it costs what a trained one does."""


class Feature(NamedTuple):
    """An option of a scene.

    Attributes:
        name: in the table.
        on: keys that turn it on.
        off: keys that turn it off in so many words, None where leaving it out is the only way.
    """

    name: str
    on: dict[str, Any]
    off: dict[str, Any] | None = None


FEATURES = (
    Feature("no rolling friction", {"contact.rolling_friction": 0.0}),
    Feature("EPSD rolling friction", {"contact.rolling_model": "epsd"}, {"contact.rolling_model": "cdt"}),
    Feature(
        "linear spring-dashpot",
        {
            "contact.law": "linear_spring_dashpot",
            "contact.normal_stiffness": 1e5,
            "contact.tangential_stiffness": 3e4,
        },
        {"contact.law": "hertz_mindlin"},
    ),
    Feature("a plane as wall", {"walls": [{"kind": "plane", "point": [3.9, 0.0], "normal": [-1.0, 0.2]}]}),
    Feature(
        "two species of other size and density",
        {
            "particles.species": [
                {"share": 0.5, "radius": 0.008, "density": 5650.0},
                {"share": 0.5, "radius": 0.01, "density": 2500.0},
            ]
        },
    ),
    Feature("Smagorinsky", {"fluid.smagorinsky": 0.15}, {"fluid.smagorinsky": 0.0}),
    Feature("learned subgrid stress", {"fluid.subgrid": str(SUBGRID)}),
    Feature("model B", {"fluid.model": "B"}, {"fluid.model": "A"}),
    Feature("upwind advection", {"fluid.advection": "upwind"}, {"fluid.advection": "limited"}),
    Feature("central advection of fourth order", {"fluid.advection": "central_4"}),
    Feature("void fraction by centre", {"coupling.void_fraction": "centre"}, {"coupling.void_fraction": "kernel"}),
    Feature("void fraction by diffusion", {"coupling.void_fraction": "diffusion"}),
    Feature("deconvolved velocity", {"coupling.deconvolution": 0.1}, {"coupling.deconvolution": 0.0}),
    Feature("drag by Gidaspow", {"coupling.drag": "gidaspow"}, {"coupling.drag": "koch_hill"}),
    Feature("Saffman-Mei lift", {"coupling.lift": ["saffman_mei"]}, {"coupling.lift": []}),
    Feature("Magnus lift", {"coupling.lift": ["magnus"]}),
    Feature("rotational drag", {"coupling.rotational_drag": True}, {"coupling.rotational_drag": False}),
    Feature("virtual mass", {"coupling.virtual_mass": 0.5}, {"coupling.virtual_mass": 0.0}),
    Feature("Basset force, 20 intervals", {"coupling.basset": 20}, {"coupling.basset": 0}),
    Feature("removal at the outlet", {"boundary.right.particles": "remove"}),
    Feature("float64", {"precision": "float64"}, {"precision": "float32"}),
)


class Program:
    """A scene's coupled step, compiled, with the state that it is timed from."""

    def __init__(self, overrides: dict[str, Any], count: int):
        scene = jaxdem.load_scene(SCENE, {"particles.count": count, **overrides})
        # The only option that is a setting of the whole process.
        with jax.enable_x64(scene.precision == "float64"):
            simulation, parameters = jaxdem.build(scene)
            start = jaxdem.initial_state(scene, simulation, parameters)
            program = jax.jit(lambda p, s, n: step(simulation, p, s, n)[:2]).lower(parameters, *start).compile()
        self.arguments: tuple[Any, ...] = (parameters, *start)
        self.run = program
        # Without the notes on which line of which file an instruction comes from.
        lines = re.sub(r", metadata=\{[^}]*\}", "", program.as_text()).splitlines()
        self.text = "\n".join(line for line in lines if re.match(r"\s*(ROOT )?%|ENTRY|\}", line))

    @property
    def instructions(self) -> int:
        """Number of instructions, those inside fusions included."""
        return len(re.findall(r"^\s+(?:ROOT )?%\S+ = ", self.text, re.MULTILINE))

    def seconds(self) -> float:
        """Processor time of one coupled step: other programs run on the machine."""
        begin = time.process_time()
        jax.block_until_ready(self.run(*self.arguments))
        return time.process_time() - begin


def cost(plain: Program, feature: Feature, count: int, repetitions: int) -> dict[str, Any]:
    """Time and size over the plain scene's; and whether the option, off, leaves the plain program."""
    program = Program(feature.on, count)
    ratios = []
    for _ in range(repetitions + 1):
        ratios.append(program.seconds() / plain.seconds())
    same = None if feature.off is None else Program(feature.off, count).text == plain.text
    return {
        "time": harness.spread(ratios[1:]),  # without the first, which warms up
        "more_instructions": program.instructions - plain.instructions,
        "off_is_plain": same,
    }


def main() -> None:
    """All features, then the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1500)
    parser.add_argument("--repetitions", type=int, default=7)
    parser.add_argument(
        "--only",
        nargs="+",
        default=[""],
        help="run only the features whose name has one of these words; the other rows stay as they are",
    )
    arguments = parser.parse_args()
    save_closure(SUBGRID, SubgridClosure.initial(), {})
    plain = Program({}, arguments.count)
    seconds = statistics.median([plain.seconds() for _ in range(arguments.repetitions)])
    stored, kept = harness.RESULTS / "features.json", {}
    if arguments.only != [""] and stored.exists():
        kept = json.loads(stored.read_text())
    result: dict[str, Any] = {"plain": {"seconds": seconds, "instructions": plain.instructions}}
    for feature in FEATURES:
        if any(word in feature.name for word in arguments.only):
            result[feature.name] = cost(plain, feature, arguments.count, arguments.repetitions)
            print(row(feature.name, result[feature.name]), flush=True)
        elif feature.name in kept:
            result[feature.name] = kept[feature.name]
    lines = [
        f"Plain scene: {arguments.count} particles, {1e3 * seconds:.0f} ms a coupled step, "
        f"{plain.instructions} instructions. Rows are over the plain scene of their own run.",
        "",
        "| option | time over plain, median (range) | instructions over plain | off: the plain program |",
        "| --- | --- | --- | --- |",
    ]
    lines += [row(name, figures) for name, figures in result.items() if name != "plain"]
    harness.write("features", result, "\n".join(lines))


def row(name: str, figures: dict[str, Any]) -> str:
    """Of the table."""
    ratio = figures["time"]
    off = {None: "left out is off", True: "yes, to the letter", False: "NO"}[figures["off_is_plain"]]
    span = f"{ratio['median']:.2f} ({ratio['lowest']:.2f}-{ratio['highest']:.2f})"
    return f"| {name} | {span} | {figures['more_instructions']:+d} | {off} |"


if __name__ == "__main__":
    main()
