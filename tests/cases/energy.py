"""The balance of energy: closed boxes with each option, and single impacts whose losses have a closed form.

The energy of a closed box may differ from the sum of what was stored, worked and dissipated by the error of the contact
step in the springs alone, which falls with its square; what the sum of all parts leaves is rounding.
"""

from __future__ import annotations

import copy
import math
from typing import Any

import jax

import jaxdem
from jaxdem.particle_step import stored as stored_in_particles
from jaxdem.run.parts.energy import balance
from tests.cases.cohesion import work_lost
from tests.cases.registry import Figure, below, case, relative

RADIUS, DENSITY = 1e-3, 2500.0
MASS = DENSITY * 4.0 / 3.0 * math.pi * RADIUS**3

BOX: dict[str, Any] = {
    "precision": "float64",
    "domain": {"size": [0.02, 0.02]},
    "particles": {
        "radius": RADIUS, "density": DENSITY,
        "position": [[0.005, 0.00105], [0.0071, 0.00105], [0.0061, 0.0029], [0.012, 0.004]],
        "velocity": [[0.1, 0.0], [0.0, 0.0], [0.0, -0.1], [-0.3, -0.1]],
        "angular_velocity": [[20.0], [0.0], [-5.0], [0.0]],
    },
    "contact": {"young_modulus": 1e6, "restitution": 0.5, "friction": 0.4, "speed": 0.5, "time_step": 4e-7},
    "time": {"end": 0.01, "output_interval": 0.01},
    "output": {"energy": True},
}  # fmt: skip


def with_tables(base: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """The tables with these keys of some tables."""
    tables = copy.deepcopy(base)
    for key, value in changes.items():
        tables[key] = {**tables.get(key, {}), **value} if isinstance(value, dict) else value
    return tables


def in_space(base: dict[str, Any]) -> dict[str, Any]:
    """The same grains in a box with a third axis."""
    tables, grains = copy.deepcopy(base), base["particles"]
    tables["domain"] = {"size": [0.02, 0.02, 0.02]}
    for key, across in (("position", 0.01), ("velocity", 0.03)):
        tables["particles"][key] = [[x, across + 3e-4 * k, z] for k, (x, z) in enumerate(grains[key])]
    tables["particles"]["angular_velocity"] = [[3.0 * k, w, 2.0] for k, (w,) in enumerate(grains["angular_velocity"])]
    return tables


def balance_of(tables: dict[str, Any], **extensions: Any) -> dict[str, Any]:
    """The balance of a scene, see `jaxdem.run.parts.energy.balance`, with the energies at the start and end, and the
    states after every interval."""
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene, **extensions)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    steps = simulation.steps.intervals_per_output * simulation.steps.outputs
    stored = jax.jit(
        lambda state, listed: stored_in_particles(simulation, parameters, state.particles, listed, state.step)
    )

    @jax.jit
    def advance(state: Any, neighbors: Any) -> Any:
        state, neighbors, report = simulation.step(parameters, state, neighbors)
        return state, neighbors, report.particles.energy

    start, total, states = stored(state, neighbors), None, []
    for _ in range(steps):
        state, neighbors, flow = advance(state, neighbors)
        states.append(state)
        flow = {name: float(value) for name, value in flow._asdict().items()}
        total = flow if total is None else {name: total[name] + value for name, value in flow.items()}
    first, last = ({k: float(v) for k, v in x._asdict().items()} for x in (start, stored(state, neighbors)))
    return balance(first, last, total) | {"start": first, "end": last, "state": state, "states": states}


def tilted(**keys: Any) -> dict[str, Any]:
    """A plane wall that some of the grains meet."""
    return {"kind": "plane", "point": [0.0135, 0.0], "normal": [-1.0, 0.2], **keys}


SHAKE = [{"kind": "oscillation", "amplitude": 2e-4, "frequency": 120.0, "direction": [1.0, 0.3]}]

OPTIONS: dict[str, dict[str, Any]] = {
    "Hertz with friction": {},
    "smooth and elastic": {"contact": {"friction": 0.0, "restitution": 1.0}},
    "linear law": {"contact": {"law": "linear_spring_dashpot", "normal_stiffness": 500.0}},
    "rolling, cdt": {"contact": {"rolling_friction": 0.1}},
    "rolling, epsd": {"contact": {"rolling_friction": 0.1, "rolling_model": "epsd"}},
    "JKR": {"contact": {"cohesion": {"kind": "jkr", "work_of_adhesion": 0.05}}},
    "DMT": {"contact": {"cohesion": {"kind": "dmt", "work_of_adhesion": 0.05}}},
    "van der Waals": {"contact": {"cohesion": {"kind": "van_der_waals", "hamaker_constant": 1e-15,
                                               "minimum_gap": 1e-7, "cutoff": 1e-5}}},
    "liquid bridges": {"contact": {"cohesion": {"kind": "capillary", "surface_tension": 0.07, "liquid_content": 0.01,
                                                "liquid_viscosity": 1e-3, "minimum_gap": 1e-5}}},
    "SJKR": {"contact": {"cohesion": {"kind": "sjkr", "energy_density": 1e4}}},
    "plane at rest": {"walls": [tilted()]},
    "plane that oscillates": {"walls": [tilted(motion=SHAKE)]},
    "two sizes": {"particles": {"radius": [1e-3, 1e-3, 6e-4, 1.2e-3]}},
}  # fmt: skip


def figures_of(name: str, tables: dict[str, Any], gate: float = 1e-6) -> list[Figure]:
    """Both figures of a closed box."""
    found = balance_of(tables)
    turned_over = found["gained"] / found["gained_relative"]
    return [
        below(f"{name}: energy that no part explains, over that turned over", found["gained_relative"], gate),
        below(f"{name}: the same without the error of the step", found["missing"] / turned_over, 1e-11),
    ]


@case("energy: closed boxes with each option", "contact", "conservation", tested=False)
def closed_boxes() -> list[Figure]:
    """Every option in turn, in the plane; all of the plain ones at once in space."""
    figures = [one for name, changes in OPTIONS.items() for one in figures_of(name, with_tables(BOX, **changes))]
    together = {"contact": {"rolling_friction": 0.1, "rolling_model": "epsd"}}
    return figures + figures_of("in space, rolling, epsd", in_space(with_tables(BOX, **together)))


def ball_on_wall(speed: tuple[float, float], **contact: Any) -> dict[str, Any]:
    """A ball that meets the bottom once, without gravity."""
    return with_tables(
        BOX,
        domain={"size": [0.02, 0.02], "gravity": [0.0, 0.0]},
        particles={"position": [[0.01, RADIUS + 1e-5]], "velocity": [[speed[0], -speed[1]]],
                   "angular_velocity": [[0.0]]},
        contact={"young_modulus": 1e7, "time_step": 2e-7, **contact},
        time={"end": 2e-3, "output_interval": 1e-3},
    )  # fmt: skip


@case("energy: what an impact takes", "contact", "rigid bodies, m (1 - e^2) v^2 / 2; loop of JKR", tested=True)
def impacts() -> list[Figure]:
    """Dashpot, friction that slides throughout, and the pull-off of JKR, each by itself."""
    e, mu, v, u = 0.6, 0.2, 0.2, 1.0
    found = balance_of(ball_on_wall((u, v), restitution=e, friction=mu))
    normal = 0.5 * MASS * (1.0 - e**2) * v**2
    # Of friction: the impulse mu (1 + e) m v on the slip, which falls by 7/2 of it over the mass.
    impulse = mu * (1.0 + e) * MASS * v
    across = impulse * (u - 0.5 * 3.5 * impulse / MASS)
    lost = found["dissipated"]
    sticks = {"cohesion": {"kind": "jkr", "work_of_adhesion": 0.1}, "restitution": 1.0, "friction": 0.0}
    pair = with_tables(
        ball_on_wall((0.0, 0.0), **sticks),
        particles={"position": [[0.006, 0.01], [0.00801, 0.01]], "velocity": [[0.1, 0.0], [-0.1, 0.0]],
                   "angular_velocity": [[0.0], [0.0]]},
    )  # fmt: skip
    return [
        relative("dashpot", normal, lost["damping"], 2e-3, "J"),
        relative("friction and its dashpot", across, lost["sliding"] + lost["tangential_damping"], 1e-2, "J"),
        relative("JKR", work_lost(), balance_of(pair)["dissipated"]["adhesion"], 1e-4, "J"),
    ]


@case("energy: a wall that pushes", "contact", "m (1 + e) u^2", tested=True)
def pushed() -> list[Figure]:
    """A wall at a steady speed u meets a ball at rest, which leaves it at (1 + e) u."""
    e, u = 0.5, 0.2
    moves = [{"kind": "translation", "velocity": [0.0, u]}]
    tables = with_tables(
        ball_on_wall((0.0, 0.0), restitution=e, friction=0.0),
        particles={"position": [[0.01, 0.005]], "velocity": [[0.0, 0.0]]},
        walls=[{"kind": "plane", "point": [0.0, 0.0039], "normal": [0.0, 1.0], "motion": moves}],
    )
    found = balance_of(tables)
    return [
        relative("work of the wall", MASS * (1.0 + e) * u**2, found["work"]["walls"], 1e-3, "J"),
        relative("energy of the ball", 0.5 * MASS * (1.0 + e) ** 2 * u**2, found["end"]["translation"], 1e-3, "J"),
        below("energy that no part explains", found["gained_relative"], 1e-6),
    ]
