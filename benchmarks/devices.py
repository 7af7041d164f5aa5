"""One box on several devices: contact steps a second, what is lost to messages, and what a model says of more devices.

    python benchmarks/devices.py [--quick] [--sizes 20000 200000] [--weak 10000] [--windows 5]

The pile is the column of contact.py, which slides at 2 m/s, so that lists are renewed about as often as in a flowing
heap. Contenders, each in processes of its own, one after the other:

- one: one device, the plain program, on one core; also on two cores;
- machinery: one device with the program of several, on one core: what one device loses by it;
- devices: host devices of one process on all cores;
- processes: two processes joined by `jax.distributed` over loopback, as `jaxdem run --processes 2` starts them, each on
  its share of the cores;
- apart: two processes that know nothing of each other, with half of the grains each and the plain program: what the
  cores give at most.

Processor time counts all threads of all processes, also that of the system, and not what is spent waiting: it tells
more than the clock where other programs run.

Strong scaling: the same grains on more devices. Weak scaling: `--weak` grains a device. The share of messages is the
time that sending the ghosts of a contact step takes by itself, over that of the step. Where cards are at hand the same
contenders run on them, without processes. `--quick` does the smallest size with short windows; about two minutes.

The model: a contact step takes (launch + work N) machinery (1 + waiting) + latency + bytes / bandwidth, with N the
particles and ghosts of the fullest device. Launch and work are fitted to one device, machinery to one with the program
of several, latency and bandwidth to messages between the two processes, and waiting to what then is left of their
steps: cores that they share with the threads that carry messages, and the slower of two in every step. Devices of one
process share its cores and are not modelled, nor is one device on more cores than one. What it says for cards is a
prediction with assumed numbers, which the table names, and with the machinery of this machine.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

from benchmarks import contact, harness
from jaxdem.cli.launch import cores_of, on_cores

# jax is imported by the processes that measure: flags and cores are theirs.

INTERVAL = 100  # contact steps
PARTICLE_STEPS = 1e7  # in a window
QUICK_STEPS = 2e6
MESSAGES = (100, 1000, 10_000)  # rows of the messages that are timed
WIDTH = 8  # numbers of a ghost in them
CARD = {"launch": 37e-6, "work": 1.0e-9, "latency": 20e-6, "bandwidth": 50e9}
"""Assumed of cards: launch of contact.py's program on an H100, work of a grain in 3-D [s], messages between cards of a
host."""
GHOST_LAYERS, GHOST_NUMBERS = 1.3, 12  # layers of grains within reach of a border, and numbers of each in 3-D


# --- inside a process of its own --------------------------------------------------------------------------


def measure(given: dict[str, Any]) -> dict[str, Any]:
    """Windows of contact steps of one contender, in one of its processes."""
    import jax

    if given["devices"] > given["processes"]:
        jax.config.update("jax_num_cpu_devices", given["devices"])
    if given["processes"] > 1 and not given["apart"]:
        from jaxdem.run.peers import join

        join(given["rank"], given["processes"], f"127.0.0.1:{given['port']}", [given["rank"]])
    import jaxdem
    from jaxdem import devices as over
    from jaxdem.devices.mesh import SAME, put

    intervals = max(1, round(given["particle_steps"] / (given["count"] * INTERVAL)))
    own = given["count"] // (given["processes"] if given["apart"] else 1)
    with tempfile.TemporaryDirectory() as folder:
        scene = jaxdem.load_scene(contact.write_sliding_column(Path(folder), own, INTERVAL))
        divided = given["devices"] if given["devices"] > 1 or given["machinery"] else None
        simulation, parameters = jaxdem.build(scene, devices=divided)
        state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    same = parameters if divided is None else put(simulation.mesh, parameters, SAME)

    def compiled() -> Any:
        return jax.jit(lambda p, s, n: simulation.step(p, s, n)[:2]).lower(same, state, neighbors).compile()

    advance, seconds, processor, builds = compiled(), [], [], []
    while len(seconds) < given["windows"] + 1:
        begin, used = time.perf_counter(), time.process_time()
        found = state, neighbors
        for _ in range(intervals):
            found = advance(same, *found)
        jax.block_until_ready(found)
        duration = time.perf_counter() - begin
        if bool(np.any(over.mesh.on_host(found[1].overflow))):
            if divided is None:
                found = simulation.with_room(state, neighbors, neighbors.room.enlarged())
            else:
                found = over.enlarged(simulation, parameters, state, neighbors, found[1])
            state, neighbors = found
            advance = compiled()
            continue
        before = int(np.max(over.mesh.on_host(neighbors.builds)))
        state, neighbors = found
        seconds.append(duration)
        processor.append(time.process_time() - used)
        builds.append(int(np.max(over.mesh.on_host(neighbors.builds))) - before)
    steps = intervals * simulation.steps.contacts_per_interval
    result: dict[str, Any] = {"steps": steps, "seconds": seconds[1:], "builds": builds[1:]}
    result["processor"] = float(np.median(processor[1:])) / steps
    if divided is not None:
        told = over.counts(neighbors)
        room = over.SlabRoom.of(neighbors)
        result |= {
            "particles": told.particles.tolist(),
            "ghosts": told.ghosts.tolist(),
            "migrations": told.migrations,
            "cuts": told.cuts,
            "room_of_ghosts": room.ghosts,
        }
        if given["devices"] > 1:
            result["message_seconds"] = message_time(simulation.mesh, room.ghosts, 500)
            if given["messages"]:
                result["sizes"] = {str(rows): message_time(simulation.mesh, rows, 500) for rows in MESSAGES}
    return result


def message_time(mesh: Any, rows: int, count: int) -> float:
    """Seconds of sending rows of ghosts to both neighbours at once, the least of three times so many."""
    import jax
    import jax.numpy as jnp
    from jax import lax

    from jaxdem.devices.mesh import SLABS, on_slabs, put
    from jaxdem.numerics.blocks import Blocks

    blocks = Blocks(mesh.devices.size, 0, False)

    def send(x: Any) -> Any:
        return lax.fori_loop(0, count, lambda _, y: 0.5 * sum(blocks.from_both(y, y)), x)

    given = put(mesh, np.ones((mesh.devices.size, rows, WIDTH), np.float32), SLABS)
    program = jax.jit(on_slabs(mesh, send, (SLABS,), SLABS))
    jax.block_until_ready(program(given))
    seconds = []
    for _ in range(3):
        begin = time.perf_counter()
        jax.block_until_ready(program(given))
        seconds.append((time.perf_counter() - begin) / count)
    assert jnp.float32 == given.dtype
    return min(seconds)


# --- the contenders ---------------------------------------------------------------------------------------


def run(arguments: argparse.Namespace, count: int, devices: int, **more: Any) -> dict[str, Any]:
    """A contender, in processes of its own."""
    given = {
        "count": count, "devices": devices, "processes": 1, "machinery": False, "messages": False, "cores": devices,
        "apart": False, "windows": arguments.windows, "particle_steps": arguments.particle_steps,
    } | more  # fmt: skip
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        given["port"] = probe.getsockname()[1]
    cores = sorted(os.sched_getaffinity(0))[: given["cores"]]
    children = []
    for rank in range(given["processes"]):
        command = [sys.executable, __file__, "--measure", json.dumps(given | {"rank": rank})]
        with on_cores(cores_of(rank, given["processes"]) if given["processes"] > 1 else cores):
            children.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True))
    said = [child.communicate(timeout=900) for child in children]
    if any(child.returncode for child in children):
        reason = next(err for child, (_, err) in zip(children, said, strict=True) if child.returncode)
        return {"failed": reason.strip().splitlines()[-1][:300]} | given
    each = [json.loads(out.splitlines()[-1]) for out, _ in said]
    result: dict[str, Any] = each[0] | {"processor": sum(one["processor"] for one in each)}
    if given["apart"]:  # the slower one, as if they waited for each other once a window
        result["seconds"] = np.max([one["seconds"] for one in each], axis=0).tolist()
    rate = [count * result["steps"] / seconds for seconds in result["seconds"]]
    step = float(np.median(result["seconds"])) / result["steps"]
    result |= {"million_particle_steps_per_second": harness.spread([value / 1e6 for value in rate]), "step": step}
    if "message_seconds" in result:
        result["share_of_messages"] = result["message_seconds"] / step
    return given | result


def contenders(arguments: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """All of them, by name."""
    cores, found = len(os.sched_getaffinity(0)), {}

    def add(name: str, count: int, devices: int, **more: Any) -> None:
        found[name] = run(arguments, count, devices, **more)
        told = found[name]
        rate = told.get("million_particle_steps_per_second", {}).get("median", math.nan)
        print(f"{name}: {rate:.3g} million particle-steps/s {told.get('failed', '')}", file=sys.stderr, flush=True)

    for size in arguments.sizes:
        add(f"{size}: one", size, 1)
        add(f"{size}: one, all cores", size, 1, cores=cores)
        add(f"{size}: machinery", size, 1, machinery=True)
        add(f"{size}: 2 devices", size, 2, cores=cores)
        add(f"{size}: 2 processes", size, 2, processes=2, messages=True)
        add(f"{size}: 2 apart", size, 1, processes=2, apart=True)
    if not arguments.quick:
        smallest = arguments.sizes[0]
        add(f"{smallest}: 4 devices", smallest, 4, cores=cores)
        for devices in (1, 2, 4):
            count = devices * arguments.weak
            add(f"weak: {devices} x {arguments.weak}", count, devices, cores=min(devices, cores))
    return found


# --- the model --------------------------------------------------------------------------------------------


def fitted(found: dict[str, dict[str, Any]]) -> dict[str, float]:
    """The numbers of the model, each from the rows that show it."""
    rows = {name: row for name, row in found.items() if "step" in row}
    one = [row for name, row in rows.items() if name.endswith(": one")]
    counts, steps = (np.array([row[key] for row in one], float) for key in ("count", "step"))
    # Relative deviations count: a small pile as much as a large one.
    launch, work = np.linalg.lstsq(np.stack((1.0 / steps, counts / steps), axis=1), np.ones(len(one)), rcond=None)[0]
    if len(one) == 1 or launch < 0.0:
        launch, work = 0.0, np.mean(steps / counts)
    model = {"launch": float(launch), "work": float(work), "machinery": 1.0, "waiting": 0.0}
    ratios = [row["step"] / modelled(model, row) for row in rows.values() if row["machinery"]]
    model["machinery"] = float(np.mean(ratios)) if ratios else 1.0
    sizes = next((row["sizes"] for row in rows.values() if "sizes" in row), None)
    if sizes is None:
        return model
    sent, took = [4 * WIDTH * int(number) for number in sizes], list(sizes.values())
    slope = max((took[-1] - took[0]) / (sent[-1] - sent[0]), 1e-15)
    model |= {"latency": took[0], "bandwidth": 1.0 / slope}
    left = []
    for row in rows.values():
        if row["devices"] > 1 and row["processes"] > 1:
            message = model["latency"] + 4 * WIDTH * row["room_of_ghosts"] * slope
            left.append((row["step"] - message) / (modelled(model, row) - message) - 1.0)
    model["waiting"] = max(float(np.mean(left)), 0.0) if left else 0.0
    return model


def modelled(model: dict[str, float], row: dict[str, Any]) -> float:
    """A contact step of a contender by the model [s]; NaN for several devices of one process, and for one that has more
    cores than one."""
    if row["cores"] > row["devices"] or row["apart"]:
        return math.nan
    if row["devices"] == 1:
        alone = model["launch"] + model["work"] * row["count"]
        return alone * (model["machinery"] if row["machinery"] else 1.0)
    if row["processes"] == 1 or "latency" not in model:
        return math.nan
    rows = max(row["particles"]) + max(row["ghosts"])
    computing = (model["launch"] + model["work"] * rows) * model["machinery"] * (1.0 + model["waiting"])
    return computing + model["latency"] + 4 * WIDTH * row["room_of_ghosts"] / model["bandwidth"]


def predicted(model: dict[str, float], count: float, cards: int) -> dict[str, float]:
    """A contact step on cards with so many grains each, by the model with `CARD`; 3-D, slabs as wide as high.

    Cards have no threads that take their cores away: without the waiting of processes, which stands beside it.
    """
    ghosts = GHOST_LAYERS * count ** (2.0 / 3.0)
    alone = CARD["launch"] + CARD["work"] * count
    computing = (CARD["launch"] + CARD["work"] * (count + 2 * ghosts)) * model["machinery"]
    step = computing + CARD["latency"] + 4 * GHOST_NUMBERS * ghosts / CARD["bandwidth"]
    waiting = alone / (step + model["waiting"] * computing)
    named = {"cards": cards, "grains": count, "step": step, "efficiency": alone / step, "with_waiting": waiting}
    return named | {"rate": cards * count / step}


def table(found: dict[str, dict[str, Any]], model: dict[str, float], predictions: list[dict[str, float]]) -> str:
    """Contenders with their gain, the model beside them, and the predictions."""
    heading = (
        "contender", "million particle-steps/s, median (range)", "over one", "ns of processors a particle-step",
        "share of messages",
        "grains of each", "ghosts of each", "moves of the cut planes a build", "by the model",
    )  # fmt: skip
    lines = [heading, ("---",) * len(heading)]
    for name, row in found.items():
        if "failed" in row:
            lines.append((name, row["failed"], *("",) * 7))
            continue
        rate = row["million_particle_steps_per_second"]
        base = found.get(f"{name.split(':')[0]}: one")
        if name.startswith("weak"):
            base = next(value for other, value in found.items() if other.startswith("weak: 1 "))
        gain = rate["median"] / base["million_particle_steps_per_second"]["median"] if base else math.nan
        share = f"{100 * row['share_of_messages']:.0f} %" if "share_of_messages" in row else ""
        spread, ghosts = (
            (" to ".join(map(str, sorted({min(row[key]), max(row[key])}))) if key in row else "")
            for key in ("particles", "ghosts")
        )
        cuts = f"{row['cuts'] / max(sum(row['builds']), 1):.2f}" if "cuts" in row else ""
        step = modelled(model, row)
        by_model = "" if math.isnan(step) else f"{row['count'] / step / 1e6:.3g}"
        values = f"{rate['median']:.3g} ({rate['lowest']:.3g}-{rate['highest']:.3g})"
        used = f"{1e9 * row['processor'] / row['count']:.0f}"
        lines.append((name, values, f"{gain:.2f}", used, share, spread, ghosts, cuts, by_model))
    text = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    numbers = [f"launch {1e6 * model['launch']:.0f} us", f"work {1e9 * model['work']:.0f} ns a grain"]
    numbers += [f"machinery {model['machinery']:.2f}", f"waiting {100 * model['waiting']:.0f} %"]
    if "latency" in model:
        numbers += [f"latency {1e6 * model['latency']:.0f} us", f"bandwidth {model['bandwidth'] / 1e9:.2g} GB/s"]
    off = [abs(modelled(model, row) / row["step"] - 1.0) for row in found.values() if "step" in row]
    text += (
        f"\n\nModel: {', '.join(numbers)}. It is off by {100 * np.nanmax(off):.0f} % at most in the rows that it has.\n"
    )
    text += (
        "\n**Prediction, not measured.** Cards, with these numbers assumed: "
        f"launch {1e6 * CARD['launch']:.0f} us, work {1e9 * CARD['work']:.2g} ns a grain and contact step, "
        f"latency {1e6 * CARD['latency']:.0f} us, bandwidth {CARD['bandwidth'] / 1e9:.0f} GB/s.\n\n"
        "| cards | grains a card | ms a contact step | efficiency | with the waiting of processes here "
        "| billion particle-steps/s |\n| --- | --- | --- | --- | --- | --- |\n"
    )
    for row in predictions:
        text += (
            f"| {row['cards']} | {row['grains']:.0e} | {1e3 * row['step']:.3g} | {100 * row['efficiency']:.0f} % "
            f"| {100 * row['with_waiting']:.0f} % | {row['rate'] / 1e9:.3g} |\n"
        )
    return text.rstrip()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=[20_000, 200_000])
    parser.add_argument("--weak", type=int, default=10_000)
    parser.add_argument("--windows", type=int, default=5)
    parser.add_argument("--particle-steps", type=float, default=None)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--measure", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        result = measure(json.loads(arguments.measure))
        print(json.dumps(result), flush=True)
        return
    if arguments.quick:
        arguments.sizes, arguments.windows = arguments.sizes[:1], min(arguments.windows, 3)
    arguments.particle_steps = arguments.particle_steps or (QUICK_STEPS if arguments.quick else PARTICLE_STEPS)
    found = contenders(arguments)
    model = fitted(found)
    predictions = [predicted(model, count, cards) for cards in (8, 64) for count in (1e6, 1e7)]
    result = {"rows": found, "model": model, "card": CARD, "predictions": predictions, "quick": arguments.quick}
    harness.write("devices", result, table(found, model, predictions))


if __name__ == "__main__":
    main()
