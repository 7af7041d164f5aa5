"""Particles that leave through sides of the box and come in through inlets, in arrays of fixed shape.

Every particle that there will be has its row from the start. `ParticleState.active` says which are present: the
others have no neighbours, touch no wall, feel no force and do not move. A row is never used twice, so row i
is particle i in every frame, and what is not present either has been removed or is still to come: those of an inlet
come in their order, and the state counts them.

It all happens at the end of a coupling interval, so that the fluid, the neighbour list and what is written see one
population. Where it has changed the list is rebuilt there, and the springs of the others move along by identity.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.batches import cond_in_batch
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.static import static
from jaxdem.particles.clump_forces import updated
from jaxdem.particles.contact_interval import ContactInterval
from jaxdem.particles.inlet_regions import InletRegion
from jaxdem.particles.integrate import Motion, ParticleState, centres_in_box
from jaxdem.particles.mesh_contact import MeshMemory
from jaxdem.particles.neighbors import Neighbors, carry_history, carry_memory
from jaxdem.particles.surfaces import Surface, surface_contacts

TRIES = 16
"""Places that are tried for a particle in an interval before it has to wait for the next."""

MARGIN = 1e-6
"""Gap that a new particle leaves to others and to walls, over the sum of the radii: more than float32 rounds."""


_Kept = tuple[tuple[Array, ...], tuple[MeshMemory, ...], Neighbors]


@static
class Exit:
    """A side of the box that removes the particles whose centre crosses it; static.

    Attributes:
        axis: that it is normal to.
        upper: whether it is the upper side.
        coordinate: where it stands [m].
    """

    axis: int
    upper: bool
    coordinate: float


@static
class Inlet:
    """A region into which particles are put, one after the other where there is room; static.

    Attributes:
        first: row of its first particle; the others follow.
        due: M, number of the coupling interval at whose end each should come in, in order.
        lower: D, corner of the region, which holds the particles whole [m].
        upper: D, opposite corner [m].
        batch: most that come in at the end of an interval.
        rows: M, of its particles; None where they follow the first.
        region: from which places are drawn; None for the box between the corners.
    """

    first: int
    due: tuple[int, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    batch: int
    rows: tuple[int, ...] | None = None
    region: InletRegion | None = None

    def row(self, number: Array) -> Array:
        """() int32, row of its particle `number` (), the last one beyond the end."""
        number = jnp.minimum(number, len(self.due) - 1)
        return self.first + number if self.rows is None else jnp.asarray(self.rows, jnp.int32)[number]


@static
class Population:
    """How the number of particles changes; static.

    Attributes:
        exits: sides that remove particles.
        inlets: where particles come in.
        box: side lengths [m].
        periodic: whether each axis is periodic.
        seed: of the places where they come in.
        never: number of rows whose particles never come in: an inlet of the run before, which has changed since, had
            no room for them.
    """

    exits: tuple[Exit, ...]
    inlets: tuple[Inlet, ...]
    box: tuple[float, ...]
    periodic: tuple[bool, ...]
    seed: int
    never: int = 0

    def waiting(self, inserted: Array, step: Array) -> Array:
        """() int32, particles that are due after `step` intervals and have not found room."""
        waiting = jnp.zeros((), jnp.int32)
        for k, inlet in enumerate(self.inlets):
            waiting = waiting + due_after(inlet, step) - inserted[k]
        return waiting


class Entry(NamedTuple):
    """What particles that come in are like, and the walls that they must not overlap.

    Attributes:
        radius: () or (N,) of all particles, of clumps that which holds them [m].
        velocity: (D,) of each inlet [m/s].
        present: (W,) bool, which of the walls beside the box there are from now on; None for all.
        placed: where each of them, and then each mesh, is now; empty where all are at rest.
    """

    radius: Array
    velocity: tuple[Array, ...]
    present: Array | None = None
    placed: tuple[Placement | None, ...] = ()


def renewed(
    population: Population,
    contact: ContactInterval,
    entry: Entry,
    particles: ParticleState,
    neighbors: Neighbors,
    step: Array,
) -> tuple[ParticleState, Neighbors]:
    """Particles and list at the end of an interval, after those who leave and those who come.

    Args:
        population: static description.
        contact: walls beside the box, which no particle may overlap when it comes in, and the search of the list.
        entry: how particles come in.
        particles: after the contact steps.
        neighbors: their list.
        step: () int32, number of intervals done with this one.
    """
    before = particles.active
    particles = without_those_outside(population, particles)
    if particles.bonds is not None:
        stays = required(particles.active, "active of the particles")
        particles = particles._replace(bonds=particles.bonds.without(stays))
    for number in range(len(population.inlets)):
        insertion = Insertion(population, number, contact.model.surfaces, entry)
        particles = insertion.with_those_due(particles, step)
    search = contact.search
    if neighbors.lists_nothing or search is None:
        return particles, neighbors
    motion = Motion.of(particles)

    def rebuild(kept: _Kept) -> _Kept:
        springs, memory, neighbors = kept
        new = updated(search, motion, neighbors, particles.active, entry.placed[len(contact.model.surfaces) :])
        return carry_history(springs, neighbors, new), carry_memory(memory, neighbors, new), new

    changed = jnp.any(particles.active != before)
    kept = particles.contact_spring, particles.mesh_memory, neighbors
    springs, memory, neighbors = cond_in_batch(changed, rebuild, kept)
    return particles._replace(contact_spring=springs, mesh_memory=memory), neighbors


def without_those_outside(population: Population, particles: ParticleState) -> ParticleState:
    """Those whose centre is beyond an exit taken out, at rest where they are; their bonds are left as they are."""
    stays = required(particles.active, "active of the particles")
    for side in population.exits:
        along = particles.position[:, side.axis]
        inside = along <= side.coordinate if side.upper else along >= side.coordinate
        stays = stays & inside

    def kept(rows: Array) -> Array:
        return jnp.where(stays[:, None], rows, 0.0)

    fluid_force = particles.fluid_force
    return particles._replace(
        velocity=kept(particles.velocity),
        angular_velocity=kept(particles.angular_velocity),
        contact_force=kept(particles.contact_force),
        wall_spring=tuple(jnp.where(_of_rows(stays, spring)[None], spring, 0.0) for spring in particles.wall_spring),
        fluid_force=None if fluid_force is None else kept(fluid_force),
        fluid_memory=jax.tree.map(kept, particles.fluid_memory),
        active=stays,
    )


def _of_rows(stays: Array, spring: Array) -> Array:
    """(m N,) of the m members of N bodies, from (N,); of spheres m = 1."""
    members = spring.shape[1] // max(stays.shape[0], 1)
    return stays if members == 1 else jnp.tile(stays, members)


@dataclasses.dataclass(frozen=True)
class Insertion:
    """How the particles of one inlet come in.

    Attributes:
        population: static.
        number: of the inlet.
        surfaces: walls beside the box; static.
        entry: what they are like.
    """

    population: Population
    number: int
    surfaces: tuple[Surface, ...]
    entry: Entry

    @property
    def inlet(self) -> Inlet:
        """The inlet."""
        return self.population.inlets[self.number]

    def with_those_due(self, particles: ParticleState, step: Array) -> ParticleState:
        """Those that are due put where there is room, and the others left to wait."""
        before = required(particles.active, "active of the particles")
        inserted = required(particles.inserted, "inserted of the particles")
        due = due_after(self.inlet, step)
        start = lax.stop_gradient(centres_in_box(particles, self.population.box, self.population.periodic))
        position, active, count = cond_in_batch(
            due > inserted[self.number],
            lambda now: self._placed(*now, due, step),
            (start, before, inserted[self.number]),
        )
        new = (active & ~before)[:, None]
        low = particles.position_low
        return particles._replace(
            position=jnp.where(new, position, particles.position),
            position_low=None if low is None else jnp.where(new, 0.0, low),
            velocity=jnp.where(new, self.entry.velocity[self.number][None], particles.velocity),
            active=active,
            inserted=inserted.at[self.number].set(count),
        )

    def _placed(
        self, position: Array, active: Array, inserted: Array, due: Array, step: Array
    ) -> tuple[Array, Array, Array]:
        """Positions, who is present and how many of the inlet have come, after up to `batch` more."""
        inlet, radius = self.inlet, self.entry.radius
        drawn, corners = self.drawn(position, step)

        def one(carry: tuple[Array, Array, Array], u: Array) -> tuple[tuple[Array, Array, Array], None]:
            position, active, count = carry
            row = inlet.row(count)
            own = radius if radius.ndim == 0 else radius[row]
            places, free = self.tried(u, corners, own, (position, active))
            free = free & (count < due)
            chosen = places[jnp.argmax(free)]
            comes = jnp.any(free)
            position = position.at[row].set(jnp.where(comes, chosen, position[row]))
            active = active.at[row].set(active[row] | comes)
            return (position, active, count + comes.astype(count.dtype)), None

        return lax.scan(one, (position, active, inserted), drawn)[0]

    def drawn(self, position: Array, step: Array) -> tuple[Array, tuple[Array, Array]]:
        """(batch, T, D) random numbers of a step from 0 to 1, of the type of the positions; and the inlet's corners."""
        inlet, dtype = self.inlet, position.dtype
        key = jax.random.fold_in(jax.random.fold_in(jax.random.key(self.population.seed), step), self.number)
        drawn = jax.random.uniform(key, (inlet.batch, TRIES, position.shape[1]), dtype)
        return drawn, (jnp.asarray(inlet.lower, dtype), jnp.asarray(inlet.upper, dtype))

    def tried(
        self, u: Array, corners: tuple[Array, Array], own: Array, others: tuple[Array, Array]
    ) -> tuple[Array, Array]:
        """(T, D) places of random numbers for a particle of radius `own`, and (T,) bool, which of them are free.

        Others are positions (N, D) and which of them are present (N,).
        """
        if self.inlet.region is None:
            lower, upper = corners
            places = lower[None] + own + u * (upper - lower - 2.0 * own)[None]
            return places, self.free(places, own, *others)
        places, inside = self.inlet.region.places(u, own)
        return places, inside & self.free(places, own, *others)

    def free(self, places: Array, own: Array, position: Array, active: Array) -> Array:
        """(T,) bool, at which of the places (T, D) a particle of radius `own` () touches nothing."""
        squared = jnp.zeros((places.shape[0], position.shape[0]), position.dtype)
        for axis, (length, wraps) in enumerate(zip(self.population.box, self.population.periodic, strict=True)):
            apart = places[:, axis, None] - position[None, :, axis]
            if wraps:
                apart = apart - length * jnp.round(apart / length)
            squared = squared + apart * apart
        reach = (1.0 + MARGIN) * jnp.broadcast_to(own + self.entry.radius, active.shape)
        free = jnp.all((squared >= reach[None] ** 2) | ~active[None], axis=1)
        if self.surfaces:
            x = vectors.components(places)
            overlap, _ = surface_contacts(self.surfaces, x, (None,) * len(x), own, self.entry.placed)
            clear = overlap <= -MARGIN * own
            free = free & jnp.all(clear if self.entry.present is None else clear | ~self.entry.present[:, None], axis=0)
        return free


def due_after(inlet: Inlet, step: Array) -> Array:
    """() int32, how many should have come in after `step` intervals."""
    return jnp.sum((jnp.asarray(inlet.due, jnp.int32) <= step).astype(jnp.int32))
