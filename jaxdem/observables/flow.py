"""Flow of particles and of fluid through a plane."""

from __future__ import annotations

import math
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import InputError, require_kinds, required
from jaxdem.fluid.grid import Grid, face_average_along
from jaxdem.fluid.mesh import face_places
from jaxdem.fluid.second_fluid import mixture_density
from jaxdem.numerics import compensated
from jaxdem.numerics.blocks import Blocks, total
from jaxdem.numerics.products import PRECISION
from jaxdem.numerics.static import static
from jaxdem.observables.arguments import require_arguments, require_numbers
from jaxdem.particles.integrate import ParticleState, split_low
from jaxdem.state import Parameters, State
from jaxdem.structure import Structure


@static
class Plane:
    """A plane, or a rectangle of it; static, or traced by its numbers.

    Attributes:
        normal: D numbers, the direction that counts as positive; a unit vector.
        offset: normal . x of its points [m].
        axis: the axis that it is normal to; None for none.
        lower, upper: D - 1 corners of a rectangle in the other axes, None for the whole plane; needs an axis [m].
    """

    normal: tuple[float, ...]
    offset: float
    axis: int | None = None
    lower: tuple[float, ...] | None = None
    upper: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        """Refuses what is no list of numbers, and a normal of another length, where it has numbers."""
        if isinstance(self.normal, str) or not hasattr(self.normal, "__len__"):
            raise InputError("normal", self.normal, "is no list of numbers", "give one for each axis")
        if all(isinstance(part, (int, float)) for part in self.normal) and abs(math.hypot(*self.normal) - 1.0) > 1e-5:
            raise InputError("normal", self.normal, "must be a unit vector", "divide it by its length")

    @classmethod
    def across(
        cls,
        axis: int,
        at: float,
        dimension: int,
        lower: tuple[float, ...] | None = None,
        upper: tuple[float, ...] | None = None,
    ) -> Plane:
        """The plane normal to an axis at a coordinate [m]; the axis's direction is positive.

        Raises:
            InputError: there is no such axis.
        """
        require_numbers("axis", (axis,), dimension, "axes")
        return cls(tuple(float(k == axis) for k in range(dimension)), at, axis, lower, upper)


class ParticleFlow(NamedTuple):
    """What particles carry through a plane in an interval, along its normal less against it.

    Attributes:
        number: () [-].
        mass: () [kg].
        volume: () [m3].
        momentum: (D,) [kg m/s].
        forward: () number along the normal alone [-].
    """

    number: Array
    mass: Array
    volume: Array
    momentum: Array
    forward: Array


class FluidFlow(NamedTuple):
    """Flow of the fluid through a plane at a moment: () [m3/s] and [kg/s]."""

    volume: Array
    mass: Array


def _require_plane(plane: object) -> None:
    require_kinds("give a jaxdem.observables.Plane, such as Plane.across(0, 0.1, 2)", plane=(plane, Plane))


def particle_flow(
    structure: Structure, parameters: Parameters, plane: Plane, before: State, after: State
) -> ParticleFlow:
    """Particles whose centres crossed a plane between two states: N = sum_i [side_i(after) - side_i(before)].

    side_i is 1 in front of the plane and 0 behind it; along a periodic axis, where positions go on, the number of
    images of the plane that lie behind the particle. So the sum over intervals is what there is in front at the end
    less what there was at the start, exactly. A particle that has left through a side of the box between the two states
    has moved to where it left, and counts. One that came in appeared where it is: it has crossed nothing. One that
    crossed to and fro is not seen. A particle carries its mean velocity over the interval.

    Args:
        structure: or a `Simulation`.
        parameters: that go with it.
        plane: one that is not normal to an axis must be parallel to the periodic axes.
        before: state at the start of the interval.
        after: at its end; on several devices with the particles in the rows of `before`.
    """
    require_arguments(structure=structure, parameters=parameters, before=before, after=after)
    _require_plane(plane)
    start, end = required(before.particles, "particles"), required(after.particles, "particles")
    bodies = required(parameters.bodies, "parameters.bodies").of_rows(start.identity)
    duration = (after.step - before.step) * jnp.asarray(structure.interval, end.position.dtype)
    moved = compensated.rounded_difference(end.position, end.position_low, start.position, start.position_low)
    crossed = _images_behind(structure, plane, end) - _images_behind(structure, plane, start)
    if start.active is not None:
        crossed = jnp.where(start.active, crossed, 0.0)
        moved = jnp.where(start.active[:, None], moved, 0.0)
    if plane.lower is not None:
        crossed = jnp.where(_within(structure, plane, start, moved, crossed), crossed, 0.0)
    mass, volume = (jnp.broadcast_to(quantity, crossed.shape) for quantity in (bodies.mass, bodies.volume))
    flow = ParticleFlow(
        jnp.sum(crossed),
        jnp.sum(mass * crossed),
        jnp.sum(volume * crossed),
        jnp.sum((mass * crossed)[:, None] * moved, axis=0) / duration,
        jnp.sum(jnp.maximum(crossed, 0.0)),
    )
    return total(structure.cut, flow)


def _images_behind(structure: Structure, plane: Plane, particles: ParticleState) -> Array:
    """(N,) number of images of the plane behind each particle, 0 or 1 along an axis that is not periodic."""
    position, low = particles.position, split_low(particles.position_low, particles.position.shape[1])
    if plane.axis is None:
        normal = jnp.asarray(plane.normal, position.dtype)
        distance = jnp.sum(position * normal[None], axis=1) - plane.offset
        if particles.position_low is not None:
            distance = distance + jnp.sum(particles.position_low * normal[None], axis=1)
        return (distance > 0).astype(position.dtype)
    offset = jnp.asarray(plane.offset, position.dtype)
    trailing = low[plane.axis]
    zero = None if trailing is None else jnp.zeros_like(offset)
    distance, rest = compensated.difference(position[:, plane.axis], trailing, offset, zero)
    if not structure.periodic[plane.axis]:
        return (distance > 0).astype(position.dtype)
    length = structure.box[plane.axis]
    number = jnp.floor(distance / length)
    # The quotient is rounded: the remainder, to all digits, says whether it is one too many or too few.
    remainder = compensated.difference(distance, rest, *compensated.whole_periods(number, length))[0]
    return number + jnp.where(remainder < 0, -1.0, 0.0) + jnp.where(remainder >= length, 1.0, 0.0)


def _within(structure: Structure, plane: Plane, start: ParticleState, moved: Array, crossed: Array) -> Array:
    """(N,) bool, whether the straight way of each particle met the plane inside its rectangle."""
    axis = required(plane.axis, "axis of a plane with a rectangle")
    along_normal, dtype = moved[:, axis], moved.dtype
    gap = plane.offset - start.position[:, axis]
    if structure.periodic[axis]:  # to the image that it meets first
        length = structure.box[axis]
        gap = jnp.where(crossed > 0, gap % length, gap % length - length)
    moves = along_normal != 0
    share = jnp.clip(jnp.where(moves, gap / jnp.where(moves, along_normal, 1.0), 0.0), 0.0, 1.0)
    inside = jnp.ones(share.shape, bool)
    others = [k for k in range(moved.shape[1]) if k != axis]
    for k, lower, upper in zip(others, required(plane.lower, "lower"), required(plane.upper, "upper"), strict=True):
        place = start.position[:, k] + share * moved[:, k]
        if structure.periodic[k]:
            place = place % jnp.asarray(structure.box[k], dtype)
        inside = inside & (place >= lower) & (place <= upper)
    return inside


def fluid_flow(structure: Structure, parameters: Parameters, plane: Plane, state: State) -> FluidFlow:
    """Flow of the fluid through a plane that is normal to an axis, at the time of a state: Q = sum_f g u A.

    g is the void fraction on a face, u the interstitial velocity and A the face's area within the rectangle, of it what
    the walls that the fluid sees leave open; in 2-D the area has the depth of the scene. Between two layers of faces
    the flow is interpolated linearly, which agrees with continuity in a cell. Of two fluids the density on a face is
    the mean of its two cells.

    Args:
        structure: or a `Simulation`.
        parameters: that go with it.
        plane: with an axis.
        state: with a fluid.
    """
    require_arguments(structure=structure, parameters=parameters, state=state)
    _require_plane(plane)
    fluid, axis = required(state.fluid, "fluid"), required(plane.axis, "axis of a plane for the fluid")
    grid, properties = required(structure.fluid, "fluid").solver.grid, required(parameters.fluid, "parameters.fluid")
    flux = fluid.face_velocity[axis]
    if fluid.void_fraction is not None:
        flux = flux * face_average_along(grid, fluid.void_fraction, axis)
    walls = structure.open_parts(parameters, state)
    if walls is not None:
        flux = flux * walls.open_faces[axis]
    volume = _through(grid, plane, axis, flux)
    if properties.second is None or fluid.liquid_fraction is None:
        return FluidFlow(volume, properties.density * volume)
    density = mixture_density(properties.second, properties.density, fluid.liquid_fraction)
    return FluidFlow(volume, _through(grid, plane, axis, flux * face_average_along(grid, density, axis)))


def _through(grid: Grid, plane: Plane, axis: int, flux: Array) -> Array:
    """() what passes a plane normal to an axis, of a flux on the faces of that axis [m2 times its unit]."""
    dtype, spacing = flux.dtype, grid.spacing
    layer = jnp.asarray(plane.offset, dtype) / spacing[axis]
    first = jnp.clip(jnp.floor(layer).astype(jnp.int32), 0, grid.whole_cells[axis] - 1)
    share, cut = layer - first, grid.cut_along(axis)
    own, here = (first, None) if cut is None else _in_slab(cut, first, grid.cells[axis])
    near, far = jnp.take(flux, own, axis), jnp.take(flux, own + 1, axis)
    flux = (1.0 - share) * near + share * far
    if here is not None:
        flux = jnp.where(here, flux, 0.0)
    others = [k for k in range(grid.dimension) if k != axis]
    for index, k in reversed(list(enumerate(others))):
        faces = face_places(grid, k, dtype)
        lower, upper = faces[:-1], faces[1:]
        if plane.lower is not None and plane.upper is not None:
            lower, upper = jnp.maximum(lower, plane.lower[index]), jnp.minimum(upper, plane.upper[index])
        flux = jnp.matmul(flux, jnp.maximum(upper - lower, 0.0), precision=PRECISION)
    return total(grid.blocks, flux) * jnp.asarray(grid.depth, dtype)


def _in_slab(cut: Blocks, number: Array, count: int) -> tuple[Array, Array]:
    """Of a layer of the whole box its number in this slab of so many, or the nearest; and whether it is there."""
    own = number - cut.index() * count
    inside = jnp.clip(own, 0, count - 1)
    return inside, own == inside
