"""Contact: impacts, bounces, stacked and sliding particles against closed forms and published tables.

Contact steps are a hundredth of the contact's duration, where not said otherwise (physics.md, "Verified
against").
"""

from __future__ import annotations

import functools

import numpy as np

from jaxdem.particles.contact import LinearSpringDashpot
from tests.cases.registry import Figure, absolute, below, case, relative, table
from tests.cases.worlds import batch, constants, track, world

GRAVITY = 9.80665


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
    deepest = max(hermite(overlap[k], rate[k], overlap[k + 1], rate[k + 1], step, s).max() for k in range(begin, end))
    return crossing(overlap, rate, step, begin), crossing(overlap, rate, step, end), deepest


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


@functools.cache
def impacts():
    """Head-on impacts, all in one program: the table's pairs, then restitution x speed x step."""
    rows = [row for row in table("hertz_closed_form.csv") if "pair" in row["case"]]
    cases = [head_on(row["R_m"], row["rho"], row["E_Pa"], row["nu"], row["v_rel"], 1.0, 1 / 100) for row in rows]
    cases += [head_on(0.01, 2500.0, 7e7, 0.3, v, e, f) for e in RESTITUTIONS for v in SPEEDS for f in FRACTIONS]
    steps = np.array([step for _, step in cases])
    _, seen = track(batch([scene for scene, _ in cases]), steps, FRAMES)
    return rows, steps, seen


def hertz_figures(row, overlap, rate, force, step) -> list[Figure]:
    """Deepest overlap, duration and largest force of an impact beside the table's."""
    begin, end, deepest = impact(overlap, rate, step)
    name, gate = row["case"], 5e-3
    # Measured 2e-4 at most: position Verlet is of second order, (w dt)^2 / 24.
    return [
        relative(f"{name}: overlap", row["delta_max_m"], deepest, gate, "m"),
        relative(f"{name}: duration", row["t_c_s"], end - begin, gate, "s"),
        relative(f"{name}: force", row["F_max_N"], force.max(), gate, "N"),
    ]


@case("Hertz impact of two spheres", "contact", "Hertz 1882; cases of Chung & Ooi 2011")
def hertz_pairs() -> list[Figure]:
    """Largest overlap and force, and the duration [0.5 %]."""
    rows, steps, seen = impacts()
    figures = []
    for k, row in enumerate(rows):
        x, v = seen.position[k, :, :, 0], seen.velocity[k, :, :, 0]
        overlap = 2 * row["R_m"] - (x[:, 1] - x[:, 0])
        figures += hertz_figures(row, overlap, v[:, 0] - v[:, 1], seen.force[k, :, 1, 0], steps[k])
    return figures


@case("Hertz impact on a rigid plane", "contact", "Hertz 1882; cases of Chung & Ooi 2011")
def hertz_plane() -> list[Figure]:
    """The same for four cases on a rigid plane; R* = R, m* = m, E* = E / (1 - nu^2)."""
    rows = [row for row in table("hertz_closed_form.csv") if "plane" in row["case"]]
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
    figures = []
    for k, row in enumerate(rows):
        x, v = seen.position[k, :, 0, 1], seen.velocity[k, :, 0, 1]
        figures += hertz_figures(row, row["R_m"] - x, -v, seen.force[k, :, 0, 1], steps[k])
    return figures


def rebounds() -> np.ndarray:
    """Rebound over approach speed, (restitutions, speeds, steps)."""
    rows, _, seen = impacts()
    v = seen.velocity[len(rows) :, -1, :, 0]
    shape = (len(RESTITUTIONS), len(SPEEDS), len(FRACTIONS))
    return (v[:, 1] - v[:, 0]).reshape(shape) / np.array(SPEEDS)[None, :, None]


@case("restitution out is restitution in", "contact", "Antypov & Elliott 2011")
def restitution() -> list[Figure]:
    """e = 0.2 ... 1 over three decades of speed [0.005], at t_H/20 [0.02]; and the law has no speed scale.

    With the step a part of t_H every speed gives the same, to 1e-4: what is left is round-off in positions and
    the phase at which contact begins.
    """
    got = rebounds()
    figures = []
    for k, gate in ((0, 0.005), (1, 0.02)):
        for e, values in zip(RESTITUTIONS, got[:, :, k], strict=True):
            worst = values[np.argmax(np.abs(values - e))]
            step = round(1 / FRACTIONS[k])
            figures.append(absolute(f"e = {e}, 0.01 ... 10 m/s, step t_H/{step}", e, worst, gate))
    figures.append(below("spread over the speeds", np.ptp(got, axis=1).max(), 1e-4))
    return figures


@case("head-on impact with size ratio ten", "contact", "momentum and restitution; Hertz 1882")
def size_ratio() -> list[Figure]:
    """Radii 10 and 1 mm, densities 1000 and 5000: velocities after the impact [1e-3] and Hertz's peak force [0.5 %].

    The pain of a half-step error at size ratios above 3 (arXiv 2410.14798) would show here. Steps of t_H/100.
    """
    radius, density = np.array([0.01, 0.001]), np.array([1000.0, 5000.0])
    mass = density * 4 / 3 * np.pi * radius**3
    reduced, curvature = mass.prod() / mass.sum(), radius.prod() / radius.sum()
    modulus, speed = 5e6 / (2 * (1 - 0.3**2)), 0.5
    step = 2.868 * (reduced**2 / (curvature * modulus**2 * speed)) ** 0.2 / 100
    start = np.array([[0.1, 0.1], [0.1 + radius.sum() + 2.4 * step * speed, 0.1]])
    restitutions = (1.0, 0.6)
    pairs = [
        world(
            start, [[0.2, 0.0], [-0.3, 0.0]], radius=radius, density=density, walls=False, rebuild=False,
            material=constants(young_modulus=5e6, restitution=e),
        )
        for e in restitutions
    ]  # fmt: skip
    _, seen = track(batch(pairs), np.full(2, step), 180)
    centre, figures = (mass[0] * 0.2 - mass[1] * 0.3) / mass.sum(), []
    for k, e in enumerate(restitutions):
        expected = centre + np.array([-1.0, 1.0]) * e * speed * mass[::-1] / mass.sum()
        # The error of restitution at t_H/100 is under 1e-3, as measured above.
        for name, value, got in zip(("large", "small"), expected, seen.velocity[k, -1, :, 0], strict=True):
            figures.append(absolute(f"{name}, e = {e}", value, got, 1e-3 * speed, "m/s"))
    deepest = (15 * reduced * speed**2 / (16 * modulus * np.sqrt(curvature))) ** 0.4
    peak = 4 / 3 * modulus * np.sqrt(curvature) * deepest**1.5
    figures.append(relative("peak force, e = 1", peak, np.abs(seen.force[0]).max(), 5e-3, "N"))
    return figures


# --- Oblique impacts on a floor ---------------------------------------------------------------------------

PHASES = np.arange(8) / 8
OBLIQUE = {"radius": 0.01, "density": 2500.0}
OBLIQUE_MASS = 2500.0 * 4 / 3 * np.pi * 0.01**3


def oblique_step(law):
    """The step of twenty in an impact at 1 m/s, for Hertz-Mindlin the automatic one of a scene with this ball."""
    if law is not None:
        return np.pi * np.sqrt(OBLIQUE_MASS / 1e4) / 20
    return 2.868 * ((OBLIQUE_MASS / 2) ** 2 / (0.005 * (7e7 / (2 * (1 - 0.3**2))) ** 2 * 2.0)) ** 0.2 / 20


def thrown(angle, phase, step, law=None, spin=0.0, **material):
    """A ball at 1 m/s that meets a floor of its own material, `angle` degrees off the normal, after 2 + `phase`
    steps."""
    velocity = np.array([np.sin(np.radians(angle)), -np.cos(np.radians(angle))])
    return world(
        [[0.5, 0.01 - velocity[1] * step * (2 + phase)]], [velocity], [[spin]], **OBLIQUE, periodic=(True, False),
        law=law, material=constants(young_modulus=7e7, **material),
    )  # fmt: skip


def after_impact(scenes, step, steps=80):
    """Velocity (B, 2) and spin (B,) once the balls have left."""
    _, seen = track(batch(scenes), np.full(len(scenes), step), 1, steps)
    assert (seen.position[:, 0, 0, 1] > 0.01).all()
    return seen.velocity[:, 0, 0], seen.spin[:, 0, 0, 0]


@case("friction of a sliding impact", "contact", "impulse of rigid bodies, mu (1 + e) m v")
def sliding_impact() -> list[Figure]:
    """At 80 degrees off the normal the ball slides throughout: impulse of friction over mu times that of the normal
    force.

    Eight phases of the first step, twenty steps per contact; both laws; nearly plastic to nearly elastic [1 %].
    """
    figures, sine, cosine = [], np.sin(np.radians(80)), np.cos(np.radians(80))
    for law, name in ((None, "Hertz-Mindlin"), (LinearSpringDashpot(), "linear")):
        step, values = oblique_step(law), (0.9, 0.7, 0.5, 0.3, 0.1)
        scenes = [thrown(80, phase, step, law, restitution=e, friction=0.5) for e in values for phase in PHASES]
        velocity, _ = after_impact(scenes, step)
        ratio = (sine - velocity[:, 0]) / (0.5 * (velocity[:, 1] + cosine))
        for e, ratios in zip(values, ratio.reshape(len(values), -1), strict=True):
            worst = ratios[np.argmax(np.abs(ratios - 1.0))]
            figures.append(relative(f"{name}, e = {e}, worst of 8 phases", 1.0, worst, 0.01))
    return figures


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


@functools.cache
def drops():
    """The 18 drops of MFIX DEM01: their rows, steps, heights and speeds at every step."""
    rows = table("mfix_dem01_closed_form.csv")
    scenes = [dropped(float(row["kn"]), float(row["e"])) for row in rows]
    steps = np.pi * np.sqrt(drop_mass() / rows["kn"].astype(float)) / 100
    _, seen = track(batch(scenes), steps, DROP_FRAMES)
    return rows, steps, seen.position[:, :, 0, 1], seen.velocity[:, :, 0, 1]


@case("free fall", "contact", "x = h - g t^2/2")
def free_fall() -> list[Figure]:
    """Until the floor: the scheme is exact for a constant force, up to round-off."""
    _, steps, x, v = drops()
    place = speed = 0.0
    for k, step in enumerate(steps):
        number = int(0.28 / step)
        time = step * np.arange(1, number + 1)
        place = max(place, np.abs(x[k, :number] / (DROP_HEIGHT - GRAVITY * time**2 / 2) - 1.0).max())
        speed = max(speed, np.abs(v[k, :number] / (GRAVITY * time) + 1.0).max())
    return [below("relative error of the height", place, 1e-12), below("of the speed", speed, 1e-12)]


@case("MFIX DEM01: dropped sphere", "contact", "Garg et al. 2012, soft-sphere closed form")
def dem01() -> list[Figure]:
    """First contact, its duration, overlap, rebound and the next apex [0.1 %].

    Measured 0.05 % at most; with dashpots on the velocity at the start of the step 1.7 %.
    """
    figures = []
    for row, step, x, v in zip(*drops(), strict=True):
        begin, end, deepest = impact(DROP_RADIUS - x, -v, step)
        after = int(end / step) + 1  # frame j is at time (j + 1) step; `end` counts from frame 0
        rebound = np.sqrt(v[after] ** 2 + 2 * GRAVITY * (x[after] - DROP_RADIUS))
        apex = DROP_RADIUS + rebound**2 / (2 * GRAVITY)
        highest = x[after : after + int(2 * rebound / GRAVITY / step)].max()
        ours = {
            "t_first_contact_s": begin + step, "contact_duration_s": end - begin, "max_overlap_m": deepest,
            "v_rebound": rebound, "apex1_m": apex,
        }  # fmt: skip
        for name, value in ours.items():
            what = f"{name}, k_n {row['kn']:g}, e {row['e']:g}"
            figures.append(relative(what, row[name], value, 1e-3))
        figures.append(relative(f"highest frame, k_n {row['kn']:g}, e {row['e']:g}", apex, highest, 1e-3, "m"))
    return figures


def apexes(x):
    inner = (x[1:-1] >= x[:-2]) & (x[1:-1] > x[2:]) & (x[1:-1] > DROP_RADIUS)
    return x[1:-1][inner]


@case("MFIX DEM02: bounces", "contact", "soft-sphere closed form; MFIX's own heights")
def dem02() -> list[Figure]:
    """Heights of up to four bounces at k_n = 5e4 against the soft-sphere form [0.4 %].

    And against MFIX's own heights, which its larger Adams-Bashforth steps put up to 0.65 % from that form (e =
    0.6), with a gate of 0.7 %.
    """
    rows, _, x, _ = drops()
    theirs = table("mfix_dem02_bounce.csv")
    figures = []
    for k, row in enumerate(rows):
        if row["kn"] != 50000:
            continue
        speed, expected = np.sqrt(2 * GRAVITY * (DROP_HEIGHT - DROP_RADIUS)), []
        while len(expected) < 4 and (contact := soft_sphere(5e4, float(row["e"]), speed)) is not None:
            speed = contact[2]
            expected.append(DROP_RADIUS + speed**2 / (2 * GRAVITY))
        ours = apexes(x[k])[: len(expected)]
        mfix = theirs["height_MFIX_m"][(theirs["e"] == row["e"]) & (theirs["bounce"] > 0)]
        for n, (height, form) in enumerate(zip(ours, expected, strict=True), 1):
            figures.append(relative(f"bounce {n}, e {row['e']:g}", form, height, 4e-3, "m"))
            if n <= len(mfix):
                what = f"bounce {n}, e {row['e']:g}, MFIX"
                figures.append(relative(what, mfix[n - 1], height, 7e-3, "m"))
    return figures


# --- MFIX DEM03 and DEM04 ---------------------------------------------------------------------------------


@case("MFIX DEM03: two stacked particles", "contact", "Garg et al. 2012, its RK4 solution")
def dem03() -> list[Figure]:
    """Positions of two particles of different density between two walls [0.1 %].

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
    figures, start = [], np.array([[0.00045], [0.00135]])
    for k, e in enumerate(values):
        for p in range(2):
            rows = tables[p][tables[p]["e"] == e]
            x = np.concatenate([start[p], seen.position[k, :, p, 1]])
            v = np.concatenate([[0.0], seen.velocity[k, :, p, 1]])
            number = np.minimum((rows["t_s"] / step).astype(int), len(x) - 2)
            s = rows["t_s"] / step - number
            ours = hermite(x[number], v[number], x[number + 1], v[number + 1], step, s)
            worst = np.argmax(np.abs(ours / rows["pos_ode_m"] - 1.0))
            what = f"particle {p + 1}, e {e:g}, worst of {len(rows)} times"
            figures.append(relative(what, rows["pos_ode_m"][worst], ours[worst], 1e-3, "m"))
    return figures


@case("MFIX DEM04: slip to rolling", "contact", "Garg et al. 2012, closed form")
def dem04() -> list[Figure]:
    """A sliding sphere starts to roll at t = 2/7 u0 / (mu g) with 5/7 of its speed [0.6 %].

    r = 0.5 mm, 1e4 kg/m3, u0 = 0.1 m/s, k_n = k_t = 1e4 N/m, e = 1, mu = 0.2 ... 1. The sphere starts at its
    static overlap. Steps of a fiftieth of the contact's duration; the force is constant while it slides. MFIX's
    own figures are met to 1 %.
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
    figures = []
    for k, row in enumerate(rows):
        time = steps[k] * 50 * np.arange(1, 301) * row["mu"] * GRAVITY / speed
        u, roll = seen.velocity[k, :, 0, 0] / speed, -seen.spin[k, :, 0, 0] * radius / speed
        sliding, rolling = time < 0.2, time > 0.33
        slope, level = np.polyfit(time[sliding], u[sliding], 1)
        final = u[rolling].mean()
        ours = ((final - level) / slope, final, roll[rolling].mean())
        names = ("time", "speed", "rolling speed")
        exact, theirs = ("t_analytic", 5 / 7, 5 / 7), ("t_MFIX", "u_MFIX", "omega_r_MFIX")
        for name, got, form, mfix in zip(names, ours, exact, theirs, strict=True):
            form = row[form] if isinstance(form, str) else form
            figures.append(relative(f"{name}, mu {row['mu']:g}", form, got, 6e-3))
            figures.append(relative(f"{name}, mu {row['mu']:g}, MFIX", row[mfix], got, 1e-2))
    return figures
