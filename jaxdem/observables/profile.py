"""Means over boxes or slices: solid fraction, velocities, granular temperature, stress, coordination, fluid."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.errors import require_kinds, required
from jaxdem.fluid.grid import cell_average
from jaxdem.numerics import vectors
from jaxdem.numerics.blocks import total
from jaxdem.numerics.host import namespace
from jaxdem.numerics.products import PRECISION
from jaxdem.numerics.stages import stage
from jaxdem.numerics.vectors import Vector
from jaxdem.observables.arguments import require_arguments
from jaxdem.observables.boxes import Box, Boxes, Parts, of_boxes
from jaxdem.observables.contacts import Contacts, contacts_of, particles_seen
from jaxdem.observables.lines import Line, contact_lines
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
    """Sums over the cells in each of R boxes, every cell with the open volume V that it has in the box: all of it, or
    what the walls that the fluid sees leave open.

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
        superficial_velocity: (R, D) weighted by the whole open volume [m/s].
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
    require_arguments(structure=structure, parameters=parameters, state=state, neighbors=neighbors)
    _require_boxes(boxes)
    return particle_means(particle_sums(structure, parameters, boxes, state, neighbors))


def fluid_profile(structure: Structure, parameters: Parameters, boxes: Boxes, state: State) -> FluidProfile:
    """Means over the fluid of a state in boxes or slices; of a cell the part that lies in the box, and of this what the
    walls that the fluid sees leave open. NaN where they leave nothing.

    Args:
        structure: or a `Simulation`.
        parameters: that go with it.
        boxes: or slices, see `slices`.
        state: with a fluid.
    """
    require_arguments(structure=structure, parameters=parameters, state=state)
    _require_boxes(boxes)
    return fluid_means(fluid_sums(structure, parameters, boxes, state))


def _require_boxes(boxes: object) -> None:
    require_kinds("give jaxdem.observables.Boxes, such as those of slices", boxes=(boxes, Boxes))


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
        void_fraction=_ratio(sums.volume, sums.box),
        velocity=_ratio(sums.flow, sums.volume[:, None]),
        superficial_velocity=_ratio(sums.flow, sums.box[:, None]),
        pressure=_ratio(sums.pressure, sums.box),
    )


def _ratio(a: Array, b: Array) -> Array:
    xp, there = namespace(a), b != 0
    return xp.where(there, a / xp.where(there, b, 1.0), np.nan)


def particle_sums(
    structure: Structure, parameters: Parameters, boxes: Boxes, state: State, neighbors: Neighbors
) -> ParticleSums:
    """What `particle_profile` is made of; its arguments."""
    particles, bodies = particles_seen(structure, parameters, state, neighbors)
    centres = centres_in_box(particles, structure.box, structure.periodic)
    found = contacts_of(structure, parameters, state, neighbors, particles, bodies)
    parts = Parts(structure.box, structure.periodic, boxes.cut)
    velocity, one = vectors.components(particles.velocity), jnp.ones_like(centres[:, 0])
    mass, volume = bodies.mass * one, bodies.volume * one
    touching = _touching(found, neighbors, one)
    summed = jnp.stack([one, volume, mass, touching, *vectors.scale(mass, velocity)], axis=1)

    def in_box(box: Box) -> ParticleSums:
        part = parts.of_spheres(box, centres, bodies.radius)
        if particles.active is not None:
            part = jnp.where(particles.active, part, 0.0)
        # Products of matrices: of several boxes at once they take a fraction of the time of sums one by one.
        sums = total(structure.cut, jnp.matmul(part, summed, precision=PRECISION))
        momentum = sums[4:]
        mean = momentum / jnp.where(sums[2] > 0, sums[2], 1.0)
        return ParticleSums(
            box=jnp.prod(box.upper - box.lower) * jnp.asarray(boxes.depth, sums.dtype),
            number=sums[0],
            volume=sums[1],
            mass=sums[2],
            momentum=momentum,
            fluctuation=_squares(part * mass, vectors.subtract(velocity, vectors.components(mean[None]))),
            touching=sums[3],
            contact=jnp.zeros((len(velocity), len(velocity)), sums.dtype),
        )

    sums = of_boxes(in_box, boxes, one)
    for line in contact_lines(structure, found, boxes.cut, centres, bodies.radius):
        sums = sums._replace(contact=sums.contact + _in_boxes(parts, boxes, line))
    fluctuation, contact = total(structure.cut, (sums.fluctuation, sums.contact))
    return sums._replace(fluctuation=fluctuation, contact=contact)


def _squares(share: Array, vector: Vector) -> Array:
    """(D, D) sum of w v v."""
    size, one = range(len(vector)), jnp.ones_like(share)
    upper = {
        (a, b): jnp.matmul(share * vector[a] * vector[b], one, precision=PRECISION) for a in size for b in size[a:]
    }
    return jnp.stack([jnp.stack([upper[min(a, b), max(a, b)] for b in size]) for a in size])


def _in_boxes(parts: Parts, boxes: Boxes, line: Line) -> Array:
    """(R, D, D) sum of the moments of contacts, each with the part of its branch in the box."""
    size = len(line.start)

    def in_box(box: Box) -> Array:
        part = parts.of_branches(box, line.start, line.branch)
        return jnp.matmul(line.moment, part, precision=PRECISION).reshape(size, size)

    return stage(line.touches, lambda: of_boxes(in_box, boxes, line.start[0]))


def _touching(found: Contacts, neighbors: Neighbors, one: Array) -> Array:
    """(N,) number of particles that touch each."""
    if found.between is None:
        return jnp.zeros_like(one)
    touch = (found.between.overlap > 0).astype(one.dtype)
    return sum_over_pairs(touch, touch, neighbors.pairs)


def fluid_sums(structure: Structure, parameters: Parameters, boxes: Boxes, state: State) -> FluidSums:
    """What `fluid_profile` is made of; its arguments."""
    fluid, grid = required(state.fluid, "fluid"), required(structure.fluid, "fluid").solver.grid
    parts = Parts(structure.box, structure.periodic, boxes.cut)
    void = jnp.ones_like(fluid.pressure) if fluid.void_fraction is None else fluid.void_fraction
    walls, faces = structure.open_parts(parameters, state), fluid.face_velocity
    of_cells = [jnp.ones_like(void), void, fluid.pressure]
    if walls is not None:
        of_cells, faces = [walls.open_cells * field for field in of_cells], walls.opened(faces)
    fields = jnp.stack([*of_cells, *(void * u for u in cell_average(faces))])
    whole = tuple(k + 1 for k in range(grid.dimension) if k not in boxes.cut)
    fields = jnp.sum(fields, axis=whole, keepdims=True)

    def in_box(box: Box) -> FluidSums:
        sums = parts.sum_over_cells(box, grid, fields)
        return FluidSums(box=sums[0], volume=sums[1], flow=sums[3:], pressure=sums[2])

    return total(grid.blocks, of_boxes(in_box, boxes, fields.reshape(-1)))
