"""State, neighbour list and counters as named arrays and back, so that a resumed run is the same bit for bit."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
import tomllib
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxdem.errors import InputError, required
from jaxdem.io import scene_text
from jaxdem.io.checkpoint import read_checkpoint
from jaxdem.io.run_folder import CHECKPOINT, START
from jaxdem.numerics import vectors
from jaxdem.numerics.compensated import Low
from jaxdem.particles.clump_shape import Placed
from jaxdem.particles.integrate import split_low
from jaxdem.particles.list_room import list_room
from jaxdem.particles.mesh_surface import MeshSurface
from jaxdem.particles.neighbors import Neighbors, carry_history, carry_memory
from jaxdem.setup.builder import Case
from jaxdem.setup.start import with_mesh_memory
from jaxdem.setup.start_point import ABOUT, StartPoint, mesh_texts, piston_texts, walls_of
from jaxdem.setup.stored import ROWS, named, restored, stored, stored_room
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters, State
from jaxdem.version import __version__

OTHER_INPUTS = "another closure, of drag or of the subgrid stress, or other particles, than their files hold now"


def to_arrays(state: State, neighbors: Neighbors | None, extra: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Named arrays of everything that a run goes on from.

    Args:
        state: of the simulation.
        neighbors: its list.
        extra: name -> number, counters of the time loop.
    """
    arrays = named("state", state)
    if neighbors is not None:
        arrays |= named("neighbors", neighbors.without_surfaces())
        arrays["room"] = np.asarray(neighbors.room.numbers)
    return arrays | {f"extra/{name}": np.asarray(value) for name, value in extra.items()}


def from_arrays(
    simulation: Simulation,
    template: State,
    arrays: dict[str, np.ndarray],
    surfaces: tuple[MeshSurface, ...] = (),
) -> tuple[State, Neighbors | None, dict[str, np.ndarray]]:
    """The inverse of `to_arrays`.

    Args:
        simulation: of the same scene.
        template: a state of that scene, for the structure.
        arrays: from a checkpoint.
        surfaces: the meshes of the scene, `Parameters.meshes`.

    Raises:
        InputError: an array is missing or has another shape.
    """
    neighbors = None
    if template.particles is not None:
        room = stored_room(arrays)
        particles = template.particles
        blank = jnp.zeros(room.pairs, particles.position.dtype)
        springs = (blank,) * len(particles.contact_spring)
        particles = particles._replace(contact_spring=springs)
        if surfaces:
            particles = with_mesh_memory(particles, required(simulation.contact, "particles"), room)
        template = template._replace(particles=particles)
    state = restored("state", template, arrays)
    if state.particles is not None:
        positions = state.particles.position
        dimension = positions.shape[1]
        reference = tuple(jnp.asarray(stored(arrays, f"neighbors.reference[{k}]")) for k in range(dimension))
        low: tuple[Low, ...] = (None,) * dimension
        if state.particles.position_low is not None:
            low = tuple(jnp.asarray(stored(arrays, f"neighbors.reference_low[{k}]")) for k in range(dimension))
        radius = jnp.asarray(stored(arrays, "neighbors.radius"))
        search = simulation.search if room.rows is not None or room.slots == 0 else simulation.search.without_levels
        fresh = search.allocate(reference, low, radius, room, surfaces=surfaces)
        if state.particles.orientation is not None:
            fresh = dataclasses.replace(fresh, bodies=_placed(arrays))
        neighbors = restored("neighbors", fresh.without_surfaces(), arrays).with_surfaces(surfaces)
        if search != simulation.search:
            state, neighbors = _by_levels(simulation, state, neighbors)
    extra = {name[len("extra/") :]: value for name, value in arrays.items() if name.startswith("extra/")}
    return state, neighbors, extra


def _placed(arrays: dict[str, np.ndarray]) -> Placed:
    """Where the bodies of clumps stood when the list was made, of a checkpoint."""

    def vector(name: str) -> tuple[Any, ...]:
        keys = (f"neighbors.bodies.{name}[{k}]" for k in itertools.count())
        return tuple(jnp.asarray(arrays[key]) for key in itertools.takewhile(lambda key: key in arrays, keys))

    found: dict[str, Any] = {name: vector(name) for name in Placed._fields if name != "there"}
    for name, whole in (("low", "position"), ("orientation_low", "orientation"), ("arm_low", "arm")):
        found[name] = found[name] or (None,) * len(found[whole])
    there = arrays.get("neighbors.bodies.there")
    return Placed(**found, there=None if there is None else jnp.asarray(there))


def _by_levels(simulation: Simulation, state: State, neighbors: Neighbors) -> tuple[State, Neighbors]:
    """The list of a version that had one table for all sizes, made anew; what contacts keep goes along."""
    particles = required(state.particles, "state.particles")
    position = vectors.components(particles.position)
    low = split_low(particles.position_low, len(position))
    room = list_room(simulation.search, position, particles.active, neighbors.radius)
    room = dataclasses.replace(room, mesh=neighbors.room.mesh)
    placed = tuple(mesh.placement for mesh in neighbors.meshes)
    given = (position, low, neighbors.radius, room, particles.active, neighbors.surfaces, placed)
    new = dataclasses.replace(simulation.search.allocate(*given), builds=neighbors.builds)
    springs = jax.jit(carry_history)(particles.contact_spring, neighbors, new)
    memory = jax.jit(carry_memory)(particles.mesh_memory, neighbors, new) if particles.mesh_memory else ()
    return state._replace(particles=particles._replace(contact_spring=springs, mesh_memory=memory)), new


def about(case: Case, time: Fraction) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Arrays and attributes of a checkpoint by which another run can begin from it.

    Args:
        case: that runs.
        time: simulated [s].
    """
    arrays: dict[str, np.ndarray] = {}
    tables = case.scene.tables()
    search = None if case.simulation.contact is None else case.simulation.search
    attributes = {
        "time": str(time),
        "interval": case.simulation.interval,
        "coarse_grain": 1.0 if case.scene.particles is None else case.scene.particles.coarse_grain,
        "clock": json.dumps(None if case.simulation.clock is None else dataclasses.astuple(case.simulation.clock)),
        "tables": json.dumps({name: tables[name] for name in ABOUT if name in tables}),
        "reach": json.dumps([] if search is None else search.limits),
        "walls": json.dumps(walls_of(case.scene, case.simulation)),
    }
    if case.particles is not None:
        given = case.scene, case.particles.meshes
        attributes |= {"pistons": json.dumps(piston_texts(*given)), "meshes": json.dumps(mesh_texts(*given))}
        arrays = {f"rows/{name}": np.asarray(value) for name, value in case.bodies._asdict().items()}
        for k, queue in enumerate(case.particles.queues):
            arrays |= {f"inlet/{k}/rows": queue.rows, f"inlet/{k}/time": queue.time}
    return arrays, attributes


def origin(
    scene_toml: str, parameters: Parameters, content: str = "", start: StartPoint | None = None
) -> dict[str, str]:
    """What a checkpoint belongs to, as attributes of it.

    Args:
        scene_toml: the scene, as it writes itself; in which folders its closures lie does not count, nor when it ends.
        parameters: that go with it; they hold what the scene only names, the weights of a closure and the sizes
            in a file.
        content: fingerprint of the files of the first state, `Scene.content`.
        start: state that the run began from.
    """
    digest = hashlib.sha256(content.encode())
    for name, array in sorted(named("parameters", parameters).items()):
        digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode() + array.tobytes())
    tables = scene_text.without_end(scene_text.without_folders(tomllib.loads(scene_toml)))
    scene = json.dumps(tables, sort_keys=True)
    return {
        "jaxdem": __version__,
        "scene": hashlib.sha256(scene.encode()).hexdigest(),
        "parameters": digest.hexdigest(),
        "start": "" if start is None else start.sha256,
    }


def require_same_origin(attributes: Mapping[str, object], here: Mapping[str, str]) -> None:
    """Refuses a checkpoint that was put into the folder of another run, or whose inputs have changed since.

    Args:
        attributes: of the checkpoint.
        here: `origin` of the run that wants to go on from it.

    Raises:
        InputError: it is of another version or scene, or a file that the scene names has other content now.
    """
    version = attributes.get("jaxdem")
    for name, limit, remedy in (
        ("jaxdem", f"was written by jaxdem {version}, this is {here['jaxdem']}", "Resume with that version"),
        ("scene", "was written by a run of another scene", "Put this run's own checkpoint back"),
        (
            "parameters",
            f"was written with {OTHER_INPUTS}",
            "Put the files that the scene names back as they were",
        ),
        (
            "start",
            "was written by a run that began from another state of start.from, or of none",
            f"Put its {START} back",
        ),
    ):
        if attributes.get(name, "") != here[name]:
            remedy = f"{remedy}, or start the run anew in another folder."
            raise InputError("checkpoint.h5", attributes.get(name), limit, remedy)


def require_same_rows(
    arrays: Mapping[str, np.ndarray], template: State, attributes: Mapping[str, object] | None = None
) -> None:
    """Refuses a checkpoint with another number of particles than the scene has: all frames of a run have as many.

    Of a run on several devices the attribute `ROWS` is the number; its arrays have empty rows.

    Raises:
        InputError: inlets would bring more up to a later end.
    """
    if template.particles is None or "state.particles.position" not in arrays:
        return
    found = (attributes or {}).get(ROWS, len(arrays["state.particles.position"]))
    before, now = int(str(found)), len(template.particles.position)
    if before != now:
        limit = f"the run has {before} particles and inlets bring {now - before} more, for which its files have no room"
        remedy = "give the inlets an end or a total, or go on in a scene that begins from this run: [start] from"
        raise InputError("time.end", None, limit, remedy)


def require_same_parameters(out: str | Path, here: Mapping[str, str]) -> None:
    """Refuses a complete run whose closure, or a file that its scene names, has other content now.

    Nothing is asked of a run of another version, or whose checkpoint is not there any more.

    Args:
        out: its folder.
        here: `origin` of the run that would be taken for done.

    Raises:
        InputError: they differ, or the checkpoint is damaged.
    """
    path = Path(out) / CHECKPOINT
    if not path.is_file():
        return
    attributes = read_checkpoint(path)[1]
    if attributes.get("jaxdem") == here["jaxdem"] and attributes.get("parameters") != here["parameters"]:
        raise InputError(
            "RUN",
            str(out),
            f"is complete, of {OTHER_INPUTS}",
            "Run it anew in another folder, or put the files that the scene names back as they were.",
        )
