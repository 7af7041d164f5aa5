"""Bonds in scenes: what is refused, gradients, precision, periodic sides, grains that leave, resuming, later stages.

Forces, beams and strength against closed forms are cases: `tests/cases/bonds.py`.
"""

from __future__ import annotations

import copy
import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.check.check import check_scene
from jaxdem.errors import InputError
from jaxdem.particles.bond_state import INTACT, LEFT, TENSION, BondState
from jaxdem.particles.bonds import bond_loads
from jaxdem.setup.contact_step import contact_step
from jaxdem.setup.particles import particle_setup
from tests.cases import bonds as cases
from tests.cases.tiers import COMBINATION

RADIUS, SPACING = cases.RADIUS, cases.SPACING
BOND = {"gap": 0.05 * RADIUS, "normal_stiffness": 1e9, "shear_stiffness": 4e8, "damping": 0.2}


def square(columns=3, rows=3, at=(0.05, 0.05), jitter=0.0):
    """Rows of grains that are bonded to a lattice."""
    noise = np.random.default_rng(0).uniform(-jitter, jitter, (rows * columns, 2))
    places = [[at[0] + k * SPACING, at[1] + j * SPACING] for j in range(rows) for k in range(columns)]
    return (np.asarray(places) + noise).tolist()


def tables_of(**changes):
    tables = {
        "precision": "float64",
        "domain": {"size": [0.15, 0.15], "gravity": [0.0, -9.81]},
        "particles": {"position": square(), "radius": RADIUS, "density": 2500.0},
        "contact": {"young_modulus": 1e7, "speed": 1.0, "friction": 0.3},
        "bonds": [BOND],
        "time": {"end": 0.02, "output_interval": 0.01},
    }
    for key, value in changes.items():
        tables[key] = {**tables[key], **value} if isinstance(value, dict) and key in tables else value
    return copy.deepcopy(tables)


def first(scene):
    simulation, parameters = jaxdem.build(scene)
    return simulation, parameters, *jaxdem.initial_state(scene, simulation, parameters)


WRONG = {
    "no way to find them": ({"gap": None}, {}, "bonds.0.gap", "neither"),
    "both ways": ({"pairs": [[0, 1]]}, {}, "bonds.0.gap", "both"),
    "nobody near": ({"gap": 1e-6}, {}, "bonds.0.gap", "the closest are 0.0001 m apart"),
    "across others": ({"gap": 1.1 * RADIUS}, {}, "bonds.0.gap", "across others"),
    "an empty region": ({"region": {"shape": "sphere", "center": [0.12, 0.12], "radius": 0.01}}, {}, "bonds.0.gap",
                        "0 grains"),
    "a region of a list": ({"gap": None, "pairs": [[0, 1]], "region": {"shape": "sphere", "center": [0.1, 0.1],
                            "radius": 0.01}}, {}, "bonds.0.region", "found by gap"),
    "a grain that there is not": ({"gap": None, "pairs": [[0, 1], [3, 9]]}, {}, "bonds.0.pairs", "from 0 to 8"),
    "a grain and itself": ({"gap": None, "pairs": [[4, 4]]}, {}, "bonds.0.pairs", "itself"),
    "far apart": ({"gap": None, "pairs": [[0, 2]]}, {}, "bonds.0.pairs", "lies apart"),
    "a pair twice": ({"gap": None, "pairs": [[0, 1], [1, 0]]}, {}, "bonds.0", "twice"),
    "a missing file": ({"gap": None, "pairs": "nowhere.csv"}, {}, "bonds.0.pairs", "no such file"),
    "no stiffness": ({"normal_stiffness": None}, {}, "bonds.0.normal_stiffness", "missing"),
    "parcels": ({}, {"particles": {"position": square(), "radius": RADIUS, "density": 2500.0, "coarse_grain": 1.5}},
                "particles.coarse_grain", "[[bonds]]"),
    "a pack that settles": ({}, {"particles": {"radius": RADIUS, "density": 2500.0, "count": 9,
                                               "pack": {"kind": "settled", "start": [0.0, 0.0],
                                               "stop": [0.15, 0.1]}}}, "particles.pack.kind", "settle"),
    "two tables for a pair": ({}, {"bonds": [BOND, BOND | {"gap": None, "pairs": [[0, 1]]}]}, "bonds.1", "already"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_work_is_refused(name):
    own, changes, key, words = WRONG[name]
    bond = {name: value for name, value in (BOND | own).items() if value is not None}
    tables = {**tables_of(bonds=[bond]), **changes}
    for one in tables["bonds"]:
        for empty in [k for k, v in one.items() if v is None]:
            del one[empty]
    with pytest.raises(InputError) as found:
        jaxdem.build(jaxdem.load_scene(tables))
    assert found.value.key == key
    assert words in str(found.value)


def test_bonds_are_found_by_gap_in_a_region_and_in_a_file(tmp_path):
    """A square lattice of three by three has twelve neighbours; its lower two rows seven."""

    def pairs(tables):
        found = particle_setup(jaxdem.load_scene(tables)).bonds
        return sorted(zip(found.first.tolist(), found.second.tolist(), strict=True))

    whole = pairs(tables_of())
    right, up = [(k, k + 1) for k in range(9) if k % 3 < 2], [(k, k + 3) for k in range(6)]
    assert whole == sorted(right + up)
    low = {"region": {"shape": "box", "start": [0.0, 0.0], "stop": [0.15, 0.05 + 1.5 * SPACING]}}
    assert len(pairs(tables_of(bonds=[BOND | low]))) == 7
    file = tmp_path / "pairs.csv"
    file.write_text("first,second\n" + "\n".join(f"{b},{a}" for a, b in whole))
    listed = {key: value for key, value in BOND.items() if key != "gap"} | {"pairs": str(file)}
    assert pairs(tables_of(bonds=[listed])) == whole
    file.write_text("first,second\n0,1.5\n")
    with pytest.raises(InputError, match="whole numbers"):
        pairs(tables_of(bonds=[listed]))


def test_grains_that_do_not_turn_with_the_body_strain_its_bonds(monkeypatch):
    """The negative control of the case of a pair that goes round: its bond is sheared at once."""
    of = cases.strand(2)
    kept = cases.spun(of, 0.01)
    monkeypatch.setattr(BondState, "turned", lambda self, spin, time_step: self)
    cases.pushed.clear_cache()
    try:
        held = cases.spun(of, 0.01)
    finally:
        cases.pushed.clear_cache()
    assert kept[2] < 4e-4
    assert abs(held[2]) > 100.0


@COMBINATION
def test_slope_of_the_deflection_by_the_stiffness():
    """A cantilever of two grains: backwards and forwards through the steps, by differences, and the closed form."""
    of, free = cases.strand(3, 2), 2
    load = 1e-6 * cases.NORMAL * cases.AREA * SPACING
    rate = cases.first_frequency(free)
    force = jnp.zeros((3, 2)).at[2, 1].set(-load)
    numbers = tuple(jnp.asarray(x) for x in (cases.time_step(of), 1.7 * rate, 0.0))
    calls = int(25.0 / rate / cases.time_step(of) / 4.0)

    def sunk(factor):
        bonds = of.parameters.bonds
        parameters = of.parameters._replace(bonds=bonds._replace(normal_stiffness=factor * bonds.normal_stiffness))
        given = (of.particles, of.neighbors), (force, jnp.zeros((3, 1))), numbers
        end = cases.pushed(of.simulation, parameters, *given, calls, 4, reversible=True)
        return of.particles.position[2, 1] - end.position[-1, 2, 1]

    one = jnp.asarray(1.0)
    value, slope = jax.jit(jax.value_and_grad(sunk))(one)
    h = 1e-4
    difference = (sunk(one + h) - sunk(one - h)) / (2.0 * h)
    levers = (np.arange(free) + 0.5) * SPACING
    exact = -load * float(np.sum(levers**2)) / (cases.NORMAL * cases.INERTIA)
    assert abs(float(value) / cases.deflection(free, load)[1] - 1.0) < 1e-4
    assert abs(float(slope) / float(difference) - 1.0) < 1e-5
    assert abs(float(slope) / exact - 1.0) < 1e-3


def test_slope_of_the_stress_before_the_first_break():
    """k_n (u_n + R b) of a bond that is bent by b, u_n = L (1 - cos(angle/2)): its slopes by the stiffness and by the
    radius of the bond."""
    of, angle = cases.strand(2), 1e-3
    half = [math.cos(0.25 * angle), 0.0, 0.0, math.sin(0.25 * angle)]
    turned = tuple(jnp.asarray([q if k == 0 else -q, q]) for k, q in enumerate(half))
    particles = of.particles._replace(bonds=of.particles.bonds._replace(orientation=turned))

    def stress(stiffness, factor):
        bonds = of.parameters.bonds._replace(normal_stiffness=stiffness[None], radius_factor=factor[None])
        loads = bond_loads(of.simulation.contact.model.bonds, bonds, of.parameters.bodies, particles)
        return loads.tensile_stress[0]

    bending = cases.NORMAL * RADIUS * 2.0 * math.sin(0.5 * angle)
    exact = bending + cases.NORMAL * SPACING * (1.0 - math.cos(0.5 * angle))
    value, slopes = jax.jit(jax.value_and_grad(stress, (0, 1)))(jnp.asarray(cases.NORMAL), jnp.asarray(1.0))
    assert float(value) == pytest.approx(exact, rel=1e-8)
    assert float(slopes[0]) == pytest.approx(exact / cases.NORMAL, rel=1e-8)
    assert float(slopes[1]) == pytest.approx(bending, rel=1e-8)


@COMBINATION
def test_a_bonded_pair_sinks_in_a_fluid_as_one():
    """A heavy and a light grain, side by side: without the bond the heavy one is ahead."""
    apart = []
    for bonded in (True, False):
        tables = tables_of(
            particles={"position": square(2, 1, at=(0.07, 0.1)), "density": [4000.0, 1500.0]},
            fluid={"cells": [5, 5], "density": 1000.0, "viscosity": 1e-4},
            boundary={"top": {"kind": "outlet"}},
            time={"end": 0.02, "output_interval": 0.01},
        )
        if not bonded:
            del tables["bonds"]
        simulation, parameters, state, neighbors = first(jaxdem.load_scene(tables))
        step = jax.jit(lambda s, n, sim=simulation, p=parameters: sim.step(p, s, n)[:2])
        for _ in range(math.ceil(0.02 / simulation.interval)):
            state, neighbors = step(state, neighbors)
        position = np.asarray(state.particles.position)
        apart.append(abs(float(np.linalg.norm(position[0] - position[1])) / SPACING - 1.0))
        assert (position[:, 1] < 0.1 - 1e-5).all()
    assert apart[0] < 1e-4 < apart[1]


@COMBINATION
def test_single_precision_bends_as_far():
    """A cantilever that sinks by a thousandth of a diameter: the strains are 1e-4 and less."""
    sunk = []
    for precision in ("float64", "float32"):
        of = cases.strand(5, 2, precision)
        load, rate = 1e-6 * cases.NORMAL * cases.AREA * SPACING, cases.first_frequency(4)
        calls = int(14.0 / rate / cases.time_step(of) / 10.0)
        found = cases.push(of, [0.0, -load], slowing=1.7 * rate, calls=calls, steps=10).particles
        low = 0.0 if found.position_low is None else np.asarray(found.position_low[-1, 1], float)
        sunk.append(float(of.particles.position[-1, 1]) - float(found.position[-1, 1]) - low)
    assert abs(sunk[1] / sunk[0] - 1.0) < 1e-3


@pytest.fixture(scope="module")
def lattice():
    """A bonded lattice that falls to the floor, in one program with others of its shape."""
    scene = jaxdem.load_scene(tables_of(bonds=[BOND | {"tensile_strength": 1e9}]))
    simulation, parameters, state, neighbors = first(scene)
    step = jax.jit(lambda parameters, state, neighbors: simulation.step(parameters, state, neighbors))
    return simulation, parameters, state, neighbors, step


def run(lattice, parameters, state, neighbors, count):
    for _ in range(count):
        state, neighbors, _ = lattice[4](parameters, state, neighbors)
    return state, neighbors


def test_a_bonded_body_falls_as_one_and_a_weak_one_breaks(lattice):
    """In free fall nothing is strained; with a strength below what the impact asks for bonds break, and stay so."""
    simulation, parameters, state, neighbors, _ = lattice
    fallen, _ = run(lattice, parameters, state, neighbors, 2)
    drop = 0.5 * 9.81 * (2 * simulation.interval) ** 2
    moved = np.asarray(fallen.particles.position - state.particles.position)
    assert np.abs(moved - [0.0, -drop]).max() < 1e-6 * drop + 1e-15
    thrown = state._replace(particles=state.particles._replace(velocity=jnp.full((9, 2), -3.0).at[:, 0].set(0.0)))
    whole, _ = run(lattice, parameters, thrown, neighbors, 4)
    assert bool(whole.particles.bonds.intact[:-1].all())
    weak = parameters._replace(bonds=parameters.bonds._replace(tensile_strength=jnp.asarray([1e4])))
    broken, listed = run(lattice, weak, thrown, neighbors, 4)
    status = np.asarray(broken.particles.bonds.status[:-1])
    assert (status == TENSION).any()
    later, _ = run(lattice, parameters, broken, listed, 2)  # a strength that would hold does not mend them
    assert (np.asarray(later.particles.bonds.status[:-1])[status != INTACT] == status[status != INTACT]).all()


@COMBINATION
def test_bonds_across_periodic_sides(lattice):
    """The same lattice in the middle and across a corner vibrates alike."""
    sides = {side: {"kind": "periodic"} for side in ("left", "right", "bottom", "top")}
    found = []
    for at in ((0.05, 0.05), (-0.5 * SPACING, 0.15 - 1.5 * SPACING)):
        places = (np.asarray(square(at=at)) % 0.15).tolist()
        tables = tables_of(particles={"position": places}, boundary=sides, domain={"gravity": [0.0, 0.0]})
        simulation, parameters, state, neighbors = first(jaxdem.load_scene(tables))
        noise = np.random.default_rng(2).normal(0.0, 0.05, (9, 2))
        state = state._replace(particles=state.particles._replace(velocity=jnp.asarray(noise)))
        state, _, _ = jax.jit(lambda s, n, sim=simulation, p=parameters: sim.step(p, s, n))(state, neighbors)
        found.append(np.asarray(state.particles.velocity))
        assert len(particle_setup(jaxdem.load_scene(tables)).bonds.first) == 12
    assert np.abs(found[0] - found[1]).max() < 1e-11
    assert np.abs(found[0] - noise).max() > 1e-3


def test_a_grain_that_leaves_breaks_its_bonds():
    """The right column of a lattice crosses an exit: the bonds of its three grains are gone, not broken."""
    tables = tables_of(
        boundary={"right": {"particles": "remove"}},
        domain={"gravity": [0.0, 0.0]},
        particles={"position": square(at=(0.15 - 3.0 * SPACING, 0.05)), "velocity": [[2.0, 0.0]] * 9},
    )
    scene = jaxdem.load_scene(tables)
    simulation, parameters, state, neighbors = first(scene)
    step = jax.jit(lambda s, n: simulation.step(parameters, s, n))
    while state.particles.active.all():
        state, neighbors, _ = step(state, neighbors)
    gone = {k for k in range(9) if not state.particles.active[k]}
    bonds = state.particles.bonds
    for one, other, status in zip(*(np.asarray(x)[:-1] for x in (bonds.pairs.first, bonds.pairs.second, bonds.status)),
                                  strict=True):  # fmt: skip
        assert status == (LEFT if {int(one), int(other)} & gone else INTACT)
    assert gone == {2, 5, 8}


def test_check_knows_the_bonds_and_their_step():
    """The limit of a pair is its own closed form; of a lattice that stretches by pairs it is a bound."""
    report = check_scene(jaxdem.load_scene(tables_of()))
    assert "bonds between particles" in report.compiled_in
    assert dict(report.packs)["bonds"].startswith("12 between 9 particles, up to 4 of one")
    assert report.time_steps["contact"] <= 0.5 * report.limits["bond_stability"]
    bond = {"gap": 0.05 * RADIUS, "normal_stiffness": 1e9, "shear_stiffness": 1e7}
    pair = particle_setup(jaxdem.load_scene(tables_of(particles={"position": square(2, 1)}, bonds=[bond])))
    found = contact_step(pair, 0.0).limits["bond_stability"]
    mass = 2500.0 * 4.0 / 3.0 * math.pi * RADIUS**3
    assert abs(found / math.sqrt(2.0 * mass / (1e9 * math.pi * RADIUS**2)) - 1.0) < 1e-9


def assert_same(one, other):
    """Frames of two runs at the same time, bit for bit."""
    for name in ("position", "velocity", "angular_velocity", "contact_force"):
        np.testing.assert_array_equal(one.particles(-1)[name], other.particles(-1)[name])
    for name, values in one.bonds(-1).items():
        np.testing.assert_array_equal(values, other.bonds(-1)[name], err_msg=name)


def test_runs_are_resumed_and_go_on_in_another_bit_for_bit(tmp_path):
    """A lattice that breaks at the floor, in float32: in one go, resumed, and as the start of another run."""
    own = {"bonds": [BOND | {"tensile_strength": 3e4}], "precision": "float32",
           "particles": {"velocity": [[0.0, -3.0]] * 9}, "output": {"checkpoint_interval": 0.0}}  # fmt: skip
    whole = jaxdem.simulate(jaxdem.load_scene(tables_of(**own)), tmp_path / "whole")
    half = tables_of(**own, time={"end": 0.01})
    jaxdem.simulate(jaxdem.load_scene(half), tmp_path / "half")
    later = tables_of(**own)
    del later["particles"], later["bonds"]
    later["start"] = {"from": str(tmp_path / "half")}
    begun = jaxdem.simulate(jaxdem.load_scene(later), tmp_path / "begun")
    jaxdem.simulate(jaxdem.load_scene(tables_of(**own)), tmp_path / "half", resume=True)
    assert_same(whole, jaxdem.load_run(tmp_path / "half"))
    assert_same(whole, begun)
    _counted(whole)
    _opens_in_vtk(whole)
    later["time"]["end"] = 0.03
    _less_and_more_grains(later)
    with pytest.raises(InputError, match="start.relax"):
        jaxdem.simulate(jaxdem.load_scene(later | {"start": later["start"] | {"relax": True}}), tmp_path / "no")
    with pytest.raises(InputError, match="start.time"):
        jaxdem.simulate(jaxdem.load_scene(later | {"start": later["start"] | {"time": 0.0}}), tmp_path / "no")
    with pytest.raises(InputError, match=r"bonds = '0 tables': the bonds of the run .* go on"):
        jaxdem.simulate(jaxdem.load_scene(later | {"bonds": []}), tmp_path / "no")
    _bonds_are_made_once(later)


def _bonds_are_made_once(later):
    """Tables that go on may have other strengths; what new bonds would be made by is refused where it differs."""
    table = BOND | {"tensile_strength": 1e5}
    assert jaxdem.load_scene(later | {"bonds": [table]}).bonds[0].tensile_strength == 1e5
    region = {"shape": "box", "start": [0.0, 0.0], "stop": [0.1, 0.1]}
    listed = {key: value for key, value in table.items() if key != "gap"} | {"pairs": [[0, 1]]}
    for bonds, message in (
        ([table | {"gap": 0.01}], r"bonds\.0\.gap.*whose scene has"),
        ([table | {"region": region}], r"bonds\.0\.region.*\(not set\)"),
        ([listed], r"bonds\.0\.gap.*whose scene has"),
        ([table, table | {"region": region}], "bonds = '2 tables'.*makes no new ones"),
    ):
        with pytest.raises(InputError, match=message):
            jaxdem.load_scene(later | {"bonds": bonds})


def test_a_list_of_pairs_that_goes_on_is_the_same_list(tmp_path):
    listed = {"pairs": [[0, 1], [3, 4]], "normal_stiffness": 1e9, "shear_stiffness": 4e8}
    jaxdem.simulate(jaxdem.load_scene(tables_of(bonds=[listed], time={"end": 0.01})), tmp_path / "run")
    later = tables_of(bonds=[listed], start={"from": str(tmp_path / "run")})
    later["bonds"][0]["pairs"] = [[4, 3], [0, 1]]
    assert np.asarray(first(jaxdem.load_scene(later))[2].particles.bonds.status).tolist() == [INTACT, INTACT, LEFT]
    later["bonds"][0]["pairs"] = [[0, 1], [4, 5]]
    with pytest.raises(InputError, match=r"bonds\.0\.pairs = '2 pairs'.*Give the same list"):
        first(jaxdem.load_scene(later))


def _less_and_more_grains(later):
    """Bonds of grains that are removed at the start have left; grains that are added have none."""
    low = {"shape": "box", "start": [0.0, 0.0], "stop": [0.15, 0.03]}
    added = {"radius": RADIUS, "density": 2500.0, "position": [[0.12, 0.12]]}
    changed = later | {"start": later["start"] | {"remove": [low], "add": added}}
    _, _, state, _ = first(jaxdem.load_scene(changed))
    bonds, active = state.particles.bonds, np.asarray(state.particles.active)
    assert len(active) == 10 and active[9] and not active[:9].all()
    one, other = (np.asarray(x)[:-1] for x in (bonds.pairs.first, bonds.pairs.second))
    both = active[one] & active[other]
    status = np.asarray(bonds.status)[:-1]
    assert (status[~both] != INTACT).all() and (status[~both] == LEFT).any()
    assert (status[both] != LEFT).all()
    assert len(one) == 12 and (np.asarray(bonds.orientation[0])[9] == 1.0)


def _counted(run):
    """History, summary and frames tell of the same bonds."""
    status, figures = run.bonds(-1)["status"], run.summary["bonds"]
    broken = int((status == TENSION).sum())
    assert 0 < broken == run.history["bonds_broken"][-1] == figures["broken_in_tension"]
    assert run.history["bonds_intact"][-1] == figures["intact"] == 12 - broken
    assert run.history["bonds_broken"][0] == 0.0
    assert figures["largest_body"] <= 9
    held = run.bonds(-1)["position"].reshape(12, 2, 3)
    places = run.particles(-1)["position"]
    np.testing.assert_allclose(held[:, 0], places[run.bonds(-1)["first"]])
    np.testing.assert_allclose(held[:, 1], places[run.bonds(-1)["second"]], rtol=1e-6)


def _opens_in_vtk(run):
    """Twelve lines at each time, with the status of the bonds."""
    reader = pytest.importorskip("vtkmodules.vtkIOHDF").vtkHDFReader()
    reader.SetFileName(str(run.path / "bonds.vtkhdf"))
    reader.SetStep(run.number_of_frames - 1)
    reader.Update()
    data = reader.GetOutput()
    status = data.GetCellData().GetArray("status")
    assert data.GetNumberOfLines() == 12
    assert [int(status.GetValue(k)) for k in range(12)] == run.bonds(-1)["status"].tolist()


@COMBINATION
def test_bonds_are_made_of_a_pack_that_a_run_has_left(tmp_path):
    """Stages: grains without bonds, then with; the second stage bonds them where they are then."""
    plain = tables_of(domain={"gravity": [0.0, 0.0]}, time={"end": 0.01})
    del plain["bonds"]
    plain["particles"] |= {"velocity": [[0.5, 0.0]] * 9}
    stages = {
        "stages": [{"name": "free", "time": {"end": 0.01}}, {"name": "bonded", "time": {"end": 0.02}, "bonds": [BOND]}]
    }
    scene = jaxdem.load_scene(plain | stages)
    free, bonded = (jaxdem.build(stage.scene)[0] if k == 0 else stage.scene for k, stage in enumerate(scene.stages))
    assert free.contact.model.bonds is None and len(bonded.bonds) == 1
    jaxdem.simulate(scene, tmp_path / "run")
    run = jaxdem.load_run(tmp_path / "run" / "bonded")
    assert run.summary["bonds"]["made"] == 12
    assert abs(run.bonds(0)["normal_force"]).max() == 0.0


@COMBINATION
def test_the_disc_of_the_example_splits_between_the_plates(tmp_path):
    """With 72 grains: the force of the plate rises, and falls to nearly nothing; bonds break nearer to the middle than
    they lie on average, and no body is left that has most of the grains."""
    overrides = {"particles.radius": 0.002, "domain.depth": 0.004, "bonds.0.gap": 5e-4, "coupling.interval": 1e-4}
    overrides |= {
        "probes.0.interval": 2e-4,
        "time.end": 0.004,
        "walls.1.motion.0.velocity": [0.0, -0.3],
        "particles.pack.solid_fraction": 0.72,
    }
    scene = jaxdem.load_scene(Path(__file__).parents[2] / "scenes" / "brazilian_test.toml", overrides)
    run = jaxdem.simulate(scene, tmp_path / "disc")
    force = run.probes["upper"]["force_z"]
    peak = int(np.argmax(force))
    assert 0 < peak < len(force) - 1
    assert force[peak:].min() < 0.2 * force[peak]
    broken = run.bonds(-1)["status"] != INTACT
    aside = np.abs(run.bonds(0)["position"].reshape(-1, 2, 3).mean(axis=1)[:, 0] - 0.03)
    assert broken.any() and np.mean(aside[broken]) < np.mean(aside)
    assert run.summary["bonds"]["largest_body"] < 0.6 * len(run.particles(-1)["id"])


def cemented(bonds):
    """Three grains in a row, with gaps of 0.02 and 0.2 radii."""
    places = 0.05 + RADIUS * np.asarray([0.0, 2.02, 4.22])
    return tables_of(particles={"position": [[x, 0.05] for x in places.tolist()]}, bonds=bonds)


def test_stiffness_of_a_cement():
    """k_n = E/L and k_s = G/L of each bond, in the numbers of the bonds and in the stable step."""
    lengths, modulus = np.asarray([2.02, 2.2]) * RADIUS, 2e8
    simulation, parameters = jaxdem.build(scene := jaxdem.load_scene(
        cemented([{"gap": 0.25 * RADIUS, "young_modulus": modulus}])
    ))  # fmt: skip
    state, _ = jaxdem.initial_state(scene, simulation, parameters)
    numbers = parameters.bonds.of_bonds(state.particles.bonds)
    np.testing.assert_allclose(numbers.normal_stiffness[:2], modulus / lengths, rtol=1e-12)
    np.testing.assert_allclose(numbers.shear_stiffness[:2], 0.4 * modulus / lengths, rtol=1e-12)
    each = [{"pairs": [[k, k + 1]], "normal_stiffness": modulus / length, "shear_stiffness": 0.4 * modulus / length}
            for k, length in enumerate(lengths)]  # fmt: skip
    other, _ = jaxdem.build(jaxdem.load_scene(cemented(each)))
    limits = simulation.steps.limits["bond_stability"], other.steps.limits["bond_stability"]
    assert limits[0] == pytest.approx(limits[1], rel=1e-9)


@pytest.mark.parametrize(("keys", "key"), [
    ({"young_modulus": 1e8, "normal_stiffness": 1e10}, "normal_stiffness"),
    ({"normal_stiffness": 1e10, "shear_stiffness": 1e10, "shear_modulus": 1e8}, "shear_modulus"),
    ({"normal_stiffness": 1e10}, "shear_stiffness"),
    ({}, "normal_stiffness"),
])  # fmt: skip
def test_a_bond_is_stiff_in_one_way(keys, key):
    with pytest.raises(InputError) as found:
        jaxdem.load_scene(cemented([{"gap": 1e-4} | keys]))
    assert found.value.key == f"bonds.0.{key}"
