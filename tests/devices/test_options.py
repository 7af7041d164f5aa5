"""Options of a scene that other tests do not have on several devices: on two they do what they do on one."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.closures import EnsembleClosure, InvariantClosure, KochHill, SubgridClosure
from jaxdem.closures.invariant import FEATURES, WIDE
from tests.cases.fluid_slabs import ALONG_X, coupled_scene, places
from tests.cases.tiers import COMBINATION
from tests.devices.test_particles import scene_of

PROBES = [
    {"name": "plane", "kind": "plane", "axis": "x", "at": 0.1},
    {"name": "slices", "kind": "profile", "axis": "x", "cells": 4},
    {"name": "contacts", "kind": "contacts"},
    {"name": "floor", "kind": "wall", "side": "bottom"},
]


def dry(contact=(), **changes):
    """A slow gas of discs of two sizes, with further keys of `[contact]` and other tables."""
    tables = scene_of().tables()
    contact = tables["contact"] | dict(contact)
    contact = {name: value for name, value in contact.items() if value is not None}
    tables |= {"contact": contact, "probes": PROBES, "time": {"end": 0.03, "output_interval": 0.01}}
    return tables | {"output": {"energy": True}} | changes


def parcels():
    turned = {"gravity_times": [0.0, 0.02], "gravity": [[0.0, -9.81], [9.81, 0.0]]}
    tables = dry({"parcel_loss": "rate", "restitution": 0.8}, domain={"size": [0.2, 0.1], "depth": 0.02} | turned)
    half = [0.5 * radius for radius in tables["particles"]["radius"]]
    tables["particles"] |= {"coarse_grain": 2.0, "radius": half}
    return tables


def materials():
    kinds = [{"name": "hard", "work_of_adhesion": 0.02}, {"name": "soft", "young_modulus": 5e5, "friction": 0.8}]
    tables = dry(
        {"cohesion": {"kind": "dmt", "work_of_adhesion": 0.05}, "rolling_friction": 0.1},
        materials=kinds,
        material_pairs=[{"materials": ["hard", "soft"], "restitution": 0.4, "work_of_adhesion": 0.04}],
    )
    count = len(tables["particles"]["position"])
    tables["particles"] |= {"material": ["hard" if k % 3 else "soft" for k in range(count)]}
    return tables


LINEAR = {
    "law": "linear_spring_dashpot", "normal_stiffness": 1e4, "young_modulus": None,
    "cohesion": {"kind": "van_der_waals", "hamaker_constant": 1e-15, "minimum_gap": 4e-8, "cutoff": 1e-5},
}  # fmt: skip
FILM = {"cutoff": 2e-3, "roughness": 2e-5, "viscosity": 0.05, "wet_friction": 0.1, "sommerfeld_number": 1e-3}


def wet(dimension, boundary, model="A", fluid=(), particles=(), **coupling):
    """Discs or spheres that fall in a stream."""
    tables = coupled_scene(dimension, boundary, model, **coupling)
    count = 40 if dimension == 2 else 16
    velocity = np.random.default_rng(6).normal(0.0, 0.2, (count, dimension))
    tables["particles"] |= {"position": places(tables["domain"]["size"], count), "velocity": velocity.tolist()}
    tables["particles"] |= dict(particles)
    tables["fluid"] |= dict(fluid)
    return tables | {"time": {"end": 0.012, "output_interval": 0.004}}


def shared_drag():
    radius = [0.006 if k % 3 else 0.004 for k in range(40)]
    return wet(
        2, ALONG_X, "B", {"advection": "superbee", "smagorinsky": 0.15}, {"radius": radius},
        kernel_diameter="own", polydisperse=True, drag_factor=[0.5, 2.0], drag_times=[0.0, 0.01], drag="beetstra",
    )  # fmt: skip


def parcels_in_a_fluid():
    return wet(
        2, ALONG_X, "A", {"advection": "central_4"}, {"coarse_grain": 2.0, "radius": 0.003},
        own_volume="grain", drag_inputs_coarsened=2, deconvolution=0.05, kernel_width={"diameters": 0.75, "cells": 0.5},
    )  # fmt: skip


def wake():
    return wet(
        3, ALONG_X, "A", {"viscosity": 1e-3}, {"radius": 0.003},
        self_disturbance=True, basset=3, virtual_mass=0.5, lift=["saffman_mei", "magnus"], rotational_drag=True,
        drag="schiller_naumann",
    )  # fmt: skip


def through_a_channel():
    """Grains of a distribution come in with a stream whose speed changes, and leave with it."""
    sides = {
        "top": {"kind": "free_slip"},
        "left": {"kind": "inlet", "times": [0.0, 0.01], "velocities": [0.1, 0.3], "profile": "parabolic"},
        "right": {"kind": "outlet", "particles": "remove"},
    }
    sizes = {"kind": "lognormal", "median": 0.005, "log_standard_deviation": 0.2, "lower": 0.004, "upper": 0.006}
    inlet = {
        "region": {"shape": "polygon", "vertices": [[0.1, 0.02], [0.3, 0.02], [0.2, 0.18]]}, "times": [0.0, 0.01],
        "mass_flow": [0.0, 2.0], "velocity": [0.3, 0.0], "distribution": sizes,
    }  # fmt: skip
    tables = wet(2, sides, "A", {"bed_mixing": {}}, {"inlet": [inlet]}, void_fraction="divided")
    tables["particles"]["velocity"] = [[4.0 if x > 0.37 else v, w] for (x, _), (v, w) in zip(
        tables["particles"]["position"], tables["particles"]["velocity"], strict=True
    )]  # fmt: skip
    tables["contact"]["young_modulus"] = 2e7
    return tables


def guessed(closure):
    """The closure with random weights."""
    draw = np.random.default_rng(4)
    return jax.tree.map(lambda x: jnp.asarray(x + 0.2 * draw.normal(size=np.shape(x))), closure)


@functools.cache
def ensemble():
    first = InvariantClosure.initial(KochHill(), hidden=(4,), features=(*FEATURES, WIDE))
    return EnsembleClosure.of([guessed(first), guessed(guessed(first))])


OPTIONS = {
    "jkr": lambda: (dry({"cohesion": {"kind": "jkr", "work_of_adhesion": 0.05}}), {}),
    "van der Waals, linear law": lambda: (dry(LINEAR), {}),
    "dmt, materials": lambda: (materials(), {}),
    "parcels, gravity in time": lambda: (parcels(), {}),
    "film that wets friction": lambda: (dry({"lubrication": FILM}), {}),
    "sizes share a drag that changes, model B": lambda: (shared_drag(), {}),
    "parcels on a coarser mesh": lambda: (parcels_in_a_fluid(), {}),
    "wake, all forces, 3-D": lambda: (wake(), {}),
    "stream with inlets in time": lambda: (through_a_channel(), {}),
    "learned drag and stress": lambda: (
        wet(2, ALONG_X),
        {"closure": ensemble(), "subgrid": SubgridClosure.constant(0.02, 0.05, hidden=())},
    ),
}


OWN = {
    "device", "devices", "machine", "versions", "wall_time_s", "run_time_s", "stages_s", "estimated", "residuals",
    "neighbor_builds", "neighbor_slots", "pair_slots", "neighbor_resizes",
}  # fmt: skip
"""Of the summary, what is of a machine, of its lists, of rounding, or of several devices."""


ROUNDING = 1e-14
"""Of what is zero but for it, such as the mean pressure of a box that is closed."""


def numbers_of(value):
    """All that are finite in nested tables and lists."""
    if isinstance(value, dict | list):
        parts = value.values() if isinstance(value, dict) else value
        return [number for part in parts for number in numbers_of(part)]
    return [value] if isinstance(value, float) and np.isfinite(value) else []


def require_same(one, other, atol, place=""):
    """Nested tables and lists, their numbers within so much."""
    if isinstance(one, dict):
        assert one.keys() - OWN == other.keys() - OWN, place
        for name in one.keys() - OWN:
            require_same(one[name], other[name], atol, f"{place}.{name}")
    elif isinstance(one, list):
        assert len(one) == len(other), place
        for number, pair in enumerate(zip(one, other, strict=True)):
            require_same(*pair, atol, f"{place}.{number}")
    elif numbers_of(one) and numbers_of(other):
        assert abs(one - other) <= atol, f"{place}: {one} {other}"
    else:
        assert one == other, f"{place}: {one} {other}"


def require_same_columns(one, other, tolerance):
    """Columns of two tables or arrays of two frames, each within so much of its largest value."""
    assert list(one) == list(other)
    for name, expected in one.items():
        expected, found = np.asarray(expected, float), np.asarray(other[name], float)
        assert expected.shape == found.shape, name
        np.testing.assert_array_equal(np.isnan(expected), np.isnan(found), err_msg=name)
        off = np.abs(np.nan_to_num(expected - found)).max(initial=0.0)
        assert off <= tolerance * np.nanmax(np.abs(expected), initial=0.0) + ROUNDING, name


@COMBINATION
@pytest.mark.parametrize("name", OPTIONS)
def test_an_option_does_what_it_does_on_one_device(name, tmp_path):
    """Frames, history, probes and summary of a run, but for what is of a machine."""
    tables, own = OPTIONS[name]()
    scene = jaxdem.load_scene(tables)
    one = jaxdem.simulate(scene, tmp_path / "one", **own)
    two = jaxdem.simulate(scene, tmp_path / "two", devices=2, **own)
    assert min(two.summary["devices"]["particles"]) > 3
    assert one.has_fluid or np.abs(one.history["collision_force_mean"]).max() > 0.0
    expected, found = one.particles(-1), two.particles(-1)
    there = expected.get("active", np.ones(len(expected["position"]))) == 1
    np.testing.assert_array_equal(there, found.get("active", np.ones(len(there))) == 1)
    require_same_columns(*({name: x[there] for name, x in frame.items()} for frame in (expected, found)), 1e-9)
    if "removed" in one.history:
        assert one.history["removed"][-1] > 0 and sum(one.summary["inlets"]["inserted"]) > 0
    if one.has_fluid:
        require_same_columns(one.fluid(-1), two.fluid(-1), 1e-9)
    require_same_columns(one.history, two.history, 1e-8)
    for probe in one.probes:
        require_same_columns(one.probes[probe], two.probes[probe], 1e-8)
    assert one.summary.keys() - OWN == two.summary.keys() - OWN
    unknown = OWN if scene.output.energy else OWN | {"energy"}  # of springs slabs know it with this option alone
    for entry in one.summary.keys() - unknown:
        expected, found = one.summary[entry], two.summary[entry]
        require_same(expected, found, 1e-8 * max(map(abs, numbers_of(expected)), default=0.0), entry)
