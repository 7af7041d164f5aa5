"""Advection of momentum by the projected flux, in conservative form."""

from __future__ import annotations

import abc
import dataclasses
from typing import Literal, Protocol

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.boundary import Boundary, Sides, momentum_excess, with_ghosts
from jaxdem.fluid.grid import FaceField, Grid, along, control_width, face_average_along, own_layers, sum_of
from jaxdem.fluid.mesh import at_side, beyond, of_slab
from jaxdem.numerics.static import static


class AdvectionScheme(Protocol):
    """How the advected value is found on the surface of a control volume."""

    @property
    def stages(self) -> Literal[2, 3]:
        """Of the Runge-Kutta method that carries it."""
        ...

    @property
    def upstream(self) -> float:
        """Weight of what the control volume upstream of a surface says; the other one has the rest [-]."""
        ...

    def to_surfaces(self, behind: Array, ahead: Array) -> tuple[Array, Array]:
        """What a control volume's value loses down to its lower and gains up to its upper surface.

        Args:
            behind, ahead: differences to its two neighbours, both along the axis.
        """
        ...


@static
class Upwind:
    """First-order upwind: the value of the control volume that the flow comes from."""

    stages: Literal[2, 3] = dataclasses.field(default=2, init=False)
    upstream: float = dataclasses.field(default=1.0, init=False)

    def to_surfaces(self, behind: Array, ahead: Array) -> tuple[Array, Array]:
        """Zero."""
        nothing = jnp.zeros_like(behind)
        return nothing, nothing


@dataclasses.dataclass(frozen=True)
class Limited(abc.ABC):
    """Second-order upwind with one slope in a control volume, so limited that there are no new extrema."""

    stages: Literal[2, 3] = dataclasses.field(default=2, init=False)
    upstream: float = dataclasses.field(default=1.0, init=False)

    @abc.abstractmethod
    def slope(self, behind: Array, ahead: Array) -> Array:
        """Difference over a control volume from those to its neighbours; it does not matter which of them is which."""

    def to_surfaces(self, behind: Array, ahead: Array) -> tuple[Array, Array]:
        """Half of the slope."""
        half = 0.5 * self.slope(behind, ahead)
        return half, half


@static
class VanLeer(Limited):
    """Van Leer's harmonic limiter: flat at extrema.

    slope = 2 a b / (a + b) where the neighbouring differences a and b have one sign, else 0.

    Source: B. van Leer, J. Comput. Phys. 14 (1974) 361-370; 32 (1979) 101-136.
    """

    def slope(self, behind: Array, ahead: Array) -> Array:
        """See the class."""
        product = behind * ahead
        monotone = product > 0
        total = jnp.where(monotone, behind + ahead, 1.0)
        return jnp.where(monotone, 2.0 * product / total, 0.0)


@static
class Superbee(Limited):
    """The steepest limiter without new extrema: fronts and shear layers stay two cells wide.

    slope = sign(a) max(min(2|a|, |b|), min(|a|, 2|b|)) where the neighbouring differences a and b have one sign, else
    0. Of the limiters it loses least of eddies of a few cells; where a flow is smooth and resolved it makes steps of
    slopes.

    Source: P. L. Roe, in Large-Scale Computations in Fluid Mechanics, Lect. Appl. Math. 22 (1985) 163-193; P. K. Sweby,
    SIAM J. Numer. Anal. 21 (1984) 995-1011.
    """

    def slope(self, behind: Array, ahead: Array) -> Array:
        """See the class."""
        a, b = jnp.abs(behind), jnp.abs(ahead)
        size = jnp.maximum(jnp.minimum(2.0 * a, b), jnp.minimum(a, 2.0 * b))
        return jnp.where(behind * ahead > 0, jnp.sign(behind) * size, 0.0)


@static
class Central:
    """The mean of both sides of a surface: no numerical viscosity, and waves of two cells at fronts.

    With continuity on the staggered grid it keeps the kinetic energy, so that eddies of a few cells live on, and
    nothing but drag and stress damps what a mesh cannot carry. Heun's method lets its waves grow at any time step; the
    third-order method of three stages does not, up to a Courant number of sqrt(3).

    Source: F. H. Harlow, J. E. Welch, Phys. Fluids 8 (1965) 2182-2189; Y. Morinishi, T. S. Lund, O. V. Vasilyev, P.
    Moin, J. Comput. Phys. 143 (1998) 90-124.
    """

    stages: Literal[2, 3] = dataclasses.field(default=3, init=False)
    upstream: float = dataclasses.field(default=1.0, init=False)

    def to_surfaces(self, behind: Array, ahead: Array) -> tuple[Array, Array]:
        """Half of the difference to the neighbour there."""
        return 0.5 * behind, 0.5 * ahead


@static
class CentralFourth:
    """The mean over a surface of the cubic that has the means of the two control volumes to either side of it.

    (7 (u_0 + u_1) - (u_-1 + u_2)) / 12: the error of `Central`, which lets waves of four cells run at two thirds of
    their speed, is of fourth order here, and they run at 0.85 of it. The fastest waves run 1.37 times as fast as on
    `Central`, so that the limit of the Courant number is so much lower.

    What it carries out of a control volume is not what it carries into the next but for a constant stream, so that it
    does not keep the energy: waves of two cells would grow by half in 2,400 steps. Two per cent more weight upstream,
    where each side by itself is the third-order upwind scheme, damp them: by e while the stream crosses 37 cells, waves
    of four cells in 150, of six in 600. Next to sides the ghost cells are those of the second-order schemes, and the
    order with them.

    Source: P. Colella, P. R. Woodward, J. Comput. Phys. 54 (1984) 174-201, eq. 1.9 on equal cells.
    """

    stages: Literal[2, 3] = dataclasses.field(default=3, init=False)
    upstream: float = dataclasses.field(default=0.51, init=False)

    def to_surfaces(self, behind: Array, ahead: Array) -> tuple[Array, Array]:
        """A third of the difference to the neighbour there and a sixth of the other; the mean of both is the
        cubic's."""
        return behind / 3.0 + ahead / 6.0, ahead / 3.0 + behind / 6.0


class SurfaceValues(Protocol):
    """What changes the values that are carried: surfaces within the mesh, see `cut_cells`, or the mean over a step, see
    `carried_momentum`."""

    def surface_value(self, grid: Grid, value: Array, around: Array, which: int, axis: int) -> Array:
        """What is carried between control volumes, of which one may be closed.

        Args:
            grid: the grid.
            value: by the scheme, on the surfaces.
            around: velocity of component `which`, two ghost layers included.
            which: of the velocity.
            axis: normal to the surfaces.
        """
        ...


def advection(
    grid: Grid,
    sides: Sides,
    scheme: AdvectionScheme,
    flux: FaceField,
    velocity: FaceField,
    cut: SurfaceValues | None = None,
) -> FaceField:
    """-div(F u) on every face [m/s2 times void fraction]; of the values on boundary faces those on outlets are used.

    A boundary face stands for half a cell. What comes in through an outlet brings half of its momentum, see `Outlet`.

    Through the surface next to an inlet that ends within a face comes besides what its patch brings beyond the face's
    mean velocity, see `momentum_excess`.

    Args:
        grid: the grid.
        sides: of the box.
        scheme: reconstruction.
        flux: F = g u on the faces, the flux of the fluid volume [m/s], or that of its mass.
        velocity: u on the faces [m/s].
        cut: what changes the values of the scheme; None for these as they are.
    """
    result = []
    for which, component in enumerate(velocity):
        terms = []
        for axis in range(grid.dimension):
            padded = with_ghosts(grid, sides, component, which, axis)
            carrier = flux_through_control_surfaces(grid, flux, which, axis)
            value = surface_value(scheme, padded, carrier, axis)
            if cut is not None:
                value = cut.surface_value(grid, value, padded, which, axis)
            transported = carrier * value
            if which == axis:
                transported = _with_inlet_momentum(grid, sides.boundary, transported, flux[axis], component, axis)
            transported = _drawn_in_by_half(grid, sides.boundary, transported, carrier, axis)
            difference = along(transported, axis, 1, None) - along(transported, axis, None, -1)
            dtype = component.dtype
            width = control_width(grid, axis, dtype) if which == axis else jnp.asarray(grid.spacing[axis], dtype)
            terms.append(-difference / width)
        result.append(sum_of(terms))
    return tuple(result)


def surface_value(scheme: AdvectionScheme, padded: Array, carrier: Array, axis: int) -> Array:
    """Values on the surfaces between the second and the last but one entry of an array padded by two."""
    difference = along(padded, axis, 1, None) - along(padded, axis, None, -1)
    down, up = scheme.to_surfaces(along(difference, axis, None, -1), along(difference, axis, 1, None))
    centre = along(padded, axis, 1, -1)
    from_below = along(centre + up, axis, None, -1)
    from_above = along(centre - down, axis, 1, None)
    value = jnp.where(carrier > 0, from_below, from_above)
    if scheme.upstream == 1.0:
        return value
    return scheme.upstream * value + (1.0 - scheme.upstream) * jnp.where(carrier > 0, from_above, from_below)


def _with_inlet_momentum(
    grid: Grid, boundary: Boundary, transported: Array, flux: Array, velocity: Array, axis: int
) -> Array:
    """Momentum through the surfaces normal to an axis, with what inlets bring in beyond the square of their mean.

    Where an inlet sucks, the box does not know how the flow narrows to the patch: nothing is added there.

    Args:
        grid: the grid.
        boundary: sides.
        transported: F u on the surfaces: sides of the box, and the middles of the cells between them [m2/s2].
        flux, velocity: F and u on the faces of the axis [m/s].
        axis: of the momentum and the surfaces.
    """
    for upper in (False, True):
        excess = momentum_excess(grid, boundary.side(axis, upper))
        if excess is not None:
            ends = (-1, None) if upper else (0, 1)
            u = along(velocity, axis, *ends)
            inward = u < 0.0 if upper else u > 0.0
            more = jnp.where(inward, of_slab(grid, excess, u.dtype) * along(flux, axis, *ends) * u, 0.0)
            more = at_side(grid, axis, upper, more, 0.0)
            place = [slice(None)] * grid.dimension
            place[axis] = slice(-2, -1) if upper else slice(1, 2)
            transported = transported.at[tuple(place)].add(more)
    return transported


def _drawn_in_by_half(grid: Grid, boundary: Boundary, transported: Array, carrier: Array, axis: int) -> Array:
    """Momentum through the surfaces normal to an axis; what comes in through an outlet counts half."""
    for upper in (False, True):
        if grid.periodic[axis] or not boundary.side(axis, upper).condition.sets_pressure:
            continue
        ends = (-1, None) if upper else (0, 1)
        through = along(carrier, axis, *ends)
        share = jnp.where(through < 0.0 if upper else through > 0.0, 0.5, 1.0).astype(transported.dtype)
        share = at_side(grid, axis, upper, share, 1.0)
        place = (slice(None),) * axis + (slice(*ends),)
        transported = transported.at[place].multiply(share)
    return transported


def flux_through_control_surfaces(grid: Grid, flux: FaceField, which: int, axis: int) -> Array:
    """F_axis on the surfaces, normal to `axis`, of the control volumes of the faces of axis `which`."""
    f = flux[axis]
    if which == axis:
        inner = 0.5 * (along(f, axis, None, -1) + along(f, axis, 1, None))
        before, after = beyond(grid, axis, inner, (-1,), (0,), own_layers(f, axis))
        return jnp.concatenate((before, inner, after), axis)
    return face_average_along(grid, f, which)
