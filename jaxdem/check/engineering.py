"""What an engineer knows a scene by: velocities of fall and fluidisation, dimensionless numbers, loads. Host side."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from jaxdem.closures import DRAG_LAWS
from jaxdem.closures.correlation import VOID_FRACTION_FLOOR, Correlation
from jaxdem.fluid.boundary import net_inflow
from jaxdem.scene import Scene
from jaxdem.setup import stability
from jaxdem.setup.bodies import Bodies
from jaxdem.setup.boundaries import boundary_speed
from jaxdem.setup.builder import Case
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters

PACKED = {2: 0.85, 3: 0.6}
"""Solid fraction of a pack that begins to float: of spheres in 3-D, by area of discs in a layer."""

HALVINGS = 64
"""Of an interval of twelve decades: more than float64 resolves."""


@dataclasses.dataclass(frozen=True)
class Number:
    """A figure of the scene, for its slowest and its fastest settling grain; equal where all are alike.

    Attributes:
        name: in words.
        low, high: values.
        unit: or "-".
        note: what it stands on.
    """

    name: str
    low: float
    high: float
    unit: str
    note: str = ""


@dataclasses.dataclass(frozen=True)
class ScreenLoad:
    """What the fluid presses onto a side that holds grains back.

    Attributes:
        side: of the box.
        weights: mean force on a grain at the side, over its weight; its mass times 9.81 m/s2 without gravity [-].
        overlap: of two grains under that force, over the diameter [-].
    """

    side: str
    weights: float
    overlap: float


@dataclasses.dataclass(frozen=True)
class DragInFluid:
    """Drag on spheres by a correlation in one fluid. Slips are interstitial, arrays (N,), lengths in m, forces in N.

    Attributes:
        multiple: F(solid fraction s, Reynolds number), the multiple of Stokes drag, of numpy arrays.
        density: rho of the fluid [kg/m3].
        viscosity: nu = mu / rho [m2/s].
    """

    multiple: Callable[[np.ndarray, np.ndarray], np.ndarray]
    density: float
    viscosity: float

    @classmethod
    def of(cls, law: Correlation, density: float, viscosity: float) -> DragInFluid:
        """The drag by a law; nothing is compiled for one that takes arrays of NumPy."""

        def multiple(solid_fraction: np.ndarray, reynolds: np.ndarray) -> np.ndarray:
            both: Any = (np.asarray(x, float) for x in np.broadcast_arrays(solid_fraction, reynolds))
            return np.asarray(law.stokes_multiple(*both), float)

        return cls(multiple, density, viscosity)

    def force(self, slip: np.ndarray, solid_fraction: float, diameter: np.ndarray) -> np.ndarray:
        """3 pi mu d F(s, Re) u with the slip u and Re = (1 - s) rho u d / mu."""
        reynolds = (1.0 - solid_fraction) * slip * diameter / self.viscosity
        multiple = self.multiple(np.full(np.shape(reynolds), solid_fraction), reynolds)
        return 3.0 * math.pi * self.density * self.viscosity * diameter * multiple * slip

    def slip_under(self, load: np.ndarray, solid_fraction: float, diameter: np.ndarray) -> np.ndarray:
        """Slip u at which the drag is a given force >= 0 [m/s]."""
        stokes = load / (3.0 * math.pi * self.density * self.viscosity * diameter)
        newton = np.sqrt(load / self.density) / diameter  # a drag coefficient of 8/pi; the bracket goes far beyond
        high = np.log(100.0 * np.maximum(stokes, newton) + 1e-300)
        low = high - 12.0 * math.log(10.0)
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            below = self.force(np.exp(middle), solid_fraction, diameter) < load
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.where(load > 0.0, np.exp(0.5 * (low + high)), 0.0)

    def weight(self, diameter: np.ndarray, density: np.ndarray, gravity: float) -> np.ndarray:
        """Size of the weight less buoyancy."""
        return math.pi / 6.0 * diameter**3 * np.abs(density - self.density) * gravity

    def terminal_velocity(self, diameter: np.ndarray, density: np.ndarray, gravity: float) -> np.ndarray:
        """Speed at which one sphere alone falls, or rises: its drag is its weight less buoyancy [m/s]."""
        return self.slip_under(self.weight(diameter, density, gravity), 0.0, diameter)

    def minimum_fluidisation_velocity(
        self, diameter: np.ndarray, density: np.ndarray, gravity: float, solid_fraction: float
    ) -> np.ndarray:
        """Superficial velocity U = g u at which a pack is carried, g = 1 - s its void fraction [m/s].

        Model A: the fluid loses n f_d = -g dp/dx to n grains a volume, each of which has drag f_d and V dp/dx, together
        f_d / g; so f_d = g times the weight less buoyancy. For Ergun's law that is his pressure drop at the weight of
        the bed.
        """
        void_fraction = 1.0 - solid_fraction
        load = void_fraction * self.weight(diameter, density, gravity)
        return void_fraction * self.slip_under(load, solid_fraction, diameter)


def packed_solid_fraction(scene: Scene, diameter: float) -> float:
    """Of a pack: in 2-D of the spheres in a layer of `domain.depth`, no more than laws are evaluated at."""
    fraction = PACKED[scene.dimension]
    if scene.dimension == 2:
        fraction *= 2.0 * diameter / (3.0 * (scene.domain.depth or diameter))
    return min(fraction, 1.0 - VOID_FRACTION_FLOOR)


def engineering_numbers(case: Case) -> tuple[Number, ...]:
    """The numbers of a scene with grains and fluid; none without either."""
    scene, bodies = case.scene, case.grains
    fluid, coupling = scene.fluid, scene.coupling
    if fluid is None or coupling is None or bodies.radius.size == 0 or coupling.drag not in DRAG_LAWS:
        return ()  # with a closure in its place the name of the law is not looked at
    gravity = math.hypot(*scene.domain.strongest_gravity)
    diameter, density = _extremes(bodies, fluid.density)
    drag = DragInFluid.of(DRAG_LAWS[coupling.drag](), fluid.density, fluid.viscosity)
    named = f"by {coupling.drag}"
    if scene.closure.file is not None or jax.tree.leaves(case.parameters.closure):
        named += ", not by the closure"
    excess = np.abs(density / fluid.density - 1.0)
    found = [
        _number("grain / fluid density", density / fluid.density, "-"),
        _number("Archimedes number", gravity * excess * diameter**3 / fluid.viscosity**2, "-"),
    ]
    if gravity > 0.0:
        fall = drag.terminal_velocity(diameter, density, gravity)
        solid = packed_solid_fraction(scene, float(diameter.max()))
        lift = drag.minimum_fluidisation_velocity(diameter, density, gravity, solid)
        impact = density / fluid.density * fall * diameter / (9.0 * fluid.viscosity)
        found += [
            _number("terminal velocity", fall, "m/s", f"a single grain, {named}"),
            _number("  its Reynolds number", fall * diameter / fluid.viscosity, "-"),
            _number(
                "  its Stokes number", impact, "-", "for an impact: below about 10, grains do not rebound in a liquid"
            ),
            _number(
                "minimum fluidisation",
                lift,
                "m/s",
                f"superficial velocity, at a solid fraction of {solid:.2g}, {named}",
            ),
        ]
    return (*found, *_flow_numbers(scene, diameter, density))


def _flow_numbers(scene: Scene, diameter: np.ndarray, density: np.ndarray) -> list[Number]:
    """Those of the stream past the grains; none where no boundary and no initial velocity moves it."""
    fluid, speed, length = scene.fluid, boundary_speed(scene), _flow_length(scene)
    if fluid is None or speed == 0.0:
        return []
    gravity = math.hypot(*scene.domain.strongest_gravity)
    excess = np.abs(density / fluid.density - 1.0)
    relaxation = density * diameter**2 / (18.0 * fluid.density * fluid.viscosity)
    found = [
        _number("flow speed U", np.full(2, speed), "m/s", "largest speed at a boundary or of the initial fluid"),
        _number("  particle Reynolds number", speed * diameter / fluid.viscosity, "-", "U d / nu"),
        _number(
            "  flow Reynolds number",
            np.full(2, speed * length / fluid.viscosity),
            "-",
            f"U L / nu, L = {length:.3g} m",
        ),
        _number("  Stokes number", relaxation * speed / length, "-", "Stokes relaxation time times U / L"),
    ]
    if gravity > 0.0 and excess.min() > 0.0:
        froude = speed / np.sqrt(excess * gravity * diameter)
        found.append(_number("  densimetric Froude number", froude, "-", "U / sqrt(|rho_p/rho - 1| g d)"))
    return found


def screen_load(
    scene: Scene, simulation: Simulation, parameters: Parameters, bodies: Bodies, count: float
) -> ScreenLoad | None:
    """The mean load of the grains at an outlet that is a screen to them; None where the stream carries nothing there.

    Of every grain that the superficial velocity U through the outlet's side carries (its drag alone exceeds its weight
    and friction that hold it), the side bears what the stream puts on it in a pack, f_d(s, U) / g, with its weight
    along it; it is shared by a layer of grains side by side. Chains of forces make it up to some three times that for
    single grains.
    """
    fluid, contact = scene.fluid, scene.contact
    flow = _outflow(scene, simulation, parameters)
    if fluid is None or contact is None or scene.coupling is None or flow is None or count == 0:
        return None
    if scene.coupling.drag not in DRAG_LAWS:
        return None
    side, axis, outward, speed = flow
    drag = DragInFluid.of(DRAG_LAWS[scene.coupling.drag](), fluid.density, fluid.viscosity)
    diameter, density = _extremes(bodies, fluid.density)
    solid = packed_solid_fraction(scene, float(diameter.max()))
    gravity = np.asarray(scene.domain.strongest_gravity)
    submerged = math.pi / 6.0 * diameter**3 * (density - fluid.density)
    along = submerged * outward * gravity[axis]
    held = contact.friction * np.abs(submerged) * float(np.linalg.norm(np.delete(gravity, axis)))
    alone = drag.force(np.full(2, speed), 0.0, diameter)
    void_fraction = 1.0 - solid
    packed = drag.force(np.full(2, speed / void_fraction), solid, diameter)
    carried = alone + along > held
    if not carried.all():
        return None
    layer = math.prod(
        max(1.0, length / float(diameter.max())) for other, length in enumerate(scene.domain.size) if other != axis
    )
    force = max(1.0, count / layer) * float(np.mean(packed / void_fraction + along - held))
    weight = math.pi / 6.0 * float(np.mean(diameter**3 * density)) * (float(np.linalg.norm(gravity)) or 9.81)
    radius = 0.5 * float(diameter.min())
    if contact.law == "hertz_mindlin":
        modulus = 0.5 * contact.young_modulus / (1.0 - contact.poisson_ratio**2)
        overlap = stability.hertz_resting_overlap(force, 0.5 * radius, modulus)
    else:
        overlap = force / (contact.normal_stiffness or math.inf)
    return ScreenLoad(side, force / weight, overlap / (2.0 * radius))


def _outflow(scene: Scene, simulation: Simulation, parameters: Parameters) -> tuple[str, int, float, float] | None:
    """Side, axis, sign of its outward normal, and superficial velocity of the one outlet that grains stay behind."""
    outlets = [name for name in scene.sides if scene.boundary[name].kind == "outlet"]
    if simulation.fluid is None or parameters.fluid is None or len(outlets) != 1:
        return None
    (name,) = outlets
    if scene.boundary[name].particles == "remove":
        return None
    velocities = [np.asarray(one) for one in parameters.fluid.side_velocity]
    grid = simulation.fluid.solver.grid
    inflow, _ = net_inflow(grid, simulation.boundary, velocities, scene.time.end)
    number = scene.sides.index(name)
    area = math.prod(grid.size) * grid.depth / grid.size[number // 2]
    if not inflow > 0.0:
        return None
    return name, number // 2, 1.0 if number % 2 else -1.0, inflow / area


def _extremes(bodies: Bodies, fluid_density: float) -> tuple[np.ndarray, np.ndarray]:
    """(2,) diameter and density of the grain that settles slowest and of the one that does so fastest."""
    radius, density = np.broadcast_arrays(np.atleast_1d(bodies.radius), np.atleast_1d(bodies.density))
    pull = radius**3 * np.abs(density - fluid_density)
    which = [int(np.argmin(pull)), int(np.argmax(pull))]
    return 2.0 * radius[which], density[which]


def _flow_length(scene: Scene) -> float:
    """Width of the narrowest inlet, or the shortest side of the box where there is none [m]."""
    widths = []
    for number, name in enumerate(scene.sides):
        side = scene.boundary[name]
        if side.kind == "inlet":
            others = [length for axis, length in enumerate(scene.domain.size) if axis != number // 2]
            patch = zip(side.from_ or (0.0,) * len(others), side.to or others, strict=True)
            widths += [stop - start for start, stop in patch]
    return min(widths or scene.domain.size)


def _number(name: str, values: np.ndarray, unit: str, note: str = "") -> Number:
    return Number(name, float(np.min(values)), float(np.max(values)), unit, note)
