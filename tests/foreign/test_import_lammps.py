"""Scripts of LAMMPS: contact laws, walls, pour, two axes and units."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases import decks

from jaxdem import load_scene
from jaxdem.errors import InputError
from jaxdem.foreign import import_deck
from jaxdem.foreign.impact import hertz_duration, linear_duration, restitution
from jaxdem.foreign.notes import DIFFERS, LEFT, NOTHING, TAKEN
from jaxdem.setup.arrivals import arrivals


@pytest.fixture(scope="module")
def poured(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pour")
    return (*decks.imported(folder, decks.POUR), folder)


def test_two_axes(poured):
    tables, _, made, folder = poured
    assert tables["domain"] == {"size": [1.0, 0.5], "depth": 0.02, "gravity": [0.0, -9.81]}
    assert "boundary" not in tables or tables["boundary"] == {}
    assert decks.note_on(made, "fix zwalls").kind == NOTHING
    assert decks.note_on(made, "fix xwalls").reason.startswith("boundary.left, at 0 m, and boundary.right, at 1 m")
    assert {note.text for note in made.notes if note.kind == DIFFERS and note.place == "scene"} >= {
        "dimension 2",
        "top",
    }
    assert load_scene(folder / "scene.toml").dimension == 2


def test_pour_is_an_inlet_of_the_same_rate(poured):
    """By its closed form: 0.05 m = 1 m/s t + g t^2/2; discs of pi r^2 in 0.8 x 0.05 m to a fraction of 0.4."""
    tables, _, _, folder = poured
    (inlet,) = tables["particles"]["inlet"]
    time = (-1.0 + math.sqrt(1.0 + 2.0 * 9.81 * 0.05)) / 9.81
    batch = int(0.4 * 0.8 * 0.05 / (math.pi * 0.01**2))
    assert inlet["rate"] == pytest.approx(batch / time)
    assert (inlet["start"], inlet["stop"], inlet["total"]) == ([0.1, 0.3], [0.9, 0.35], 100)
    assert (inlet["velocity"], inlet["density"]) == ([0.0, -1.0], 2500.0)
    scene = load_scene(folder / "scene.toml")
    (found,) = arrivals(scene, scene.particles)
    assert len(found.time) == 100 and abs(np.mean(found.bodies.radius) - 0.0075) < 0.0005


def test_the_linear_law(poured):
    """e of k d + m* g v in closed form: exp(-pi (g/2)/sqrt(k/m* - (g/2)^2)), of the largest particles."""
    contact = poured[0]["contact"]
    mass = 0.5 * 2500.0 * 4.0 / 3.0 * math.pi * 0.01**3
    expected = math.exp(-math.pi * 25.0 / math.sqrt(2000.0 / mass - 25.0**2))
    assert contact["restitution"] == pytest.approx(expected, abs=1e-4)
    assert (contact["law"], contact["normal_stiffness"]) == ("linear_spring_dashpot", 2000.0)
    assert contact["tangential_stiffness"] == pytest.approx(2000.0 * 2.0 / 7.0)
    assert (contact["friction"], contact["wall_friction"]) == (0.5, 0.25)
    assert "two particles" in decks.note_on(poured[2], "fix ywalls").reason


def test_materials_of_the_granular_style(tmp_path):
    tables, _, made = decks.imported(tmp_path, decks.GRANULAR)
    first, second = tables["materials"]
    assert (first["young_modulus"], first["restitution"], first["friction"]) == (1e6, 0.8, 0.4)
    assert (second["young_modulus"], second["poisson_ratio"], second["rolling_friction"]) == (2e6, 0.2, 0.05)
    assert tables["material_pairs"] == [
        {"materials": ["type1", "type2"], "restitution": 0.7, "friction": 0.3, "rolling_friction": 0.0}
    ]
    assert tables["contact"]["rolling_model"] == "epsd"
    np.testing.assert_allclose(tables["domain"]["gravity"], [0.0, 0.0, -9.81], atol=1e-9)
    (inlet,) = tables["particles"]["inlet"]
    assert inlet["region"]["shape"] == "cylinder" and inlet["species"][0]["share"] == 0.25
    assert [one["radius"] for one in inlet["species"]] == [0.001, 0.0005]
    assert "twisting left out" in decks.note_on(made, "pair_coeff 1 2").reason
    assert decks.note_on(made, "fix bond").kind == LEFT and decks.note_on(made, "fix tube").kind == TAKEN
    load_scene(tmp_path / "scene.toml")


def test_walls_of_a_region_and_one_that_goes_on(tmp_path):
    """A tube with two ends, which vanish; the tube is given anew at that time, and stays."""
    tables, _, made = decks.imported(tmp_path, decks.SILO)
    tube, floor, roof = tables["walls"]
    assert (tube["kind"], tube["radius"], "end" in tube) == ("cylinder", 0.025, False)
    assert (floor["point"][2], floor["normal"][2], floor["end"]) == (0.02, 1.0, 0.05)
    assert (roof["point"][2], roof["normal"][2], roof["end"]) == (0.14, -1.0, 0.05)
    assert "goes on as the wall of in.deck, line 29" in decks.note_on(made, "fix w1").reason
    assert decks.note_on(made, "fix w3").reason.startswith('[[walls]], kind = "cylinder"')
    assert tables["contact"]["wall_friction"] == 0.3 and "stages" not in tables
    places = np.loadtxt(tmp_path / "scene.particles.csv", delimiter=",", skiprows=1)
    away = np.hypot(places[:, 0] - 0.03, places[:, 1] - 0.03)
    assert away.max() <= 0.022 + 1e-9 and places[:, 2].min() >= 0.024 - 1e-9
    # Places i, j, k of a lattice of 4.4 mm in the cylinder, counted one by one.
    inside = [i * i + j * j <= (0.022 / 0.0044) ** 2 + 1e-9 for i in range(-6, 7) for j in range(-6, 7)]
    assert len(places) == sum(inside) * len([k for k in range(1, 7) if 0.004 <= 0.0044 * k <= 0.03])


def test_the_benchmark_in_three_programs_is_one_scene(tmp_path):
    """E and nu of the old style come from its stiffnesses: K_n = 4G/(3(1-nu)), K_t = 4G/(2-nu)."""
    names = ("in.liggghts", "in.lammps", "in.lammps_hertz_history")
    found = [import_deck(decks.DATA / name, tmp_path / "scene.toml") for name in names]
    contacts = []
    for made in found:
        made.write(tmp_path / "scene.toml")
        contacts.append(load_scene(tmp_path / "scene.toml").contact)
    first, second, third = contacts
    assert (first.young_modulus, first.restitution, first.friction) == (7e7, 0.7, 0.1)
    assert (second.young_modulus, second.restitution, second.friction) == (7e7, 0.7, 0.1)
    assert third.young_modulus == pytest.approx(7e7, rel=1e-3) and third.poisson_ratio == pytest.approx(0.3, abs=1e-3)
    assert first.rolling_model == "cdt" and second.rolling_model == "epsd"
    assert decks.note_on(found[1], "if ").kind == DIFFERS
    assert decks.note_on(found[0], "pair_style").kind == TAKEN


def test_restitution_of_laws_with_a_dashpot():
    """Linear: the closed form. Without damping 1; overdamped 0; of Hertz by restitution's own damping the given one."""
    for ratio in (0.05, 0.3, 0.9):
        stiffness, mass = 5000.0, 2e-3
        dashpot = 2.0 * ratio * math.sqrt(stiffness * mass)
        found = restitution(mass, lambda d: 5000.0 * d, lambda d: dashpot, 0.3, linear_duration(mass, stiffness))  # noqa: B023
        assert found == pytest.approx(math.exp(-math.pi * ratio / math.sqrt(1.0 - ratio**2)), rel=1e-5)
    assert restitution(1.0, lambda d: d, lambda d: 3.0, 1.0, math.pi) == 0.0
    assert restitution(1.0, lambda d: d**1.5, lambda d: 0.0, 1.0, hertz_duration(1.0, 1.0, 1.0)) == pytest.approx(1.0)
    given, mass, stiffness = 0.6, 1e-3, 1e6
    beta = -math.log(given) / math.hypot(math.log(given), math.pi)

    def damping(depth):  # that of LIGGGHTS and of jaxdem: 2 sqrt(5/6) beta sqrt(S m), S = 2 E* sqrt(R* d)
        return 2.0 * math.sqrt(5.0 / 6.0) * beta * math.sqrt(1.5 * stiffness * math.sqrt(depth) * mass)

    found = restitution(mass, lambda d: stiffness * d**1.5, damping, 0.5, hertz_duration(mass, stiffness, 0.5))
    assert found == pytest.approx(given, abs=0.02)


def test_micro_units(tmp_path):
    """1 um, 1 pg, 1 us: a pressure of 1 is 1000 Pa, a density of 1 is 1000 kg/m3, an acceleration of 1 is 1e6 m/s2."""
    text = decks.POUR.replace("units si", "units micro").replace("9.81", "9.81e-6")
    tables, _, _ = decks.imported(tmp_path, text)
    assert tables["domain"]["size"] == [1e-6, 5e-7] and tables["domain"]["gravity"] == [0.0, -9.81]
    assert tables["particles"]["density"] == 2.5e6 and tables["contact"]["time_step"] == 1e-10
    assert tables["contact"]["normal_stiffness"] == pytest.approx(2000.0 * 1e-3)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (("units si", "units lj"), "choose a length, a mass and a time"),
        (("units si\n", ""), r"units \(units si\)"),
        (("pair_style gran/hooke/history", "pair_style lj/cut"), "a contact model"),
        (("fix ins all pour", "fix ins all deposit"), "use fix pour"),
        (("9.81 vector 0.0 -1.0 0.0", "9.81 vector 0.0 0.0 -1.0"), "across the plane"),
        (("vol 0.4 10", "vol 1e-9 10"), "no room for a particle"),
        (("vol 0.4 10", "rate 1.0"), "region that moves"),
    ],
)
def test_what_a_scene_cannot_be_is_refused(tmp_path, changes, words):
    assert changes[0] in decks.POUR
    with pytest.raises(InputError, match=words):
        decks.imported(tmp_path, decks.POUR.replace(*changes))


def test_adhesion_of_the_granular_style(tmp_path):
    """gamma is the surface energy of one surface, in cgs erg/cm2 = 1e-3 J/m2; the work of adhesion is twice that."""
    own = "jkr 1e7 0.8 0.3 50.0 tangential mindlin NULL 1.0 0.4 damping tsuji"
    text = decks.GRANULAR.replace("pair_coeff 1 1 hertz/material 1e7 0.8 0.3", "pair_coeff 1 1 jkr 1e7 0.8 0.3 50.0")
    text = text.replace("pair_coeff 1 2 hertz/material 2e7 0.7 0.2", "pair_coeff 1 2 jkr 2e7 0.7 0.2 20.0")
    assert own in text
    tables = decks.imported(tmp_path, text)[0]
    assert tables["contact"]["cohesion"]["kind"] == "jkr"
    assert [one["work_of_adhesion"] for one in tables["materials"]] == pytest.approx([0.1, 0.0])
    assert tables["material_pairs"][0]["work_of_adhesion"] == pytest.approx(0.04)
    load_scene(tmp_path / "scene.toml")


@pytest.mark.parametrize(("wall", "factor"), [("hertz/material 5e6 0.5 0.3", 0.0), ("jkr 5e6 0.5 0.3 0.01", 0.5)])
def test_adhesion_of_walls(tmp_path, wall, factor):
    text = decks.SILO.replace("pair_coeff * * hertz/material 5e6 0.5 0.3", "pair_coeff * * jkr 5e6 0.5 0.3 0.02")
    text = text.replace("granular hertz/material 5e6 0.5 0.3", f"granular {wall}")
    text = text.replace("fix w2 all wall/gran hertz/history 1e5 NULL 50 NULL 0.3 0 zplane NULL 0.149\n", "")
    cohesion = decks.imported(tmp_path, text)[0]["contact"]["cohesion"]
    assert cohesion["work_of_adhesion"] == pytest.approx(0.04)
    assert cohesion["wall_factor"] == pytest.approx(factor)
