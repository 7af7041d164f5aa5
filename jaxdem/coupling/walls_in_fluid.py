"""Walls that the fluid sees and that move, come or vanish: their velocity, and the mesh that they leave open, in every
interval.

A wall comes and vanishes between two intervals, as it does for grains. The fluid that fills a solid that has vanished
has the velocity of the wall; the fluid where one comes is gone with its momentum. Neither pushes fluid elsewhere. The
faces that stay open keep their velocity, and the grains the volume that they had: the void fraction is taken anew on
the cells that are open now.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.coupling.body_grid import BodyGrid
from jaxdem.coupling.new_cells import in_new_bodies, in_new_cells
from jaxdem.coupling.open_parts import cut_cells, on_corners, places_in_box
from jaxdem.coupling.openings import OpeningPlace, opening_parts
from jaxdem.coupling.pistons_in_fluid import PistonInFluid, gaps_of
from jaxdem.coupling.surface_velocity import swept, with_velocity
from jaxdem.errors import required
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.fluid_state import FluidProperties, FluidState, StillDistances
from jaxdem.fluid.grid import Grid
from jaxdem.numerics import pair_arithmetic as pairs
from jaxdem.numerics.batches import cond_in_batch
from jaxdem.numerics.blocks import Blocks
from jaxdem.numerics.compensated import Pair
from jaxdem.numerics.host import least_of, namespace
from jaxdem.numerics.placement import Placement, at_rest
from jaxdem.numerics.stages import stage
from jaxdem.numerics.static import static
from jaxdem.numerics.tables import Window
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.moving_walls import Numbers
from jaxdem.particles.surfaces import Cylinder, Plane
from jaxdem.solids.motion import RigidMotion

FAR = 1e3
"""Distance of a surface that is not there, over the diagonal of the box [-]."""


def signed_distance(shape: Plane | Cylinder, points: Vector) -> Array:
    """Distance from a surface in its own frame at points, D arrays of any shape, positive in the fluid [m]."""
    xp = namespace(points[0])
    if isinstance(shape, Plane):
        size = math.hypot(*shape.normal)
        terms = zip(shape.normal, points, shape.point, strict=True)
        return sum((n / size) * (x - p) for n, x, p in terms)  # type: ignore[return-value]
    across = [x - c for x, c in zip(points, shape.center, strict=True)]
    if shape.axis is not None:
        size = math.hypot(*shape.axis)
        unit = [a / size for a in shape.axis]
        way = sum(a * x for a, x in zip(unit, across, strict=True))
        across = [x - way * a for a, x in zip(unit, across, strict=True)]
    squared = sum(x * x for x in across)
    # On the axis the distance from it has no slope.
    least = np.finfo(squared.dtype).tiny  # type: ignore[union-attr]
    gap: Array = shape.radius - xp.sqrt(xp.maximum(squared, least))
    return gap if shape.inside else -gap


@static
class MovingSurface:
    """A surface that the fluid sees and that moves, or is not always there; static.

    Attributes:
        number: among the surfaces that the fluid sees.
        wall: number of its wall in the scene, and of its numbers in `Parameters.wall_motion`.
        motion: its motion; None at rest.
        shape: in its own frame, of one that changes its place, of a mesh the corners where its distance is known; None
            of one that keeps it.
        window: when it is there.
    """

    number: int
    wall: int
    motion: RigidMotion | None
    shape: Plane | Cylinder | BodyGrid | None = None
    window: Window = Window()

    @property
    def cuts_anew(self) -> bool:
        """Whether the mesh that it leaves open changes."""
        return self.shape is not None or not self.window.is_always

    def is_there(self, middle: Array) -> Array | bool:
        """Whether it is there in an interval with this middle [s]; before the run as at its start."""
        return middle < self.window.end if self.window.begin <= 0.0 else self.window.holds(middle)

    def at(self, numbers: Sequence[Numbers], time: Pair, dimension: int) -> Placement:
        """Its placement at a time [s] by the numbers of every wall."""
        if self.motion is None:
            return at_rest(dimension, time[0])
        return self.motion.at(numbers[self.wall], time)


@static
class WallsInFluid:
    """The walls that the fluid sees and that move, or are not always there; static.

    Attributes:
        grid: its mesh.
        moving: the surfaces that move, come or vanish; at least one.
        pistons: those of them that a force holds.
        openings: of all walls that the fluid sees.
    """

    grid: Grid
    moving: tuple[MovingSurface, ...]
    pistons: tuple[PistonInFluid, ...] = ()
    openings: tuple[OpeningPlace, ...] = ()

    def in_blocks(self, blocks: Blocks) -> WallsInFluid:
        """The walls as a slab of the box sees them."""
        return dataclasses.replace(self, grid=self.grid.in_blocks(blocks))

    @property
    def change_place(self) -> tuple[MovingSurface, ...]:
        """Those of which the mesh is cut anew in every interval."""
        return tuple(surface for surface in self.moving if surface.cuts_anew)

    @property
    def gates(self) -> tuple[MovingSurface, ...]:
        """Those that are not always there."""
        return tuple(surface for surface in self.moving if not surface.window.is_always)

    def over(
        self,
        properties: FluidProperties,
        state: FluidState,
        numbers: Sequence[Numbers],
        times: tuple[Pair, Array],
        middles: tuple[Array, Array],
    ) -> tuple[FluidProperties, FluidState]:
        """The fluid's numbers with the open parts of an interval, and its state on them.

        Walls have their place at the end of the interval. The velocity of one that keeps its place is that at the end;
        of one that changes it the mean, so that what it sweeps is what it moves by.

        Args:
            properties: of the fluid.
            state: at the start of the interval.
            numbers: of the motion of every wall.
            times: start of the interval as a pair, and its length, () each [s].
            middles: () of the interval before it and of the interval [s]. An interval has one middle in all places: a
                wall that vanishes just then is there, or not, for the next interval as it was for this one.
        """
        (start, duration), (before_it, middle) = times, middles
        still = required(properties.still, "still surfaces of the fluid")
        cut = required(properties.cut, "cut cells")
        if not self.change_place:
            end = pairs.total(start, pairs.as_pair(duration))
            cut = self.with_velocities(cut, still.distances, numbers, end)
            return properties._replace(cut=self._opened(cut, still.distances, numbers, end)), state
        former = self.cut(still, self.places(still, numbers, start, before_it))
        cut, opened = self.cut_and_swept(still, numbers, times, middle)
        renewed = self._renewed(before_it, middle)
        if state.void_fraction is not None:
            solids = 1.0 - state.void_fraction
            lost = solids * (cut.open_cells - former.open_cells) / duration
            opened = opened - (lost if renewed is None else jnp.where(renewed, 0.0, lost))
        fluid = cut.open_cells > 0.0
        cut = cut._replace(swept=namespace(opened).where(fluid, opened, 0.0), renewed=renewed)
        if properties.cut is not None and properties.cut.deposit_weights is not None:
            cut = cut._replace(deposit_weights=cut.open_cells)
        before = former.open_cells > 0.0
        pressure = in_new_cells(self.grid, state.pressure, before, fluid)
        if renewed is not None:
            pressure = cond_in_batch(renewed, lambda p: in_new_bodies(self.grid, p, before, fluid), pressure)
        return properties._replace(cut=cut), state._replace(pressure=pressure)

    def cut_and_swept(
        self, still: StillDistances, numbers: Sequence[Numbers], times: tuple[Pair, Array], middle: Array
    ) -> tuple[CutCells, Array]:
        """The open parts at the end of an interval with this middle and the velocities of `over`, and what the walls
        sweep; see `swept`. Other arguments as there."""
        start, duration = times
        end = pairs.total(start, pairs.as_pair(duration))
        now = self.places(still, numbers, end, middle)
        means = self._means(numbers, start, duration)
        cut = self.with_velocities(self.cut(still, now), now, numbers, end, means)
        if self.pistons:
            units = tuple(self._unit_swept(still, cut, now, means, piston) for piston in self.pistons)
            gaps = gaps_of(self.grid, self.pistons, now)
            cut = cut._replace(unit_swept=units, interval=duration, piston_gaps=gaps)
        cut = cut._replace(distance=least_of([on_corners(self.grid, d) for d in now]))
        cut = self._opened(cut, now, numbers, end)
        return cut, self._swept(still, cut, now, means)

    def _unit_swept(
        self,
        still: StillDistances,
        cut: CutCells,
        distances: Sequence[Array],
        means: dict[int, Placement],
        piston: PistonInFluid,
    ) -> Array:
        """What a piston alone sweeps at 1 m/s [1/m]."""
        xp, dtype, alone = namespace(distances[0]), distances[0].dtype, {}
        for number, placed in means.items():
            speed = np.asarray(piston.direction) * (number in piston.surfaces)
            alone[number] = placed._replace(velocity=xp.asarray(speed, dtype), angular_velocity=None)
        return self._swept(still, cut, distances, alone)

    def places(self, still: StillDistances, numbers: Sequence[Numbers], time: Pair, middle: Array) -> tuple[Array, ...]:
        """Distances of all surfaces at the corners at a time; of those far away that are not there in the interval with
        this middle [m]."""
        found, dtype = list(still.distances), still.distances[0].dtype
        corners = tuple(map(namespace(still.distances[0]).asarray, places_in_box(self.grid, None, dtype)))
        for surface in self.change_place:
            if surface.shape is not None:
                own, low = surface.at(numbers, time, len(corners)).to_body(corners, (None,) * len(corners))
                inside = tuple(x if y is None else x + y for x, y in zip(own, low, strict=True))
                if isinstance(surface.shape, BodyGrid):
                    found[surface.number] = surface.shape.distance(still.distances[surface.number], inside)
                else:
                    found[surface.number] = signed_distance(surface.shape, inside)
            if not surface.window.is_always:
                known, far = found[surface.number], FAR * math.hypot(*self.grid.size)
                found[surface.number] = namespace(known).where(surface.is_there(middle), known, far)
        return tuple(found)

    def cut(self, still: StillDistances, distances: Sequence[Array]) -> CutCells:
        """The open parts between surfaces where they are."""
        return cut_cells(self.grid, distances, still.no_slip)

    def with_velocities(
        self,
        cut: CutCells,
        distances: Sequence[Array],
        numbers: Sequence[Numbers],
        time: Pair,
        means: dict[int, Placement] | None = None,
    ) -> CutCells:
        """The open parts with the velocities at a time; of some surfaces the `means`."""
        placed: list[Placement | None] = [None] * len(distances)
        for surface in self.moving:
            if surface.motion is not None:
                mean = (means or {}).get(surface.number)
                placed[surface.number] = surface.at(numbers, time, self.grid.dimension) if mean is None else mean
        return with_velocity(self.grid, cut, distances, placed)

    def _opened(self, cut: CutCells, distances: Sequence[Array], numbers: Sequence[Numbers], time: Pair) -> CutCells:
        """The open parts with the openings at a time; the same without any."""
        if not self.openings:
            return cut
        dimension, of_wall = self.grid.dimension, {s.wall: s for s in self.moving if s.motion is not None}
        return cut._replace(
            openings=tuple(
                opening_parts(
                    self.grid, cut, distances, place,
                    of_wall[place.wall].at(numbers, time, dimension) if place.wall in of_wall else None,
                )
                for place in self.openings
            )
        )  # fmt: skip

    def _renewed(self, before: Array, now: Array) -> Array | None:
        """() bool, whether a wall has come or vanished between the intervals with these middles [s]; None where none
        does in the run."""
        found = None
        for surface in self.gates:
            changed = jnp.asarray(surface.is_there(before)) != jnp.asarray(surface.is_there(now))
            found = changed if found is None else found | changed
        return found

    def _means(self, numbers: Sequence[Numbers], start: Pair, duration: Array) -> dict[int, Placement]:
        """`_mean` of the surfaces that change their place, by their number."""

        def found() -> dict[int, Placement]:
            return {s.number: self._mean(s, numbers, start, duration) for s in self.change_place}

        end = pairs.value(start) + duration
        # Written to memory: XLA would work out the motion anew for every face. It cannot know that the time is above 0.
        return found() if namespace(end) is np else stage(end > 0.0, found)

    def _mean(self, surface: MovingSurface, numbers: Sequence[Numbers], start: Pair, duration: Array) -> Placement:
        """Its placement in the middle of an interval, with the mean velocity: exact for one that does not turn."""
        dimension = self.grid.dimension
        middle = surface.at(numbers, pairs.total(start, pairs.as_pair(0.5 * duration)), dimension)
        if surface.motion is None or surface.motion.turns:
            return middle
        end = surface.at(numbers, pairs.total(start, pairs.as_pair(duration)), dimension)
        first = surface.at(numbers, start, dimension)
        way = pairs.total((end.shift, end.shift_low), pairs.negative((first.shift, first.shift_low)))
        return middle._replace(velocity=pairs.value(way) / duration)

    def _swept(
        self, still: StillDistances, cut: CutCells, distances: Sequence[Array], means: dict[int, Placement]
    ) -> Array:
        """See `swept`; the surfaces of a wall, as the two planes of a wedge, are one body."""
        xp, changing = namespace(distances[0]), {surface.number for surface in self.change_place}
        distances = [on_corners(self.grid, d) for d in distances]
        kept = [d for k, d in enumerate(distances) if k not in changing]
        nearest = least_of(kept) if kept else xp.full_like(distances[0], xp.inf)
        bodies = []
        for wall in sorted({surface.wall for surface in self.change_place}):
            numbers = [surface.number for surface in self.change_place if surface.wall == wall]
            for k in numbers:
                nearest = xp.minimum(nearest, distances[k])
            bodies.append((nearest, numbers, means[numbers[0]]))
        open_faces = required(still.open_faces, "open faces between still surfaces")
        return swept(self.grid, cut, open_faces, bodies, nearest)
