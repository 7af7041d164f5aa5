"""The balance of energy of clumps and bonded grains, and with what comes, goes or acts from outside: walls, a piston,
grains that enter and leave, the fluid. Every scene is a closed box of a few bodies as in `energy`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.cases.clumps import BENT
from tests.cases.energy import BOX, MASS, OPTIONS, RADIUS, SHAKE, balance_of, figures_of, in_space, tilted, with_tables
from tests.cases.registry import Figure, at_least, below, case

PLANE_ROD = {"name": "rod", "centres": [[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0]], "radii": [1.0, 1.0, 1.0]}

RODS = with_tables(
    BOX,
    particles={
        "radius": 1.5 * RADIUS, "shape": "rod", "shapes": [PLANE_ROD],
        "position": [[0.005, 0.004], [0.0115, 0.0045], [0.0085, 0.009], [0.015, 0.005]],
        "velocity": [[0.2, -0.3], [-0.2, -0.3], [0.0, -0.5], [-0.3, -0.1]],
        "orientation": [0.3, -0.7, 1.2, 1.5],
    },
)  # fmt: skip
"""Rods that meet each other, the floor and a side."""

BENT_BODIES: dict[str, Any] = with_tables(
    BOX,
    domain={"size": [0.02, 0.02, 0.02]},
    particles={
        "radius": 1.5 * RADIUS, "shape": "bent", "shapes": [BENT],
        "position": [[0.006, 0.01, 0.004], [0.011, 0.0105, 0.0045], [0.0085, 0.0095, 0.009]],
        "velocity": [[0.2, 0.0, -0.3], [-0.2, 0.05, -0.3], [0.0, 0.0, -0.5]],
        "angular_velocity": [[60.0, 30.0, -40.0], [0.0, 20.0, -5.0], [30.0, 0.0, 80.0]],
        "orientation": [[0.6, 0.0, 0.8, 0.0], [0.5, 0.5, -0.5, 0.5], [1.0, 0.0, 0.0, 0.0]],
    },
)  # fmt: skip
"""Bodies with three different moments."""

BEAM: dict[str, Any] = with_tables(
    BOX,
    particles={
        "radius": RADIUS,
        "position": [[0.004 + 2.02e-3 * k, 0.004 + 1e-3 * k] for k in range(4)] + [[0.012, 0.0125]],
        "velocity": [[0.0, -0.3]] * 4 + [[-0.2, -0.6]],
        "angular_velocity": [[0.0], [10.0], [0.0], [0.0], [0.0]],
    },
    bonds=[{"gap": 3e-4, "normal_stiffness": 2e8, "shear_stiffness": 1e8, "damping": 0.1}],
)  # fmt: skip
"""Four bonded grains that fall on the floor, and a fifth that hits them."""

WEAK = with_tables(BEAM, bonds=[BEAM["bonds"][0] | {"tensile_strength": 1e4, "shear_strength": 2e4}])

FILM = {"cutoff": 2e-4, "roughness": 2e-6, "viscosity": 2e-3}

MESH = {"kind": "mesh", "points": [[0.001, 0.002], [0.01, 0.0005], [0.019, 0.002]]}

ABOVE_MESH = {"position": [[x, y + 1.3e-3] for x, y in BOX["particles"]["position"]]}

CONCAVE = {
    "kind": "mesh",
    "file": str(Path(__file__).parents[1] / "data" / "concave_edge.obj"),
    "translate": [0.0, 0.0, -9.5e-4],
}
"""Four triangles, two planes that meet in an edge."""

FLOOR = {"kind": "plane", "point": [0.0, 0.001], "normal": [0.1, 1.0]}

COMES = [{"kind": "oscillation", "amplitude": 1e-3, "frequency": 120.0, "direction": [-1.0, 0.3]}]
"""It meets a rod that goes away from it."""

BODIES: dict[str, dict[str, Any]] = {
    "rods": RODS,
    "rods, rolling, DMT and a plane that comes": with_tables(
        RODS, contact={"rolling_friction": 0.1, "cohesion": {"kind": "dmt", "work_of_adhesion": 0.02}},
        walls=[tilted(motion=COMES, point=[0.0156, 0.0])],
    ),
    "bodies in space": BENT_BODIES,
    "bonds that hold": BEAM,
    "bonds that break": WEAK,
    "bonds in space, rolling": in_space(with_tables(WEAK, contact={"rolling_friction": 0.1})),
    "lubrication": with_tables(BOX, contact={"lubrication": FILM}),
    "a mesh": with_tables(BOX, particles=ABOVE_MESH, walls=[MESH]),
    "rods on a mesh": with_tables(RODS, walls=[MESH]),
    "bonds that hold, on planes that oscillate": with_tables(
        BEAM, walls=[tilted(motion=SHAKE), FLOOR | {"motion": SHAKE}]
    ),
    "spheres on a mesh in space": in_space(with_tables(BOX, walls=[CONCAVE])),
    "rods on a mesh, JKR": with_tables(RODS, walls=[MESH], **OPTIONS["JKR"]),
    "liquid bridges to a mesh in space": in_space(with_tables(BOX, walls=[CONCAVE], **OPTIONS["liquid bridges"])),
    "rods and a plane that comes and goes": with_tables(
        RODS, walls=[FLOOR | {"begin": 1e-3, "end": 6e-3}], coupling={"interval": 1e-3}
    ),
}  # fmt: skip


def gate(**changes: Any) -> dict[str, Any]:
    """A ball that hits a gate, which goes while the ball presses on it most."""
    leaves = {"kind": "plane", "point": [0.0, 0.01], "normal": [0.0, 1.0], "end": 1e-3}
    return with_tables(
        BOX,
        domain={"size": [0.02, 0.02], "gravity": [0.0, 0.0]},
        particles={"position": [[0.01, 0.01 + RADIUS + 5e-5]], "velocity": [[0.05, -0.1]],
                   "angular_velocity": [[0.0]]},
        contact={"young_modulus": 1e6, "restitution": 0.9, "friction": 0.3, "time_step": 2e-7},
        walls=[leaves],
        time={"end": 2e-3, "output_interval": 1e-3},
        **changes,
    )  # fmt: skip


def lid() -> dict[str, Any]:
    """Grains under a lid that its weight presses down."""
    piston = {"direction": [0.0, -1.0], "force": 0.01, "mass": 1e-4, "damping": 0.01}
    return with_tables(BOX, walls=[{"kind": "plane", "point": [0.0, 0.0055], "normal": [0.0, -1.0], "piston": piston}])


def through() -> dict[str, Any]:
    """Grains that come in from above and leave through the right side, some of them while they touch others."""
    return with_tables(
        BOX,
        particles={
            "count": 10, "radius": RADIUS, "density": 2500.0,
            "pack": {"kind": "random", "start": [0.002, 0.002], "stop": [0.02, 0.008]},
            "inlet": [{"side": "top", "rate": 400.0, "velocity": 0.4}],
            "position": None, "velocity": None, "angular_velocity": None,
        },
        boundary={"right": {"particles": "remove"}},
        coupling={"interval": 1e-3},
        domain={"size": [0.02, 0.02], "gravity": [8.0, -9.81]},
        contact={"time_step": 2e-6},
        time={"end": 0.03, "output_interval": 0.01},
    )  # fmt: skip


@case("energy: clumps, bonds, lubrication, meshes", "contact", "conservation", tested=False)
def bodies() -> list[Figure]:
    """Each in a closed box."""
    figures = [one for name, tables in BODIES.items() for one in figures_of(name, tables)]
    broken = balance_of(WEAK)
    lost = broken["dissipated"]["breaking"] / broken["start"]["translation"]
    return [*figures, at_least("energy that goes with bonds that break, over the kinetic one", 1e-4, lost)]


@case("energy: a gate that goes, a lid, grains that come and go", "contact", "conservation", tested=False)
def from_outside() -> list[Figure]:
    """What walls and grains take with them is told; without it the balance would not close."""
    figures = []
    for name, tables, part, least in (
        ("a gate that goes", gate(), "wall_changes", 0.3),
        ("a lid on a spring", lid(), "walls", 1e-3),
        ("grains that come and go", through(), "population", 1e-2),
    ):
        found = balance_of(tables)
        figures += [below(f"{name}: energy that no part explains", found["gained_relative"], 1e-6),
                    at_least(f"{name}: {part}, over what was turned over", least,
                             abs(found["work"][part]) / abs(found["gained"] / found["gained_relative"]))]  # fmt: skip
    pressed = -balance_of(gate())["work"]["wall_changes"] / (0.5 * MASS * 0.1**2)
    return [*figures, below("what a gate takes from a ball, over its energy towards it, less 0.9", pressed - 0.9, 0.1)]
