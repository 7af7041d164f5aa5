"""Single impacts, bounces, sliding and stacked particles against closed forms and published tables.

Contact steps are a hundredth of the contact's duration, where not said otherwise (physics.md, "Verified
against").
"""

from __future__ import annotations

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from worlds import batch, constants, track, world

from jaxdem.particles import contact, loop
from jaxdem.particles.contact import LinearSpringDashpot

DATA = Path(__file__).parents[1] / "data"
GRAVITY = 9.80665


def table(name):
    return np.genfromtxt(DATA / name, delimiter=",", names=True, skip_header=1, dtype=None, encoding="utf-8")


def hermite(x0, v0, x1, v1, step, s):
    """Cubic through two frames, s in 0 ... 1."""
    a, b = step * v0, step * v1
    return x0 + s * (a + s * (3 * (x1 - x0) - 2 * a - b + s * (2 * (x0 - x1) + a + b)))


def crossing(x, v, step, number):
    """Time after frame 0 at which x, frames 0 ..., changes sign between `number` and the next."""
    s = np.linspace(0.0, 1.0, 2001)
    value = hermite(x[number], v[number], x[number + 1], v[number + 1], step, s)
    k = np.argmax(np.sign(value) != np.sign(value[0]))
    return step * (number + s[k - 1] - value[k - 1] * (s[k] - s[k - 1]) / (value[k] - value[k - 1]))


def impact(overlap, rate, step):
    """Begin, end, deepest overlap of the first contact in frames of overlap and its rate."""
    begin = np.argmax(overlap > 0) - 1
    end = begin + 1 + np.argmax(overlap[begin + 1 :] <= 0) - 1
    s = np.linspace(0.0, 1.0, 101)
    deepest = max(
        hermite(overlap[k], rate[k], overlap[k + 1], rate[k + 1], step, s).max() for k in range(begin, end)
    )
    return crossing(overlap, rate, step, begin), crossing(overlap, rate, step, end), deepest


def hertz_step(row, fraction):
    return row["t_c_s"] * fraction


# --- Hertz ---------------------------------------------------------------------------------------------

SPEEDS = (0.01, 0.1, 1.0, 10.0)
RESTITUTIONS = (0.2, 0.3, 0.5, 0.7, 0.9, 1.0)
FRACTIONS = (1 / 100, 1 / 20)
FRAMES = 320


def head_on(radius, density, modulus, poisson, speed, restitution, fraction):
    """Two spheres that meet after 1.37 steps, an odd phase; and the step, a part of t_H."""
    mass = density * 4 / 3 * np.pi * radius**3
    effective = modulus / (2 * (1 - poisson**2))
    # 2.868 (m*^2 / (R* E*^2 v))^(1/5), Johnson 1985 eq. 11.24
    step = fraction * 2.868 * ((mass / 2) ** 2 / (radius / 2 * effective**2 * speed)) ** 0.2
    half = radius + 0.5 * 1.37 * speed * step
    scene = world(
        [[-half, 0.0], [half, 0.0]], [[speed / 2, 0.0], [-speed / 2, 0.0]], radius=radius, density=density,
        walls=False, rebuild=False,
        material=constants(young_modulus=modulus, poisson_ratio=poisson, restitution=restitution),
    )  # fmt: skip
    return scene, step


@pytest.fixture(scope="module")
def pairs():
    """Head-on impacts, all in one program: the table's pairs, then restitution x speed x step."""
    rows = [row for row in table("hertz_closed_form.csv") if "pair" in row["case"]]
    cases = [
        head_on(row["R_m"], row["rho"], row["E_Pa"], row["nu"], row["v_rel"], 1.0, 1 / 100) for row in rows
    ]
    cases += [
        head_on(0.01, 2500.0, 7e7, 0.3, v, e, f) for e in RESTITUTIONS for v in SPEEDS for f in FRACTIONS
    ]
    steps = np.array([step for _, step in cases])
    _, seen = track(batch([scene for scene, _ in cases]), steps, FRAMES)
    return rows, steps, seen


def check_hertz(row, overlap, rate, force, step):
    begin, end, deepest = impact(overlap, rate, step)
    # The gate of physics.md; measured 2e-4 at most: position Verlet is of second order, (w dt)^2 / 24.
    np.testing.assert_allclose(deepest, row["delta_max_m"], rtol=5e-3)
    np.testing.assert_allclose(end - begin, row["t_c_s"], rtol=5e-3)
    np.testing.assert_allclose(force.max(), row["F_max_N"], rtol=5e-3)


def test_hertz_impact_of_pairs(pairs):
    """Largest overlap and force and the duration [0.5 %] (closed forms of Hertz; cases of Chung & Ooi
    2011)."""
    rows, steps, seen = pairs
    assert len(rows) == 3
    for k, row in enumerate(rows):
        x, v = seen.position[k, :, :, 0], seen.velocity[k, :, :, 0]
        check_hertz(
            row, 2 * row["R_m"] - (x[:, 1] - x[:, 0]), v[:, 0] - v[:, 1], seen.force[k, :, 1, 0], steps[k]
        )


def test_hertz_impact_on_rigid_plane():
    """The same for the four cases on a rigid plane; R* = R, m* = m, E* = E / (1 - nu^2)."""
    rows = [row for row in table("hertz_closed_form.csv") if "plane" in row["case"]]
    assert len(rows) == 4
    scenes = [
        world(
            [[0.5, row["R_m"] * 1.001]], [[0.0, -row["v_rel"]]], radius=row["R_m"], density=row["rho"],
            periodic=(True, False),
            material=constants(young_modulus=row["E_Pa"], poisson_ratio=row["nu"], wall_young_modulus=np.inf),
        )
        for row in rows
    ]  # fmt: skip
    # Not yet touching: a thousandth of R away takes up to 140 steps.
    steps = np.array([row["t_c_s"] / 100 for row in rows])
    _, seen = track(batch(scenes), steps, FRAMES)
    for k, row in enumerate(rows):
        x, v = seen.position[k, :, 0, 1], seen.velocity[k, :, 0, 1]
        check_hertz(row, row["R_m"] - x, -v, seen.force[k, :, 0, 1], steps[k])


def rebounds(pairs):
    rows, _, seen = pairs
    v = seen.velocity[len(rows) :, -1, :, 0]
    shape = (len(RESTITUTIONS), len(SPEEDS), len(FRACTIONS))
    return (v[:, 1] - v[:, 0]).reshape(shape) / np.array(SPEEDS)[None, :, None]


def test_restitution_out_is_restitution_in(pairs):
    """e = 0.2 ... 1 over three decades of speed (Antypov & Elliott 2011) [0.005], at t_H/20 [0.02].

    Measured: 3e-4 and 7e-3.
    """
    error = np.abs(rebounds(pairs) - np.array(RESTITUTIONS)[:, None, None]).max(axis=(0, 1))
    assert error[0] < 0.005
    assert error[1] < 0.02


def test_restitution_does_not_depend_on_speed(pairs):
    """The law is free of a speed scale: with the step a part of t_H every speed gives the same, to 1e-4.

    What is left is round-off in positions and the phase at which contact begins.
    """
    assert np.ptp(rebounds(pairs), axis=1).max() < 1e-4


# --- MFIX DEM01 and DEM02: a sphere dropped on a floor, linear law -------------------------------------

DROP_RADIUS, DROP_HEIGHT, DROP_DENSITY = 0.1, 0.5, 2600.0
DROP_FRAMES = 5900  # four bounces at k_n = 5e4 and e = 1


def drop_mass():
    return DROP_DENSITY * 4 / 3 * np.pi * DROP_RADIUS**3


def dropped(stiffness, restitution):
    return world(
        [[0.5, DROP_HEIGHT]], radius=DROP_RADIUS, density=DROP_DENSITY, periodic=(True, False),
        gravity=(0.0, -GRAVITY), law=LinearSpringDashpot(),
        material=constants(normal_stiffness=stiffness, restitution=restitution),
    )  # fmt: skip


def soft_sphere(stiffness, restitution, speed):
    """Duration, deepest overlap and rebound of an LSD contact under gravity; None if it does not end.

    d'' = g - 2 b w d' - w^2 d, d(0) = 0, d'(0) = speed, until d = 0 (MFIX's DEM01 three-stage form).
    """
    b = -np.log(restitution) / np.hypot(np.log(restitution), np.pi)
    w = np.sqrt(stiffness / drop_mass())
    wd, rest = w * np.sqrt(1 - b * b), GRAVITY / w**2
    sine = (speed - b * w * rest) / wd
    t = np.linspace(0.0, 4 * np.pi / w, 80_001)[1:]
    decay, c, s = np.exp(-b * w * t), np.cos(wd * t), np.sin(wd * t)
    d = rest + decay * (sine * s - rest * c)
    rate = decay * ((sine * wd + b * w * rest) * c + (rest * wd - b * w * sine) * s)
    if not (d <= 0).any():
        return None
    k = np.argmax(d <= 0)
    share = d[k - 1] / (d[k - 1] - d[k])
    return t[k - 1] + share * (t[k] - t[k - 1]), d[:k].max(), -(rate[k - 1] + share * (rate[k] - rate[k - 1]))


@pytest.fixture(scope="module")
def drops():
    rows = table("mfix_dem01_closed_form.csv")
    assert len(rows) == 18
    scenes = [dropped(float(row["kn"]), float(row["e"])) for row in rows]
    steps = np.pi * np.sqrt(drop_mass() / rows["kn"].astype(float)) / 100
    _, seen = track(batch(scenes), steps, DROP_FRAMES)
    return rows, steps, seen.position[:, :, 0, 1], seen.velocity[:, :, 0, 1]


def test_free_fall_is_exact(drops):
    """x = h - g t^2 / 2 until the floor: the scheme is exact for a constant force, up to round-off."""
    _, steps, x, v = drops
    for k in range(len(steps)):
        number = int(0.28 / steps[k])
        time = steps[k] * np.arange(1, number + 1)
        np.testing.assert_allclose(x[k, :number], DROP_HEIGHT - GRAVITY * time**2 / 2, rtol=1e-12)
        np.testing.assert_allclose(v[k, :number], -GRAVITY * time, rtol=1e-12)


def test_soft_sphere_form_is_that_of_the_table(drops):
    """Two independent evaluations of the closed form agree: ours below and the table's."""
    for row in drops[0]:
        ours = soft_sphere(float(row["kn"]), float(row["e"]), -row["v_impact"])
        expected = [row["contact_duration_s"], row["max_overlap_m"], row["v_rebound"]]
        np.testing.assert_allclose(ours, expected, rtol=2e-6)  # the table has eight digits


def test_dem01_drop(drops):
    """MFIX DEM01: first contact, its duration, overlap, rebound and the next apex [0.1 %].

    Measured 0.05 % at most; with dashpots on the velocity at the start of the step 1.7 %.
    """
    rows, steps, x, v = drops
    for k, row in enumerate(rows):
        begin, end, deepest = impact(DROP_RADIUS - x[k], -v[k], steps[k])
        after = int(end / steps[k]) + 1  # frame j is at time (j + 1) step; `end` counts from frame 0
        rebound = np.sqrt(v[k, after] ** 2 + 2 * GRAVITY * (x[k, after] - DROP_RADIUS))
        apex = DROP_RADIUS + rebound**2 / (2 * GRAVITY)
        ours = [begin + steps[k], end - begin, deepest, rebound, apex]
        names = ("t_first_contact_s", "contact_duration_s", "max_overlap_m", "v_rebound", "apex1_m")
        np.testing.assert_allclose(ours, [row[name] for name in names], rtol=1e-3)
        highest = x[k, after : after + int(2 * rebound / GRAVITY / steps[k])].max()
        # The highest frame lies up to g step^2 / 8 below the apex.
        np.testing.assert_allclose(highest, apex, atol=GRAVITY * steps[k] ** 2 / 8 + 1e-12)


def apexes(x):
    inner = (x[1:-1] >= x[:-2]) & (x[1:-1] > x[2:]) & (x[1:-1] > DROP_RADIUS)
    return x[1:-1][inner]


def test_dem02_bounces(drops):
    """MFIX DEM02: heights of up to four bounces at k_n = 5e4 against the soft-sphere form [0.4 %].

    And against MFIX's own heights, which its larger Adams-Bashforth steps put up to 0.65 % from that form (e
    = 0.6).
    """
    rows, _, x, _ = drops
    theirs = table("mfix_dem02_bounce.csv")
    checked = 0
    for k, row in enumerate(rows):
        if row["kn"] != 50000:
            continue
        speed, expected = np.sqrt(2 * GRAVITY * (DROP_HEIGHT - DROP_RADIUS)), []
        while len(expected) < 4 and (contact_ := soft_sphere(5e4, float(row["e"]), speed)) is not None:
            speed = contact_[2]
            expected.append(DROP_RADIUS + speed**2 / (2 * GRAVITY))
        ours = apexes(x[k])[: len(expected)]
        np.testing.assert_allclose(ours, expected, rtol=4e-3)
        chosen = theirs[(theirs["e"] == row["e"]) & (theirs["bounce"] > 0)]
        mfix = chosen["height_MFIX_m"][: len(expected)]
        np.testing.assert_allclose(ours[: len(mfix)], mfix, rtol=7e-3)
        checked += len(expected)
    assert checked >= 20


def test_start_of_step_damping_would_fail_dem01(monkeypatch):
    """Negative control: with the dashpots on the velocity at the start of the step the rebound is off by 1
    %."""
    original = loop.contact_forces
    monkeypatch.setattr(loop, "contact_forces", lambda *a: original(*a[:6]))
    scene, step = dropped(1e4, 0.5), np.pi * np.sqrt(drop_mass() / 1e4) / 100
    _, seen = track(scene, step, 480)
    expected = next(row["v_rebound"] for row in table("mfix_dem01_closed_form.csv") if row["e"] == 0.5)
    x, v = seen.position[:, 0, 1], seen.velocity[:, 0, 1]
    assert x[-1] > DROP_RADIUS and v[-1] > 0
    rebound = np.sqrt(v[-1] ** 2 + 2 * GRAVITY * (x[-1] - DROP_RADIUS))
    assert abs(rebound / expected - 1) > 3e-3


def test_wrong_damping_would_fail_restitution(monkeypatch):
    """Negative control: without the factor sqrt(5/6) of the Hertz dashpot the rebound misses the gate."""
    true = contact.damping_ratio
    monkeypatch.setattr(contact, "damping_ratio", lambda e: true(e) / jnp.sqrt(5.0 / 6.0))
    scene, step = head_on(0.01, 2500.0, 7e7, 0.3, 1.0, 0.5, 1 / 100)
    _, seen = track(scene, step, 200)
    assert abs(seen.velocity[-1, 1, 0] - seen.velocity[-1, 0, 0] - 0.5) > 0.02


# --- MFIX DEM03: two compressed particles between two walls --------------------------------------------


def test_dem03_two_stacked_particles():
    """MFIX DEM03: positions of two particles of different density against its RK4 solution [0.1 %].

    r = 0.5 mm, 20 and 10 g/cm3, walls 3.6 r apart, k_n = 1000 N/m, e = 0.5 ... 1.
    """
    tables = [table(f"mfix_dem03_particle{k}.csv") for k in (1, 2)]
    values = np.unique(tables[0]["e"])
    scenes = [
        world(
            [[0.005, 0.00045], [0.005, 0.00135]], radius=0.0005, density=(2e4, 1e4), box=(0.01, 0.0018),
            periodic=(True, False), gravity=(0.0, -GRAVITY), law=LinearSpringDashpot(), rebuild=False,
            material=constants(normal_stiffness=1000.0, restitution=e),
        )
        for e in values
    ]  # fmt: skip
    mass = np.array([2e4, 1e4]) * 4 / 3 * np.pi * 0.0005**3
    step = np.pi * np.sqrt(mass.prod() / mass.sum() / 1000.0) / 100
    _, seen = track(batch(scenes), np.full(len(values), step), int(1.02e-3 / step))
    start = np.array([[0.00045], [0.00135]])
    for k, e in enumerate(values):
        for p in range(2):
            rows = tables[p][tables[p]["e"] == e]
            x = np.concatenate([start[p], seen.position[k, :, p, 1]])
            v = np.concatenate([[0.0], seen.velocity[k, :, p, 1]])
            number = np.minimum((rows["t_s"] / step).astype(int), len(x) - 2)
            s = rows["t_s"] / step - number
            ours = hermite(x[number], v[number], x[number + 1], v[number + 1], step, s)
            np.testing.assert_allclose(ours, rows["pos_ode_m"], rtol=1e-3)


# --- MFIX DEM04: slip to rolling -----------------------------------------------------------------------


def test_dem04_slip_to_rolling():
    """MFIX DEM04: a sliding sphere starts to roll at t = 2/7 u0 / (mu g) with 5/7 of its speed [0.6 %].

    r = 0.5 mm, 1e4 kg/m3, u0 = 0.1 m/s, k_n = k_t = 1e4 N/m, e = 1, mu = 0.2 ... 1. The sphere starts at its
    static overlap. Steps of a fiftieth of the contact's duration; the force is constant while it slides.
    """
    rows = table("mfix_dem04_slip_roll.csv")
    radius, speed, stiffness = 0.0005, 0.1, 1e4
    mass = 1e4 * 4 / 3 * np.pi * radius**3
    scenes = [
        world(
            [[0.02, radius - mass * GRAVITY / stiffness]], [[speed, 0.0]], radius=radius, density=1e4,
            box=(0.1, 0.1), periodic=(True, False), gravity=(0.0, -GRAVITY), law=LinearSpringDashpot(),
            material=constants(normal_stiffness=stiffness, tangential_stiffness=stiffness, friction=mu),
        )
        for mu in rows["mu"]
    ]  # fmt: skip
    # Every case its own step, so that all have the same dimensionless time; the largest is 1/50 of a contact.
    steps = np.pi * np.sqrt(mass / stiffness) / 50 * rows["mu"].min() / rows["mu"]
    _, seen = track(batch(scenes), steps, 300, 50)
    for k, row in enumerate(rows):
        time = steps[k] * 50 * np.arange(1, 301) * row["mu"] * GRAVITY / speed
        u, roll = seen.velocity[k, :, 0, 0] / speed, -seen.spin[k, :, 0, 0] * radius / speed
        sliding, rolling = time < 0.2, time > 0.33
        assert sliding.sum() > 50 and rolling.sum() > 50
        slope, level = np.polyfit(time[sliding], u[sliding], 1)
        final = u[rolling].mean()
        ours = [(final - level) / slope, final, roll[rolling].mean()]
        np.testing.assert_allclose(ours, [row["t_analytic"], 5 / 7, 5 / 7], rtol=6e-3)
        np.testing.assert_allclose(ours, [row["t_MFIX"], row["u_MFIX"], row["omega_r_MFIX"]], rtol=1e-2)
