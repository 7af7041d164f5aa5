"""Transport of a scalar by the fluid's own flux, over a coupling interval.

    d(g c)/dt + div(F c) = div(w D grad c)

g is the void fraction and F = g u the flux that the pressure solver has made satisfy d(g)/dt + div F = 0, its mean over
the fluid steps of the interval. So a uniform scalar stays uniform to the tolerance of that solver, and the sum of
g c over the cells changes by what passes the sides alone, to rounding. Advection is of second order with van Leer's
limiter, time Heun's method, in steps in which g changes linearly. Between surfaces within the mesh see `cut_scalar`.
"""

from __future__ import annotations

import dataclasses
from typing import Literal, NamedTuple

import jax.numpy as jnp
from jax import Array, checkpoint, lax

from jaxdem.fluid.advection import VanLeer, surface_value
from jaxdem.fluid.boundary import Boundary, coverage
from jaxdem.fluid.cut_scalar import ScalarSurfaces
from jaxdem.fluid.dissolved import Phase
from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, along, divergence, no_ends, slope_over
from jaxdem.fluid.mesh import Ends, at_side, beyond, end_faces, layers, of_slab, with_ends
from jaxdem.numerics.batches import cond_in_batch
from jaxdem.numerics.static import static

SideKind = Literal["closed", "value", "flux"]
"""What passes a side beside what the fluid carries: nothing, what a given value asks for, or a given flux."""

MOST_STEPS = 8
"""Steps that the fluid may take in an interval, see `interval.SUBSTEPS`."""


@static
class ScalarField:
    """A scalar that the fluid carries; static.

    Attributes:
        name: of it.
        sides: what passes each side of the box; along periodic axes not asked.
        diffuses: whether it diffuses; without no such term is compiled.
        steps: smallest number of steps in an interval, for the diffusion.
        surfaces: what passes each surface within the mesh.
        finer: steps of the scalar in a fluid step, for cells that surfaces cut.
        phase: of two fluids that it is dissolved in; not asked of temperatures, and of one fluid.
    """

    name: str
    sides: tuple[SideKind, ...]
    diffuses: bool
    steps: int = 1
    surfaces: tuple[SideKind, ...] = ()
    finer: int = 1
    phase: Phase = "both"


class ScalarNumbers(NamedTuple):
    """Numbers of a scalar; traced.

    Attributes:
        diffusivity: () [m2/s].
        value: (2 D,) at the sides of kind "value", and of what comes in with the fluid [unit of the scalar].
        flux: (2 D,) into the box through sides of kind "flux" [unit m/s].
    """

    diffusivity: Array
    value: Array
    flux: Array


class Stream(NamedTuple):
    """The fluid that carries it, over an interval.

    Attributes:
        flux: mean of F on the faces; None where nothing is carried [m/s].
        before, after: void fraction at the start and at the end; 1.0 without particles [-].
        share: w on the faces, part of the diffusivity that acts; 1.0 without particles, and times the open fraction
            between surfaces [-].
        surfaces: within the mesh; None without.
    """

    flux: FaceField | None
    before: CellOrOne
    after: CellOrOne
    share: tuple[CellOrOne, ...]
    surfaces: ScalarSurfaces | None = None

    def capacity(self) -> tuple[CellOrOne, CellOrOne]:
        """Of the cells for the scalar at the start and at the end: the void fraction, or see `cut_scalar` [-]."""
        if self.surfaces is None:
            return self.before, self.after
        return self.surfaces.capacity(self.before), self.surfaces.capacity(self.after)


class ScalarTransport(NamedTuple):
    """How a scalar is carried: static parts and numbers.

    Attributes:
        grid, boundary, field: static.
        numbers: of the scalar.
        stream: the fluid.
    """

    grid: Grid
    boundary: Boundary
    field: ScalarField
    numbers: ScalarNumbers
    stream: Stream

    def advance(self, value: Array, duration: Array, fluid_steps: Array, reversible: bool) -> tuple[Array, Array]:
        """The scalar after the interval, and what has come in through sides and surfaces.

        Args:
            value: on the cells, at the start.
            duration: of the interval [s].
            fluid_steps: () int32, fluid steps of the interval, which its Courant number asks for.
            reversible: a loop that reverse-mode differentiation can run backwards.

        Returns:
            on the cells; and (2 D + S,) through every side, lower before upper, then every surface [unit m3].
        """
        finer, surfaces = self.field.finer, len(self.field.surfaces)
        number = jnp.maximum(fluid_steps if finer == 1 else finer * fluid_steps, self.field.steps)
        step = duration / number.astype(value.dtype)
        start = value, jnp.zeros(2 * self.grid.dimension + surfaces, value.dtype)
        if not reversible:
            return lax.fori_loop(0, number, lambda k, both: self._stepped(both, k, number, step), start)

        @checkpoint
        def body(both: tuple[Array, Array], k: Array) -> tuple[tuple[Array, Array], None]:
            return cond_in_batch(k < number, lambda b: self._stepped(b, k, number, step), both), None

        return lax.scan(body, start, jnp.arange(max(finer * MOST_STEPS, self.field.steps)))[0]

    def _stepped(self, both: tuple[Array, Array], k: Array, number: Array, step: Array) -> tuple[Array, Array]:
        """Heun's step number k of `number`."""
        value, passed = both
        before, after = self.stream.capacity()
        start, stop = ((k + end).astype(value.dtype) / number.astype(value.dtype) for end in (0, 1))
        old, new = (before + (after - before) * share for share in (start, stop))
        rate, through = self._rate(value)
        if self.stream.surfaces is not None:
            return self._stepped_between(self.stream.surfaces, both, (old, new, step), (rate, through))
        first = (old * value + step * rate) / new
        second, later = self._rate(first)
        found = (0.5 * old * value + 0.5 * (new * first + step * second)) / new
        return found, passed + 0.5 * step * (through + later)

    def _stepped_between(
        self,
        surfaces: ScalarSurfaces,
        both: tuple[Array, Array],
        steps: tuple[CellOrOne, CellOrOne, Array],
        rates: tuple[Array, Array],
    ) -> tuple[Array, Array]:
        """The same between surfaces, of which each of Heun's two stages takes the exchange implicitly."""
        (value, passed), (old, new, step), (rate, through) = both, steps, rates
        first, given = surfaces.after(old * value + step * rate, jnp.asarray(new), step)
        second, later = self._rate(first)
        final, more = surfaces.after(new * first + step * second, jnp.asarray(2.0 * new - old), step)
        found = 0.5 * (old * value + (2.0 * new - old) * final) / new
        on_surfaces = self.grid.cell_volume * surfaces.by_surface(given + more)
        return found, passed + 0.5 * jnp.concatenate((step * (through + later), on_surfaces))

    def _rate(self, value: Array) -> tuple[Array, Array]:
        """Rate of change of g c [unit/s], and what comes in through the sides that the slab has [unit m3/s]."""
        grid, total, passed = self.grid, [], []
        for axis in range(grid.dimension):
            flux = self._flux(value, axis)
            total.append(flux)
            area = grid.cell_volume / grid.spacing[axis]
            if grid.periodic[axis]:
                passed += [jnp.zeros((), value.dtype)] * 2
                continue
            lower, upper = area * jnp.sum(along(flux, axis, 0, 1)), -area * jnp.sum(along(flux, axis, -1, None))
            passed += [at_side(grid, axis, False, lower, 0.0), at_side(grid, axis, True, upper, 0.0)]
        return -divergence(grid, tuple(total)), jnp.stack(passed)

    def _flux(self, value: Array, axis: int) -> Array:
        """Flux of the scalar through the faces of an axis, by flow and diffusion [unit m/s]."""
        grid, flux = self.grid, self._carried(value, axis)
        if self.field.diffuses:
            h = grid.spacing[axis]
            inner = (along(value, axis, 1, None) - along(value, axis, None, -1)) / h
            ends = end_faces(grid, axis, value, slope_over(h), no_ends)
            slope = jnp.concatenate((ends[0], inner, ends[1]), axis)
            flux = flux - self.numbers.diffusivity * self.stream.share[axis] * slope
        if set(self.field.sides[2 * axis : 2 * axis + 2]) == {"closed"}:
            return flux
        return with_ends(grid, axis, flux, self._through_sides(value, flux, axis))

    def _carried(self, value: Array, axis: int) -> Array:
        """What the fluid carries through the faces of an axis [unit m/s]."""
        grid = self.grid
        if self.stream.flux is None:
            return jnp.zeros(grid.face_shape(axis), value.dtype)
        carrier = self.stream.flux[axis]
        wide = beyond(grid, axis, value, (-2, -1), (0, 1), lambda: self._ghosts(value, axis))
        carried = surface_value(VanLeer(), jnp.concatenate((wide[0], value, wide[1]), axis), carrier, axis)
        if not grid.periodic[axis]:
            carried = with_ends(grid, axis, carried, self._carried_at_sides(value, carrier, axis))
        return carrier * carried

    def _ghosts(self, value: Array, axis: int) -> Ends:
        """Two layers beyond the sides: mirrored about a value that is given, continued evenly elsewhere."""
        count, found = self.grid.cells[axis], []
        second = min(1, count - 1)
        for upper in (False, True):
            mirror = (count - 1, count - 1 - second) if upper else (second, 0)
            if self.field.sides[2 * axis + upper] == "value":
                found.append(2.0 * self.numbers.value[2 * axis + upper] - layers(value, axis, mirror))
            else:
                found.append(layers(value, axis, (count - 1, count - 1) if upper else (0, 0)))
        return found[0], found[1]

    def _carried_at_sides(self, value: Array, carrier: Array, axis: int) -> Ends:
        """The scalar of the fluid that passes the sides: what comes in has the side's value where it has one."""
        found = []
        for upper in (False, True):
            place, number = ((-1, None) if upper else (0, 1)), 2 * axis + upper
            inside, through = along(value, axis, *place), along(carrier, axis, *place)
            if self.field.sides[number] == "value":
                comes_in = through < 0.0 if upper else through > 0.0
                inside = jnp.where(comes_in, self.numbers.value[number], inside)
            found.append(inside)
        return found[0], found[1]

    def _through_sides(self, value: Array, flux: Array, axis: int) -> Ends:
        """Flux on the sides with what passes them beside the flow: by diffusion to a given value over half a cell, or
        as given. Through an inlet the flow alone brings something: what diffuses against it is none of the box."""
        grid, numbers, found = self.grid, self.numbers, []
        for upper in (False, True):
            side, number = self.boundary.side(axis, upper), 2 * axis + upper
            place = (-1, None) if upper else (0, 1)
            flow, kind = along(flux, axis, *place), self.field.sides[number]
            inward = None
            if kind == "flux":
                inward = numbers.flux[number]
            elif kind == "value" and side.kind not in ("inlet", "outlet"):
                w = self.stream.share[axis]
                there = w if isinstance(w, float) else along(w, axis, *place)
                apart = numbers.value[number] - along(value, axis, *place)
                inward = numbers.diffusivity * there * apart / (0.5 * grid.spacing[axis])
            if inward is not None:
                covered = of_slab(grid, coverage(grid, dataclasses.replace(side, profile=None)), value.dtype)
                if kind == "flux" and self.stream.surfaces is not None:
                    covered = covered * along(self.stream.surfaces.open_faces[axis], axis, *place)
                flow = flow - covered * inward if upper else flow + covered * inward
            found.append(flow)
        return found[0], found[1]
