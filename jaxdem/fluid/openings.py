"""Inlets and outlets on surfaces within the mesh, see `cut_cells`: fluid passes the surface along its normal.

With A the area of the surface in a cell, v the speed at which the fluid comes in there and s its supply:

    div(a g u) = s - growth,      s V = v A
    M V d(g u)/dt = - sum F u  +  s V u_in  + ...

What comes in brings u_in, the velocity of the surface and v/g along the normal; what leaves has the velocity of the
fluid. Half of a cell's supply is that of either face. The friction on the surface, which is towards the velocity of
the surface, is towards u_in. A is the difference of the open parts of a cell's faces, so that a plane on a grid line is
the inlet of a side of the box. A face that the opening covers in part has the mean velocity of its surface.

An outlet takes what the volume of the box, closed otherwise, leaves over, at one speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.fluid.boundary import Boundary, Sides, ramp, set_normal_velocity
from jaxdem.fluid.cut_cells import CutCells, OpeningParts
from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, divergence, face_average, sum_of, sum_of_fields
from jaxdem.numerics.blocks import total
from jaxdem.numerics.static import static
from jaxdem.numerics.tables import at_time, largest_between

ROUNDING = 1e-4
"""Of the sum of volumes that come and go, over that of their sizes, in float32 with many cells [-]."""


@static
class Opening:
    """What passes an opening; static.

    Attributes:
        given: its speed along the normal of the surface, into the fluid [m/s], or its flow [m3/s]; neither of an
            outlet.
        ramp_time: over which it rises linearly from zero [s].
        times: increasing, of a table in time; None for one value [s].
    """

    given: Literal["velocity", "flow", "nothing"]
    ramp_time: float = 0.0
    times: tuple[float, ...] | None = None

    def speed(self, part: OpeningParts, value: Array, time: Array) -> Array:
        """() speed at which fluid comes in at a time [s], by its value, () or (T,) of a table [m/s]."""
        now = ramp(self.ramp_time, time) * at_time(self.times, value[..., None], time)[0]
        return now if self.given == "velocity" else _over_area(now, part.area)

    def largest_speed(self, part: OpeningParts, value: Array, start: Array, stop: Array) -> Array:
        """() largest speed either way between two times, whatever its ramp has reached [m/s]."""
        most = largest_between(self.times, value, start, stop)
        return most if self.given == "velocity" else _over_area(most, part.area)


class Openings(NamedTuple):
    """All openings, with the box that they are in; static."""

    grid: Grid
    boundary: Boundary
    every: tuple[Opening, ...]

    def through(
        self,
        cut: CutCells,
        values: Sequence[Array],
        sides: Sides,
        void_fraction: Sequence[CellOrOne],
        growth: Array,
    ) -> tuple[CutCells, Array]:
        """The surfaces with what passes their openings at a time, and what continuity asks for with it.

        Args:
            cut: the open parts.
            values: of every opening, () or (T,) [m/s] or [m3/s].
            sides: of the box at that time.
            void_fraction: g on the faces.
            growth: rate of change of the volume of fluid over that of a whole cell [1/s].
        """
        grid, parts = self.grid, required(cut.openings, "openings")
        speeds = [
            None if one.given == "nothing" else one.speed(part, value, sides.time)
            for one, part, value in zip(self.every, parts, values, strict=True)
        ]
        closed = not self.boundary.has_outlet
        excess = growth
        if closed:
            still = tuple(jnp.zeros_like(a) for a in cut.open_faces)
            at_sides = set_normal_velocity(grid, sides, still, tuple(void_fraction))
            openness = cut.opened(void_fraction)
            excess = excess + divergence(grid, tuple(g * u for g, u in zip(openness, at_sides, strict=True)))
        given = zip(parts, speeds, strict=True)
        supply = sum((v * part.supply for part, v in given if v is not None), start=jnp.zeros_like(growth))
        outlets = [part for part, v in zip(parts, speeds, strict=True) if v is None]
        if outlets:
            left = grid.cell_volume * total(grid.blocks, jnp.sum(excess - supply))
            rest = _over_area(left, sum_of(part.area for part in outlets))
            speeds = [rest if v is None else v for v in speeds]
            supply = supply + rest * sum_of(part.supply for part in outlets)
        found = growth - supply
        if closed:
            fluid, left = cut.open_cells > 0.0, excess - supply
            sums = jnp.sum(left), jnp.sum(jnp.abs(excess) + jnp.abs(supply)), jnp.sum(fluid.astype(left.dtype))
            net, gross, cells = total(grid.blocks, sums)
            # Rounding, which no flow in a closed box can take up. More than that must not go unseen: no pressure solves
            # for it, and the run stops.
            net = jnp.where(jnp.abs(net) < ROUNDING * gross, net, 0.0)
            found = found - jnp.where(fluid, net / cells, 0.0)
        return self._with_momentum(cut, supply, speeds, void_fraction), found  # type: ignore[arg-type]

    def _with_momentum(
        self, cut: CutCells, supply: Array, speeds: Sequence[Array], void_fraction: Sequence[CellOrOne]
    ) -> CutCells:
        """The surfaces with the supply, the momentum that it brings, and the velocity of what passes."""
        grid, parts = self.grid, required(cut.openings, "openings")
        comes = face_average(grid, jnp.maximum(supply, 0.0))
        brought: FaceField = tuple(c * w for c, w in zip(comes, cut.velocity, strict=True))
        velocity = cut.velocity
        for part, v in zip(parts, speeds, strict=True):
            inwards = face_average(grid, jnp.maximum(v, 0.0) * part.supply)
            push = (s * v * n / g for s, n, g in zip(inwards, part.normal, void_fraction, strict=True))
            brought = sum_of_fields(brought, tuple(push))
            own = (v * share / g for share, g in zip(part.velocity, void_fraction, strict=True))
            velocity = sum_of_fields(velocity, tuple(own))
        return cut._replace(velocity=velocity, supply=supply, brought=brought, speeds=tuple(speeds))

    def rates(
        self, cut: CutCells, values: Sequence[Array], times: tuple[Array, Array], void_fraction: CellOrOne
    ) -> list[Array]:
        """Largest |u|/h on every axis, in a slab, by what passes the openings between two times [1/s]."""
        parts = required(cut.openings, "openings")
        speeds = [
            jnp.zeros_like(part.area) if one.given == "nothing" else one.largest_speed(part, value, *times)
            for one, part, value in zip(self.every, parts, values, strict=True)
        ]
        flow = sum_of(v * part.area for v, part in zip(speeds, parts, strict=True))
        areas = (part.area if one.given == "nothing" else 0.0 for one, part in zip(self.every, parts, strict=True))
        out = sum_of(areas)
        found = []
        for axis, (g, h) in enumerate(zip(face_average(self.grid, void_fraction), self.grid.spacing, strict=True)):
            of_each = [
                jnp.max(jnp.abs(part.velocity[axis]) / g) * (v if one.given != "nothing" else _over_area(flow, out))
                for one, part, v in zip(self.every, parts, speeds, strict=True)
            ]
            found.append(jnp.max(jnp.stack(of_each)) / h)
        return found


def _over_area(flow: Array, area: Array) -> Array:
    """Speed of a flow; zero where a body that moves has covered all of the opening [m/s]."""
    return jnp.where(area > 0.0, flow / jnp.where(area > 0.0, area, 1.0), 0.0)
