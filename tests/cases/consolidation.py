"""A saturated pack under a porous piston: how the pressure of its water decays, by Terzaghi's theory."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxdem.state import Diagnostics, State
from tests.cases.march import March
from tests.cases.registry import Figure, below, case, relative

DIAMETER, DENSITY, STIFFNESS = 4e-3, 2500.0, 1000.0
"""Of the grains [m, kg/m3], and of the linear law [N/m]: soft, so that the pack consolidates within a second."""

VISCOSITY, INTERVAL = 1.4e-4, 6e-4
"""Kinematic [m2/s]: Re of a grain is below 0.1. The interval is 0.4 of the relaxation time of the grains by their
drag, and 2 times sqrt(m/k) [s]."""

STRESS, STEP = 2500.0, 0.2
"""On the pack before the step [Pa], and the step over it [-]. A grain is pressed in by 1 % of its diameter."""

FLOW = 0.05
"""Drop of the pressure in the flow that tells the permeability, over `STRESS`, about [-]."""

GUESS = 0.03
"""About what c_v is [m2/s]; durations are chosen by H^2 over it."""

REST, SLOW = 2.5, 2.0
"""Durations over H^2/`GUESS` [-]: after the first load is lifted, so that 0.3 % of the pressure that this makes is
left; and of slow loading."""


def pressure_at_base(time: Any, terms: int = 200) -> Any:
    """Excess pressure at the undrained end over that of the start, at times T = c_v t/H^2 > 0.

    p/p_0 = sum_m 4/(pi (2 m + 1)) (-1)^m exp(-(2 m + 1)^2 pi^2 T/4).

    Source: K. Terzaghi, Erdbaumechanik (1925); K. Terzaghi, Theoretical Soil Mechanics (1943), chapter 13.
    """
    m = np.arange(terms)[:, None]
    odd = 2 * m + 1
    return np.sum(4.0 / (np.pi * odd) * (-1.0) ** m * np.exp(-((odd * np.pi) ** 2) * np.asarray(time) / 4.0), axis=0)


def settlement(time: Any, terms: int = 200) -> Any:
    """Settlement over that of the end, 1 - sum_m 8/((2 m + 1)^2 pi^2) exp(-(2 m + 1)^2 pi^2 T/4)."""
    odd = 2 * np.arange(terms)[:, None] + 1
    return 1.0 - np.sum(8.0 / (odd * np.pi) ** 2 * np.exp(-((odd * np.pi) ** 2) * np.asarray(time) / 4.0), axis=0)


class Reading(NamedTuple):
    """The pack after a stretch of time.

    Attributes:
        pressure: at its base, mean over the stretch [Pa].
        displacement: of the piston at its end, downwards [m].
    """

    pressure: float
    displacement: float


class Pack(NamedTuple):
    """The pack of a column.

    Attributes:
        columns: mean diameters across.
        layers: mean diameters from floor to piston at the start.
        solid_fraction: of the section, as it is grown [-].
        friction: between the grains [-].
        seed: of their places.
    """

    columns: int
    layers: int
    solid_fraction: float = 0.8
    friction: float = 0.4
    seed: int = 1


class Column:
    """Discs between a floor, which water may come through, and a plane that a force holds and the water does not see;
    periodic across, without gravity."""

    def __init__(self, pack: Pack):
        """Builds and compiles it."""
        columns, layers = pack.columns, pack.layers
        width, self.top = columns * DIAMETER, layers * DIAMETER
        self.area = width * DIAMETER
        above = 4
        radii = [0.4 * DIAMETER, 0.6 * DIAMETER]
        lid = {"direction": [0.0, -1.0], "force": STRESS * self.area, "mass": 2e-4 * columns}

        def observe(state: State, diagnostics: Diagnostics) -> Any:
            assert state.fluid is not None
            return state.fluid.pressure.mean(axis=0)

        self.march = March(
            dict(
                seed=pack.seed,
                precision="float64",
                domain=dict(size=[width, self.top + above * DIAMETER], depth=DIAMETER, gravity=[0.0, 0.0]),
                particles=dict(
                    density=DENSITY,
                    distribution=dict(kind="table", by="number", radii=radii, cumulative=[0.0, 1.0]),
                    pack=dict(
                        kind="grown", solid_fraction=pack.solid_fraction, start=[0.0, 0.0], stop=[width, self.top]
                    ),
                ),
                contact=dict(
                    law="linear_spring_dashpot", normal_stiffness=STIFFNESS, restitution=0.3, friction=pack.friction,
                    speed=0.2, skin=0.3, time_step=INTERVAL / 17,
                ),
                fluid=dict(
                    cells=[columns, layers + above], density=1000.0, viscosity=VISCOSITY, time_step=INTERVAL
                ),
                boundary=dict(
                    left=dict(kind="periodic"), bottom=dict(kind="inlet", velocity=1e-3), top=dict(kind="outlet"),
                ),
                coupling=dict(drag="ergun", interval=INTERVAL, kernel_width=dict(diameters=1.0, cells=1.0)),
                walls=[dict(kind="plane", point=[0.0, self.top], normal=[0.0, -1.0], piston=lid)],
                time=dict(end=60.0, output_interval=0.06),
            ),
            observe,
        )  # fmt: skip
        self.at_rest = self.march.state, self.march.neighbors

    def hold(self, stress: float, duration: float, flow: float = 0.0) -> Reading:
        """Goes on under a stress on the piston [Pa] with a superficial velocity through the floor [m/s]."""
        march = self.march
        own, fluid = march.parameters.pistons[0], march.parameters.fluid
        force = jnp.full_like(own.force, stress * self.area)
        sides = list(fluid.side_velocity)
        sides[2] = jnp.zeros_like(sides[2]).at[1].set(flow)
        march.parameters = march.parameters._replace(
            pistons=(own._replace(force=force),), fluid=fluid._replace(side_velocity=tuple(sides))
        )
        row = np.asarray(march.advance(duration))
        way = float(march.state.particles.pistons.displacement[0])
        # The floor is half a cell under the first row, and the pressure has no slope there but that of the flow.
        return Reading(float(row[0] + (0.5 * (row[0] - row[1]) if flow else 0.0)), way)

    def keep(self) -> None:
        """The present state is that from which `back` goes on."""
        self.at_rest = self.march.state, self.march.neighbors

    def back(self) -> None:
        """The state that was kept."""
        self.march.state, self.march.neighbors = self.at_rest

    @property
    def mass(self) -> float:
        """Of the grains [kg]."""
        radius = np.asarray(self.march.parameters.bodies.radius)
        return float(np.sum(4.0 / 3.0 * np.pi * radius**3 * DENSITY))

    @property
    def height(self) -> float:
        """From the floor to the piston [m]."""
        return self.top - float(self.march.state.particles.pistons.displacement[0])


class Found(NamedTuple):
    """What a column did.

    Attributes:
        modulus: constrained, of slow drained loading [Pa].
        permeability: superficial velocity over pressure gradient [m2/(Pa s)].
        height: drainage path [m].
        inertia: mass of the grains over the volume of the pack [kg/m3].
        time: after the step [s].
        pressure: at the base, means between the times, over the step.
        settled: of the piston, over that of slow loading.
    """

    modulus: float
    permeability: float
    height: float
    inertia: float
    time: np.ndarray
    pressure: np.ndarray
    settled: np.ndarray

    @property
    def coefficient(self) -> float:
        """Of consolidation, c_v [m2/s]."""
        return self.modulus * self.permeability

    @property
    def ringing(self) -> float:
        """Time in which an elastic wave goes through the pack and back, 2 H/sqrt(M/rho) [s]: the theory has no
        inertia."""
        return 2.0 * self.height * float(np.sqrt(self.inertia / self.modulus))

    @property
    def measured(self) -> float:
        """c_v by the slope of ln p from 0.6 of the step down to 0.15, where one term of the series is left."""
        middle = 0.5 * (self.time[1:] + self.time[:-1])
        used = (self.pressure < 0.6) & (self.pressure > 0.15) & (middle > middle[np.argmax(self.pressure)])
        slope = np.polyfit(middle[used], np.log(self.pressure[used]), 1)[0]
        return -4.0 * self.height**2 * float(slope) / np.pi**2


def measured(pack: Pack) -> Found:
    """A pack that was loaded by half more before, so that a step of the load slides few contacts: its stiffness,
    permeability and consolidation, each from the same state.
    """
    column = Column(pack)
    guess = (pack.layers * DIAMETER) ** 2 / GUESS
    column.hold(1.5 * STRESS, guess)
    before = column.hold(STRESS, REST * guess)
    column.keep()
    height, start = column.height, STEP * STRESS
    steps = 8
    for k in range(steps):
        column.hold(STRESS + (k + 1) / steps * start, SLOW * guess / steps)
    slow = column.hold(STRESS + start, guess).displacement - before.displacement
    column.back()
    # The velocity that Ergun's law has for this drop, so that the grains hardly feel it.
    flow = FLOW * STRESS / height * GUESS / (STIFFNESS / DIAMETER)
    column.hold(STRESS, 1.4 * guess, flow)
    drop = column.hold(STRESS, 0.1 * guess, flow).pressure
    column.back()
    time, pressure, settled = [0.0], [], []
    pause = max(1, round(0.02 * guess / INTERVAL)) * INTERVAL
    while time[-1] < 1.1 * guess:
        seen = column.hold(STRESS + start, pause)
        time.append(time[-1] + pause)
        pressure.append(seen.pressure / start)
        settled.append((seen.displacement - before.displacement) / slow)
    return Found(
        modulus=start * height / slow,
        permeability=flow * height / drop,
        height=height,
        inertia=column.mass / (column.area * height),
        time=np.array(time),
        pressure=np.array(pressure),
        settled=np.array(settled),
    )


def errors(found: Found) -> tuple[float, float]:
    """Largest errors of the pressure at the base, over the step, and of the settlement, over that of the end."""
    scale = found.coefficient / found.height**2
    middle = 0.5 * (found.time[1:] + found.time[:-1])
    late = found.time[:-1] > found.ringing
    pressure = found.pressure - pressure_at_base(middle * scale)
    settled = found.settled - settlement(found.time[1:] * scale)
    return float(np.abs(pressure[late]).max()), float(np.abs(settled[late]).max())


@case(
    "consolidation under a piston",
    "moving walls",
    "K. Terzaghi 1925: series for the pressure and the settlement, c_v of stiffness and permeability measured apart",
    fast={"columns": 5, "layers": 12},
)
def consolidation(columns: int = 8, layers: int = 32) -> list[Figure]:
    """Excess pressure at the undrained base and settlement of the piston after a step of its force.

    The modulus is that of slow drained loading from the same state, the permeability that of a flow through the pack,
    so that no number is fitted. What comes before an elastic wave has gone through the pack and back is left out. All
    gates are 10 % of the whole [kernels smooth the solid fraction at the piston; contacts slide as the load grows, so
    that the pack is softer at the end of the step than on average].
    """
    found = measured(Pack(columns, layers))
    pressure, settled = errors(found)
    return [
        relative("c_v by the decay of the pressure", found.coefficient, found.measured, 0.1, "m2/s"),
        below("pressure at the base, largest error over the step", pressure, 0.1),
        below("settlement, largest error over that of the end", settled, 0.1),
    ]
