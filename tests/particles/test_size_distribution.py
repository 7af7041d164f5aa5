"""Sizes by a distribution: the law of what is drawn, by number and by volume, in packs and through inlets."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import integrate, stats

import jaxdem
from jaxdem.errors import InputError
from jaxdem.particle_step import renewed_particles
from jaxdem.scene.distribution import Distribution
from jaxdem.setup.distribution import radii
from jaxdem.setup.particles import particle_setup

DRAWS = 100_000
LEVEL = 0.01

LAWS = {
    "normal": {"kind": "normal", "mean": 1e-3, "standard_deviation": 2e-4, "lower": 7e-4, "upper": 1.6e-3},
    "lognormal": {"kind": "lognormal", "median": 1e-3, "log_standard_deviation": 0.4, "lower": 4e-4, "upper": 2e-3},
    "weibull": {"kind": "weibull", "scale": 1e-3, "shape": 2.5, "lower": 3e-4, "upper": 2e-3},
    "weibull steep": {"kind": "weibull", "scale": 1e-3, "shape": 6.0, "lower": 3e-4, "upper": 2e-3},
    "table": {"kind": "table", "radii": [4e-4, 6e-4, 9e-4, 1.5e-3], "cumulative": [0.0, 0.3, 0.8, 1.0]},
    "cut table": {"kind": "table", "diameters": [8e-4, 1.2e-3, 1.8e-3, 3e-3], "cumulative": [0.0, 0.3, 0.8, 1.0],
                  "lower": 5e-4, "upper": 1.2e-3},
}  # fmt: skip
OTHER = {
    "normal": {"mean": 1.02e-3},
    "lognormal": {"log_standard_deviation": 0.43},
    "weibull": {"shape": 2.6},
    "weibull steep": {"scale": 1.01e-3},
    "table": {"cumulative": [0.0, 0.32, 0.8, 1.0]},
    "cut table": {"lower": 5.1e-4},
}
"""A slightly different law of each kind."""


def density(law, r):
    """By number or volume as it is given, not normalised; from scipy's distributions."""
    if law["kind"] == "normal":
        return stats.norm(law["mean"], law["standard_deviation"]).pdf(r)
    if law["kind"] == "lognormal":
        return stats.lognorm(law["log_standard_deviation"], scale=law["median"]).pdf(r)
    if law["kind"] == "weibull":
        return stats.weibull_min(law["shape"], scale=law["scale"]).pdf(r)
    sizes = np.asarray(law["radii"]) if "radii" in law else 0.5 * np.asarray(law["diameters"])
    k = np.clip(np.searchsorted(sizes, r, side="right") - 1, 0, len(sizes) - 2)
    return (np.diff(law["cumulative"]) / np.diff(sizes))[k]


def cumulative(law, weighting):
    """The truncated distribution by number of a law that is given by `weighting`: trapezoids on 200,001 points."""
    sizes = law.get("radii") or [0.5 * d for d in law.get("diameters", ())]
    lower, upper = law.get("lower") or sizes[0], law.get("upper") or sizes[-1]
    r = np.linspace(lower, upper, 200_001)
    number = density(law, r) / (r**3 if weighting == "volume" else 1.0)
    below = integrate.cumulative_trapezoid(number, r, initial=0.0)
    return lambda x: np.interp(x, r, below / below[-1])


def draws(law, weighting, seed=7):
    u = np.random.default_rng(seed).uniform(size=DRAWS)
    return radii("particles.distribution", Distribution.model_validate(law | {"by": weighting}), u)


@pytest.mark.parametrize("weighting", ["number", "volume"])
@pytest.mark.parametrize("name", LAWS)
def test_kolmogorov_and_smirnov_tell_the_law_from_its_neighbours(name, weighting):
    """What is drawn has the law given at the level of 1 %; one of another parameter or weighting is rejected."""
    law, found = LAWS[name], draws(LAWS[name], weighting)
    assert stats.kstest(found, cumulative(law, weighting)).pvalue > LEVEL
    assert stats.kstest(found, cumulative(law | OTHER[name], weighting)).pvalue < LEVEL
    other = "number" if weighting == "volume" else "volume"
    assert stats.kstest(found, cumulative(law, other)).pvalue < LEVEL


def test_a_cut_renormalises_and_does_not_gather():
    """Half of a normal distribution: its mean is sqrt(2 / pi) deviations above the cut, and none lies on a cut."""
    law = {"kind": "normal", "mean": 1e-3, "standard_deviation": 1e-4, "lower": 1e-3, "upper": 2e-3}
    found = draws(law, "number")
    assert found.min() >= 1e-3 and found.max() <= 2e-3 and len(np.unique(found)) > 0.999 * DRAWS
    error = 1e-4 * np.sqrt((1.0 - 2.0 / np.pi) / DRAWS)
    assert abs(found.mean() - (1e-3 + 1e-4 * np.sqrt(2.0 / np.pi))) < 4.0 * error


def test_far_cut_offs_change_nothing():
    """In closed form: Hatch and Choate; a Weibull one by volume has (r / scale)^k ~ Gamma(1 - 3/k) for shape k > 3."""
    u = np.linspace(1e-3, 1.0 - 1e-3, 999)
    tables = LAWS["lognormal"] | {"by": "volume", "log_standard_deviation": 0.3, "lower": 1e-5, "upper": 1e-2}
    law = Distribution.model_validate(tables)
    exact = stats.lognorm(0.3, scale=1e-3 * np.exp(-3.0 * 0.3**2)).ppf(u)
    np.testing.assert_allclose(radii("", law, u), exact, rtol=1e-6)
    law = Distribution.model_validate(LAWS["weibull steep"] | {"by": "volume", "lower": 1e-9, "upper": 1e-2})
    exact = 1e-3 * stats.gamma(0.5).ppf(u) ** (1.0 / 6.0)
    np.testing.assert_allclose(radii("", law, u), exact, rtol=1e-5)


PACK = {
    "seed": 3,
    "domain": {"size": [0.1, 0.1]},
    "particles": {
        "count": 700, "density": 2500.0, "distribution": LAWS["table"],
        "pack": {"kind": "lattice", "start": [0.0, 0.0], "stop": [0.1, 0.1]},
    },
    "contact": {"young_modulus": 1e6, "speed": 1.0},
    "time": {"end": 0.02, "output_interval": 0.01},
}  # fmt: skip


def scene(**particles):
    """The scene of a pack with other keys; None removes one."""
    table = {key: value for key, value in (PACK["particles"] | particles).items() if value is not None}
    return jaxdem.load_scene(PACK | {"particles": table})


def setup(**particles):
    found = particle_setup(scene(**particles))
    assert found is not None
    return found


def volume_below(radius, sizes):
    """Fraction by volume of spheres below each size."""
    return np.asarray([(radius[radius <= size] ** 3).sum() for size in sizes]) / (radius**3).sum()


@pytest.mark.parametrize("kind", ["lattice", "random", "grown"])
def test_a_pack_keeps_its_sieve_curve(kind):
    """By volume within 1 %, in 2-D too, where the particles are spheres; and none overlaps."""
    particles = setup(pack={"kind": kind, "start": [0.0, 0.0], "stop": [0.1, 0.1]})
    radius, law = particles.bodies.radius, LAWS["table"]
    assert particles.position.shape == (700, 2) and radius.shape == (700,)
    np.testing.assert_allclose(volume_below(radius, law["radii"]), law["cumulative"], atol=0.01)
    assert stats.kstest(radius, cumulative(law, "volume")).pvalue > LEVEL
    assert stats.kstest(radius, cumulative(law, "number")).pvalue < LEVEL
    x = particles.position
    gap = np.linalg.norm(x[:, None] - x, axis=2) - radius[:, None] - radius + np.eye(len(x))
    assert gap.min() > 0.0


def test_the_seed_decides_and_species_share_one_law():
    """Radii are those of the seed; the density of a species says nothing about its size."""
    species = [{"share": 0.5, "density": 1000.0}, {"share": 0.5, "density": 4000.0}]
    first, again = setup(species=species, density=None).bodies, setup().bodies
    np.testing.assert_array_equal(first.radius, again.radius)
    assert not np.array_equal(first.radius, particle_setup(scene().model_copy(update={"seed": 4})).bodies.radius)
    light = first.density == 1000.0
    assert light.sum() == 350
    assert stats.ks_2samp(first.radius[light], first.radius[~light]).pvalue > LEVEL


def test_one_size_stays_one_number():
    """A scene without a distribution has no radius per particle in its program; one with has."""
    for particles, dimensions in (({"distribution": None, "radius": 1e-3}, 0), ({}, 1)):
        assert setup(**particles).bodies.radius.ndim == dimensions


INLET = {"start": [0.02, 0.02], "stop": [0.08, 0.08], "velocity": [0.0, -1.0], "distribution": LAWS["table"]}


@pytest.mark.parametrize("flow", ["rate", "mass_flow"])
def test_an_inlet_draws_every_arrival(flow):
    """A mass flow brings its mass to within a grain; a rate its number; both with the law by number of the table."""
    number, law = 20_000, LAWS["table"]
    whole = {"rate": number / 0.02, "mass_flow": 0.1 / 0.02}[flow]
    inlet = INLET | {flow: whole}
    coming = setup(count=None, pack=None, distribution=None, radius=1e-3, inlet=[inlet]).arrivals[0]
    radius, mass = coming.bodies.radius, 4.0 / 3.0 * np.pi * coming.bodies.radius**3 * 2500.0
    assert stats.kstest(radius, cumulative(law, "volume")).pvalue > LEVEL
    assert stats.kstest(radius, cumulative(law, "number")).pvalue < LEVEL
    assert (np.diff(coming.time) > 0.0).all() and coming.time[-1] <= 0.02 * (1.0 + 1e-9)
    if flow == "rate":
        assert len(radius) == number
    else:
        assert 0.0 <= 0.1 - mass.sum() < mass.max()


def test_a_crowded_inlet_keeps_the_law():
    """Who finds no room waits and nobody overtakes: those who have come are the first that were drawn."""
    inlet = INLET | {"rate": 40_000.0, "stop": [0.05, 0.05]}
    tables = scene(count=None, pack=None, distribution=None, radius=1e-3, inlet=[inlet])
    simulation, parameters = jaxdem.build(tables)
    state, neighbors = jaxdem.initial_state(tables, simulation, parameters)
    renew = jax.jit(lambda p, n, k: renewed_particles(simulation, parameters, p, n, k))
    particles = state.particles
    for step in range(1, 3):
        particles, neighbors = renew(particles, neighbors, jnp.int32(step))
    came, radius = np.asarray(particles.active), np.asarray(parameters.bodies.radius)
    assert int(simulation.population.waiting(particles.inserted, jnp.int32(2))) > 200 < came.sum()
    np.testing.assert_array_equal(came, np.arange(len(came)) < came.sum())
    assert stats.kstest(radius[came], cumulative(LAWS["table"], "volume")).pvalue > LEVEL
    assert stats.kstest(radius[came], cumulative(LAWS["table"], "number")).pvalue < LEVEL


def test_inlets_without_sizes_follow_the_particles():
    """A radius of the inlet goes before the distribution of the particles, that before nothing."""
    inlet = {key: value for key, value in INLET.items() if key != "distribution"} | {"rate": 1e4}
    assert setup(count=None, pack=None, inlet=[inlet]).bodies.radius.shape == (200,)
    assert setup(count=0).bodies.radius.shape == ()
    both = setup(inlet=[inlet, inlet | {"radius": 2e-3}])
    assert len(np.unique(both.arrivals[0].bodies.radius)) == 200
    np.testing.assert_array_equal(both.arrivals[1].bodies.radius, 2e-3)


NORMAL = LAWS["normal"]


@pytest.mark.parametrize(
    ("particles", "key", "words"),
    [
        ({"radius": 1e-3}, "particles.radius", "together with the distribution"),
        ({"species": [{"share": 1.0, "radius": 1e-3}]}, "particles.species.0.radius", "together with the distribution"),
        ({"inlet": [INLET | {"rate": 1.0, "radius": 1e-3}]}, "particles.inlet.0.radius", "together with"),
        ({"distribution": NORMAL | {"median": 1e-3}}, "particles.distribution.median", "a normal distribution needs"),
        ({"distribution": NORMAL | {"mean": None}}, "particles.distribution.mean", "needs mean, standard_deviation"),
        ({"distribution": NORMAL | {"upper": None}}, "particles.distribution.upper", "time step"),
        ({"distribution": NORMAL | {"upper": 1e-4}}, "particles.distribution.upper", "must be above lower"),
        ({"distribution": LAWS["table"] | {"upper": 3e-3}}, "particles.distribution.upper", "must lie in the table"),
        ({"distribution": LAWS["table"] | {"cumulative": [0.0, 0.3, 0.8, 0.9]}},
         "particles.distribution.cumulative", "begin with 0 and end with 1"),
        ({"distribution": LAWS["table"] | {"cumulative": [0.0, 0.8, 0.3, 1.0]}},
         "particles.distribution.cumulative", "must not fall"),
        ({"distribution": LAWS["table"] | {"diameters": [1e-3, 2e-3]}}, "particles.distribution.radii", "either radii"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(particles, key, words):
    table = PACK["particles"] | particles
    if isinstance(table["distribution"], dict):
        table["distribution"] = {k: v for k, v in table["distribution"].items() if v is not None}
    with pytest.raises(InputError, match=words) as refused:
        jaxdem.load_scene(PACK | {"particles": table})
    assert refused.value.key == key


def test_cut_offs_far_from_the_distribution_are_refused():
    """A slip of the unit: the mean in mm."""
    with pytest.raises(InputError, match="lies between lower and upper") as refused:
        setup(distribution=NORMAL | {"mean": 1.0}).bodies  # noqa: B018
    assert refused.value.key == "particles.distribution"


def test_the_scene_that_is_written_reads_back():
    """With the defaults of the table written out."""
    first = scene()
    assert jaxdem.load_scene(first.tables()) == first
    assert first.tables()["particles"]["distribution"]["by"] == "volume"
