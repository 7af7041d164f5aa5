"""Where the state of a run is: on one device, or in slabs of the box on several; and what differs for the time loop."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import Any, Protocol

import jax
import jax.numpy as jnp
import numpy as np

from jaxdem.devices import (
    DividedSimulation,
    SlabRoom,
    counts,
    distributed,
    enlarged,
    gathered,
    gathered_rows,
    gathered_state,
    on_one_device,
)
from jaxdem.devices.bonds import blank_kept, require_in_reach
from jaxdem.devices.mesh import SAME, on_host, put
from jaxdem.errors import InputError, required
from jaxdem.numerics.blocks import Blocks
from jaxdem.particles.ghosts import Ghosts
from jaxdem.particles.neighbors import Neighbors, Room
from jaxdem.probes.base import Probe
from jaxdem.run.chunk import ChunkProgram, Program, SlabProgram
from jaxdem.run.instant import InSlabs, Instant
from jaxdem.run.probing import Rows, Watch, of_all_slabs
from jaxdem.run.profiled import ProfiledProgram
from jaxdem.run.restart import from_arrays, to_arrays
from jaxdem.setup.builder import Case
from jaxdem.setup.stored import REMEDY, ROWS, SLAB_AXIS, SLAB_COUNT, stored
from jaxdem.state import State

ROOM = "slab_room"
"""Array of such a checkpoint: what the arrays of a slab have room for."""

Arrays = dict[str, np.ndarray]
Timed = Callable[[str], AbstractContextManager[None]]


@dataclasses.dataclass(frozen=True)
class Saved:
    """A state as a checkpoint has it.

    Attributes:
        same: arrays that all processes have alike.
        blocks: arrays (slabs of this process, ...) of which the others have theirs; None on one device.
        attributes: what they are.
    """

    same: Arrays
    blocks: Arrays | None = None
    attributes: Mapping[str, int] = dataclasses.field(default_factory=dict)


class Placement(Protocol):
    """What the time loop asks of where its state is."""

    def require_fit(self, state: State) -> None:
        """Refuses a state of one device that cannot be there, with an `InputError`."""

    def placed(self, state: State, neighbors: Neighbors | None) -> tuple[State, Neighbors | None]:
        """A state of one device, where it is to be."""

    def program(self, state: State, neighbors: Neighbors | None, watch: Watch | None, timed: Timed | None) -> Program:
        """The step for these shapes; fluid and particles apart where `timed` is given."""

    def whole(self, instant: Instant) -> Instant:
        """An instant with arrays of all particles and cells, for the host."""

    def enlarged(self, state: State, neighbors: Neighbors, failed: Neighbors) -> tuple[State, Neighbors | None]:
        """State and list with more room than `failed`, the list after a step that lacked some."""

    def seen(self, state: State, neighbors: Neighbors | None) -> tuple[State, Neighbors | None]:
        """What a probe is given to measure, for its shapes."""

    def selected(self, probe: Probe, rows: Rows) -> Rows:
        """Rows of a probe that `SELECTS`, of the whole box."""

    def saved(self, state: State, neighbors: Neighbors | None, extra: Mapping[str, float]) -> Saved:
        """For a checkpoint."""

    def restored(
        self, template: State, arrays: Arrays, attributes: Mapping[str, Any]
    ) -> tuple[State, Neighbors | None, Arrays]:
        """The inverse of `saved`, also of what was saved elsewhere: on one device, or on another number of them."""

    def figures(self, neighbors: Neighbors | None) -> dict[str, Any]:
        """For the summary."""


@dataclasses.dataclass(frozen=True)
class OneDevice:
    """All on one device; see `Placement`."""

    case: Case

    def require_fit(self, state: State) -> None:
        pass

    def placed(self, state: State, neighbors: Neighbors | None) -> tuple[State, Neighbors | None]:
        return state, neighbors

    def program(self, state: State, neighbors: Neighbors | None, watch: Watch | None, timed: Timed | None) -> Program:
        given = (self.case.simulation, self.case.parameters, state, neighbors)
        return ChunkProgram(*given, watch) if timed is None else ProfiledProgram(*given, timed, watch)

    def whole(self, instant: Instant) -> Instant:
        return instant

    def enlarged(self, state: State, neighbors: Neighbors, failed: Neighbors) -> tuple[State, Neighbors]:
        return self.case.simulation.with_room(state, neighbors, neighbors.room.enlarged())

    def seen(self, state: State, neighbors: Neighbors | None) -> tuple[State, Neighbors | None]:
        return state, neighbors

    def selected(self, probe: Probe, rows: Rows) -> Rows:
        return rows

    def saved(self, state: State, neighbors: Neighbors | None, extra: Mapping[str, float]) -> Saved:
        return Saved(to_arrays(state, neighbors, extra))

    def restored(
        self, template: State, arrays: Arrays, attributes: Mapping[str, Any]
    ) -> tuple[State, Neighbors | None, Arrays]:
        if SLAB_COUNT not in attributes:
            return from_arrays(self.case.simulation, template, arrays, self.case.parameters.meshes)
        before = _divided_before(self.case, attributes)
        whole, contacts = gathered(before, *_stored_slabs(self.case, template, arrays, before.slabs.number))
        if contacts is None:
            return jax.tree.map(jnp.asarray, whole), None, _extra(arrays)
        state, neighbors = on_one_device(before, self.case.parameters, whole, contacts)
        return state, neighbors, _extra(arrays)

    def figures(self, neighbors: Neighbors | None) -> dict[str, Any]:
        return {}


@dataclasses.dataclass(frozen=True)
class Slabs:
    """A slab of the box on each of several devices; see `Placement`.

    Attributes:
        case: that runs, as on one device.
        simulation: the same in slabs.
    """

    case: Case
    simulation: DividedSimulation

    def require_fit(self, state: State) -> None:
        if state.particles is not None:
            bodies = required(self.case.parameters.bodies, "parameters.bodies")
            require_in_reach(self.simulation.search, bodies, state.particles.bonds)

    def placed(self, state: State, neighbors: Neighbors | None) -> tuple[State, Neighbors | None]:
        return distributed(self.simulation, self.case.parameters, state, neighbors)

    def program(self, state: State, neighbors: Neighbors | None, watch: Watch | None, timed: Timed | None) -> Program:
        given = (self.simulation, self.case.parameters, state, neighbors)
        return SlabProgram(*given, watch) if timed is None else ProfiledProgram(*given, timed, watch)

    def whole(self, instant: Instant) -> Instant:
        forces = instant.forces
        if forces is not None and instant.identity is not None:
            forces = gathered_rows(self.simulation, forces, instant.identity)
        slabs = None
        if instant.neighbors is not None:
            slabs = InSlabs(self.simulation, instant.state, instant.neighbors)
        return Instant(instant.time, gathered_state(self.simulation, instant.state), None, forces, slabs=slabs)

    def enlarged(self, state: State, neighbors: Neighbors, failed: Neighbors) -> tuple[State, Neighbors | None]:
        return enlarged(self.simulation, self.case.parameters, state, neighbors, failed)

    def seen(self, state: State, neighbors: Neighbors | None) -> tuple[State, Neighbors | None]:
        apart = (state.particles, state.fluid, state.scalars, neighbors)
        particles, fluid, scalars, lists = jax.eval_shape(lambda tree: jax.tree.map(lambda x: x[0], tree), apart)
        return State(particles, fluid, state.step, scalars), lists

    def selected(self, probe: Probe, rows: Rows) -> Rows:
        values: Any = of_all_slabs(probe, on_host(rows.values))
        return rows._replace(values=values)

    def saved(self, state: State, neighbors: Neighbors | None, extra: Mapping[str, float]) -> Saved:
        same = {f"extra/{name}": np.asarray(value) for name, value in extra.items()}
        same["state.step"] = np.asarray(state.step)
        if neighbors is not None:
            room = SlabRoom.of(neighbors)
            same[ROOM] = np.asarray([room.rows, room.ghosts, room.migrating, *room.listed.numbers])
            neighbors = neighbors.without_surfaces()
        apart: Any = state._replace(step=None)  # type: ignore[arg-type]
        leaves = (*_leaves("state", apart), *_leaves("neighbors", neighbors))
        blocks = {name: _own_slabs(leaf) for name, leaf in leaves}
        slabs = self.simulation.slabs
        attributes = {SLAB_COUNT: slabs.number, SLAB_AXIS: slabs.axis, ROWS: self.simulation.count}
        if jax.process_count() == 1:
            return Saved(same | blocks, None, attributes)
        return Saved(same, blocks, attributes)

    def restored(
        self, template: State, arrays: Arrays, attributes: Mapping[str, Any]
    ) -> tuple[State, Neighbors | None, Arrays]:
        if SLAB_COUNT not in attributes:
            state, neighbors, extra = from_arrays(self.case.simulation, template, arrays, self.case.parameters.meshes)
            return *self.placed(state, neighbors), extra
        before = _divided_before(self.case, attributes)
        given = _stored_slabs(self.case, template, arrays, before.slabs.number)
        anew = given[1] is not None and self._of_before(given[1])
        if before.slabs != self.simulation.slabs or anew:
            found = gathered(before, *given)
            return *distributed(self.simulation, self.case.parameters, *found), _extra(arrays)
        mesh = required(self.simulation.mesh, "mesh")
        apart: Any = given[0]._replace(step=None)  # type: ignore[arg-type]
        state, neighbors = put(mesh, apart)._replace(step=put(mesh, given[0].step, SAME)), given[1]
        if neighbors is not None:
            surfaces = jax.tree.map(lambda x: np.stack([np.asarray(x)] * before.slabs.number), self._surfaces)
            neighbors = neighbors.with_surfaces(surfaces)
        return state, put(mesh, neighbors), _extra(arrays)

    def _of_before(self, neighbors: Neighbors) -> bool:
        """Whether a list is of a version that had one table for all sizes in slabs."""
        return self.simulation.search.levels is not None and neighbors.pairs.owned is None

    @property
    def _surfaces(self) -> Any:
        return self.case.parameters.meshes

    def figures(self, neighbors: Neighbors | None) -> dict[str, Any]:
        slabs = self.simulation.slabs
        told: dict[str, Any] = {"number": slabs.number, "processes": jax.process_count(), "axis": slabs.axis}
        if neighbors is not None:
            found, room = counts(neighbors), SlabRoom.of(neighbors)
            told |= {
                "planes": found.planes.tolist(),
                "particles": found.particles.tolist(),
                "ghosts": found.ghosts.tolist(),
                "imbalance": found.imbalance,
                "migrations": found.migrations,
                "cuts": found.cuts,
                "cuts_per_build": found.cuts / max(found.builds, 1),
                "room": {"rows": room.rows, "ghosts": room.ghosts, "migrating": room.migrating},
            }
        return {"devices": told}


def _leaves(prefix: str, tree: object) -> list[tuple[str, Any]]:
    leaves = jax.tree_util.tree_flatten_with_path(tree)[0]
    return [(prefix + jax.tree_util.keystr(path), leaf) for path, leaf in leaves]


def _own_slabs(leaf: jax.Array) -> np.ndarray:
    """The slabs of this process, in their order; without elements every device has them all."""
    if not leaf.size:
        return np.zeros((len(leaf.addressable_shards), *leaf.shape[1:]), leaf.dtype)
    shards = sorted(leaf.addressable_shards, key=lambda shard: shard.index[0].start or 0)
    return np.concatenate([np.asarray(shard.data) for shard in shards])


def _extra(arrays: Arrays) -> Arrays:
    return {name[len("extra/") :]: value for name, value in arrays.items() if name.startswith("extra/")}


def _divided_before(case: Case, attributes: Mapping[str, Any]) -> DividedSimulation:
    """What `gathered` asks of the simulation in slabs that has written a checkpoint."""
    plain, number, axis = case.simulation, int(attributes[SLAB_COUNT]), int(attributes[SLAB_AXIS])
    own = {field.name: getattr(plain, field.name) for field in dataclasses.fields(plain)}
    blocks = Blocks(number, axis, plain.periodic[axis])
    return DividedSimulation(**own, blocks=blocks, count=int(attributes[ROWS]), whole=case.simulation)


def _stored_slabs(case: Case, template: State, arrays: Arrays, number: int) -> tuple[State, Neighbors | None]:
    """State and list in so many slabs, arrays of the host.

    Raises:
        InputError: an array is missing, or has another number of slabs.
    """
    state: Any = template._replace(step=None)  # type: ignore[arg-type]
    lists: Any = None
    if template.particles is not None:
        room, blank = [int(value) for value in stored(arrays, ROOM)], np.zeros(())
        particles: Any = template.particles
        if particles.bonds is not None:
            bonds = blank_kept(particles.bonds, blank, case.simulation.population is not None)
            particles = particles._replace(bonds=bonds)
        plain, listed = case.simulation, Room.of(room[3:])
        lists = plain.list_shapes(case.parameters, template.particles, listed).without_surfaces()
        parts: Any = {field.name: blank for field in dataclasses.fields(Ghosts) if not field.metadata.get("static")}
        ghosts = Ghosts(**parts, migrating=room[2], members=plain.search.members)
        lists = dataclasses.replace(lists, ghosts=ghosts)
        state = state._replace(particles=particles._replace(active=blank, identity=blank))
        population = case.simulation.population
        if particles.inserted is not None and particles.orientation is not None:
            lying: Any = blank, None if particles.orientation_low is None else blank
            state = state._replace(particles=state.particles._replace(coming=lying))
        if template.scalars is not None and template.scalars.grains is not None and population and population.inlets:
            coming: Any = blank
            state = state._replace(scalars=template.scalars._replace(coming=coming))

    def filled(prefix: str, tree: Any) -> Any:
        leaves, form = jax.tree_util.tree_flatten_with_path(tree)
        found = [stored(arrays, prefix + jax.tree_util.keystr(path)) for path, _ in leaves]
        for (path, _), array in zip(leaves, found, strict=True):
            if array.shape[:1] != (number,):
                there = f"{prefix}{jax.tree_util.keystr(path)}: {list(array.shape)}"
                raise InputError("checkpoint.h5", there, f"it is of a run on {number} devices", REMEDY)
        return jax.tree_util.tree_unflatten(form, found)

    whole: Any = filled("state", state)._replace(step=stored(arrays, "state.step"))
    return whole, filled("neighbors", lists)
