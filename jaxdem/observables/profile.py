"""Means over boxes or slices: solid fraction, velocities, granular temperature, stress, coordination, fluid."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxdem.errors import required
from jaxdem.fluid.grid import cell_average
from jaxdem.numerics import vectors
from jaxdem.numerics.host import namespace
from jaxdem.numerics.products import PRECISION
from jaxdem.observables.boxes import Box, Boxes, Parts
from jaxdem.observables.contacts import Contacts, contacts
from jaxdem.particles.integrate import centres_in_box
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.pairs import sum_over_pairs
from jaxdem.state import Parameters, State
from jaxdem.structure import Structure


class ParticleSums(NamedTuple):
    """Sums over the particles in each of R boxes, every particle with its part w in the box.

    Attributes:
        box: (R,) volume of the box [m3].
        number: (R,) sum of w [-].
        volume: (R,) of w V [m3].
        mass: (R,) of w m [kg].
        momentum: (R, D) of w m v [kg m/s].
        fluctuation: (R, D, D) of w m v' v', v' = v less the mean velocity in the box [J].
        touching: (R,) of w z, z the number of particles that touch it [-].
        contact: (R, D, D) of f l over the contacts, each with the part of its branch l in the box [J].
    """

    box: Array
    number: Array
    volume: Array
    mass: Array
    momentum: Array
    fluctuation: Array
    touching: Array
    contact: Array


class FluidSums(NamedTuple):
    """Sums over the cells in each of R boxes, every cell with the volume V that it has in the box.

    Attributes:
        box: (R,) sum of V [m3].
        volume: (R,) of g V, g the void fraction [m3].
        flow: (R, D) of g u V [m4/s].
        pressure: (R,) of p V [J].
    """

    box: Array
    volume: Array
    flow: Array
    pressure: Array


class ParticleProfile(NamedTuple):
    """Means over the particles in R boxes; NaN for a mean over nothing.

    Attributes:
        number: (R,) particles, with parts of those that are cut [-].
        solid_fraction: (R,) [-].
        velocity: (R, D) weighted by mass [m/s].
        granular_temperature: (R,) <v' . v'> / D weighted by mass, D degrees of freedom: of translation alone [m2/s2].
        coordination: (R,) mean number of other particles that touch a particle. All particles are counted, those
            without contacts too; contacts with walls are not [-].
        stress: (R, D, D) of contacts, positive in compression [Pa].
        streaming_stress: (R, D, D) of the fluctuating motion [Pa].
    """

    number: Array
    solid_fraction: Array
    velocity: Array
    granular_temperature: Array
    coordination: Array
    stress: Array
    streaming_stress: Array


class FluidProfile(NamedTuple):
    """Means over the fluid in R boxes.

    Attributes:
        void_fraction: (R,) [-].
        velocity: (R, D) interstitial, weighted by the fluid's volume [m/s].
        superficial_velocity: (R, D) weighted by the whole volume [m/s].
        pressure: (R,) reduced pressure [Pa].
    """

    void_fraction: Array
    velocity: Array
    superficial_velocity: Array
    pressure: Array


def particle_profile(
    structure: Structure, parameters: Parameters, boxes: Boxes, state: State, neighbors: Neighbors
) -> ParticleProfile:
    """Means over the particles of a state in boxes or slices.

    Stress by Love and Weber: sigma_ab = (1/V) sum_c f_a l_b, over all contacts, those with walls included. f is the
    force on a particle and l the branch to its centre, from the centre of the other particle or from the point of the
    wall; a contact counts in a box with the part of its branch that lies there. So sigma_zz of a column at rest is,
    averaged over the height of a slice, the weight of the particles whose centres lie above, over the area. The
    streaming stress is (1/V) sum_i w_i m_i v'_a v'_b.

    Source: A. E. H. Love, A Treatise on the Mathematical Theory of Elasticity (1927), note B; J. Weber, Bull. Liaison
    Ponts Chauss. 20 (1966) 1-20; I. Goldhirsch, Granul. Matter 12 (2010) 239-252, for the branch within a box.

    Args:
        structure: or a `Simulation`.
        parameters: that go with it.
        boxes: or slices, see `slices`.
        state: with particles.
        neighbors: its list.
    """
    return particle_means(particle_sums(structure, parameters, boxes, state, neighbors))


def fluid_profile(structure: Structure, boxes: Boxes, state: State) -> FluidProfile:
    """Means over the fluid of a state in boxes or slices; of a cell the part that lies in the box.

    Args:
        structure: or a `Simulation`.
        boxes: or slices, see `slices`.
        state: with a fluid.
    """
    return fluid_means(fluid_sums(structure, boxes, state))


def particle_means(sums: ParticleSums) -> ParticleProfile:
    """The means of sums, or of sums that were averaged over time."""
    dimension = sums.momentum.shape[-1]
    trace = namespace(sums.fluctuation).trace(sums.fluctuation, axis1=1, axis2=2)
    return ParticleProfile(
        number=sums.number,
        solid_fraction=sums.volume / sums.box,
        velocity=_ratio(sums.momentum, sums.mass[:, None]),
        granular_temperature=_ratio(trace, dimension * sums.mass),
        coordination=_ratio(sums.touching, sums.number),
        stress=sums.contact / sums.box[:, None, None],
        streaming_stress=sums.fluctuation / sums.box[:, None, None],
    )


def fluid_means(sums: FluidSums) -> FluidProfile:
    """The means of sums, or of sums that were averaged over time."""
    return FluidProfile(
        void_fraction=sums.volume / sums.box,
        velocity=_ratio(sums.flow, sums.volume[:, None]),
        superficial_velocity=sums.flow / sums.box[:, None],
        pressure=sums.pressure / sums.box,
    )


def _ratio(a: Array, b: Array) -> Array:
    xp, there = namespace(a), b != 0
    return xp.where(there, a / xp.where(there, b, 1.0), np.nan)


def particle_sums(
    structure: Structure, parameters: Parameters, boxes: Boxes, state: State, neighbors: Neighbors
) -> ParticleSums:
    """What `particle_profile` is made of; its arguments."""
    particles, bodies = required(state.particles, "particles"), required(parameters.bodies, "parameters.bodies")
    dtype = particles.position.dtype
    centres = centres_in_box(particles, structure.box, structure.periodic)
    found = contacts(structure, parameters, state, neighbors)
    parts = Parts(structure.box, structure.periodic, boxes.cut)
    touching = _touching(found, neighbors, centres)
    dimension = centres.shape[1]
    # The moments f l once, for all boxes.
    lines = [
        ((start, branch), (force[:, :, None] * branch[:, None, :]).reshape(-1, dimension**2))
        for start, branch, force in _lines(found, centres, bodies.radius)
    ]
    mass, volume = (jnp.broadcast_to(quantity, centres.shape[:1]) for quantity in (bodies.mass, bodies.volume))

    def in_box(box: Box) -> ParticleSums:
        part = parts.of_spheres(box, centres, bodies.radius)
        if particles.active is not None:
            part = jnp.where(particles.active, part, 0.0)
        share = part * mass
        momentum = jnp.sum(share[:, None] * particles.velocity, axis=0)
        total = jnp.sum(share)
        mean = momentum / jnp.where(total > 0, total, 1.0)
        own = particles.velocity - mean[None]
        shares = (jnp.matmul(parts.of_branches(box, *line), moment, precision=PRECISION) for line, moment in lines)
        return ParticleSums(
            box=jnp.prod(box.upper - box.lower) * jnp.asarray(boxes.depth, dtype),
            number=jnp.sum(part),
            volume=jnp.sum(part * volume),
            mass=total,
            momentum=momentum,
            fluctuation=jnp.einsum("p,pa,pb->ab", share, own, own, precision=PRECISION),
            touching=jnp.sum(part * touching),
            contact=sum(shares, jnp.zeros(dimension**2, dtype)).reshape(dimension, dimension),
        )

    return lax.map(in_box, Box(jnp.asarray(boxes.lower, dtype), jnp.asarray(boxes.upper, dtype)))


def _touching(found: Contacts, neighbors: Neighbors, centres: Array) -> Array:
    """(N,) number of particles that touch each."""
    if found.between is None:
        return jnp.zeros(centres.shape[:1], centres.dtype)
    touch = (found.between.overlap > 0).astype(centres.dtype)
    return sum_over_pairs(touch, touch, neighbors.pairs)


def _lines(found: Contacts, centres: Array, radius: Array) -> list[tuple[Array, Array, Array]]:
    """Start and branch of every contact [m] and the force at its end [N], (P, D) each."""
    lines = []
    radii = jnp.broadcast_to(radius, centres.shape[:1])
    if found.between is not None:
        length = radii[found.first] + radii[found.second] - found.between.overlap
        branch = length[:, None] * vectors.stack(found.between.normal)
        lines.append((centres[found.second], branch, vectors.stack(found.between.force)))
    if found.walls is not None:
        length = radii[None] - found.walls.overlap
        normal = tuple(jnp.broadcast_to(x, length.shape) for x in found.walls.normal)
        directions, forces = (
            vectors.stack(tuple(x.reshape(-1) for x in vector)) for vector in (normal, found.walls.force)
        )
        ends = jnp.tile(centres, (length.shape[0], 1))
        branch = length.reshape(-1)[:, None] * directions
        lines.append((ends - branch, branch, forces))
    return lines


def fluid_sums(structure: Structure, boxes: Boxes, state: State) -> FluidSums:
    """What `fluid_profile` is made of; its arguments."""
    fluid, grid = required(state.fluid, "fluid"), required(structure.fluid, "fluid").solver.grid
    parts, dtype = Parts(structure.box, structure.periodic, boxes.cut), fluid.pressure.dtype
    void = jnp.ones_like(fluid.pressure) if fluid.void_fraction is None else fluid.void_fraction
    velocity = cell_average(fluid.face_velocity)

    def in_box(box: Box) -> FluidSums:
        volume = parts.of_cells(box, grid) * jnp.asarray(grid.cell_volume, dtype)
        own = volume * void
        flow = jnp.stack([jnp.sum(own * u) for u in velocity])
        return FluidSums(jnp.sum(volume), jnp.sum(own), flow, jnp.sum(volume * fluid.pressure))

    return lax.map(in_box, Box(jnp.asarray(boxes.lower, dtype), jnp.asarray(boxes.upper, dtype)))
