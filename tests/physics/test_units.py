"""A scene in other units of length, mass and time: no number in the program has a unit of its own."""

import jax
import numpy as np
import pytest

from jaxdem import build, initial_state, load_scene

PLACES = np.array([[0.05, 0.03], [0.09, 0.032], [0.13, 0.04], [0.06, 0.07], [0.0801, 0.07], [0.15, 0.09]])
KINDS = {
    "bridges": lambda of: {"contact": {"cohesion": {
        "kind": "capillary", "surface_tension": of(2.0, 0, 1, -2), "contact_angle": 0.2, "liquid_content": 0.02,
        "liquid_viscosity": of(0.1, -1, 1, -1), "minimum_gap": of(1e-4, 1)}}},
    "lubrication and bonds": lambda of: {
        "contact": {"lubrication": {"cutoff": of(2e-3, 1), "roughness": of(1e-4, 1), "viscosity": of(0.5, -1, 1, -1)}},
        "bonds": [{"pairs": [[3, 4]], "young_modulus": of(2e6, -1, 1, -2), "shear_modulus": of(8e5, -1, 1, -2),
                   "damping": 0.1, "tensile_strength": of(3e4, -1, 1, -2)}]},
}  # fmt: skip


def end_of(kind, length, mass, time):
    """Position, velocity, spin and contact force after 12 intervals, in the units of the first scene; units as
    multiples of which its numbers are given."""

    def of(value, in_length=0, in_mass=0, in_time=0):
        return (np.asarray(value) * (length**in_length * mass**in_mass * time**in_time)).tolist()

    velocity = np.random.default_rng(1).uniform(-0.3, 0.3, PLACES.shape)
    own = KINDS[kind](of)
    scene = load_scene({
        "precision": "float64",
        "domain": {"size": of([0.2, 0.12], 1), "depth": of(0.02, 1), "gravity": of([0.0, -9.81], 1, 0, -2)},
        "particles": {"density": of(2000.0, -3, 1), "radius": of(0.01, 1), "position": of(PLACES, 1),
                      "velocity": of(velocity, 1, 0, -1), "angular_velocity": of(20.0 * velocity[:, 0], 0, 0, -1)},
        "contact": {"young_modulus": of(1e6, -1, 1, -2), "friction": 0.4, "restitution": 0.6,
                    "speed": of(1.0, 1, 0, -1), "rolling_friction": 0.1, "rolling_model": "epsd"} | own.pop("contact"),
        "walls": [{"kind": "plane", "point": of([0.1, 0.015], 1), "normal": [0.0, 1.0], "motion": [
            {"kind": "oscillation", "direction": [0.0, 1.0], "amplitude": of(0.01, 1), "frequency": of(4.0, 0, 0, -1)},
            {"kind": "rotation", "center": of([0.1, 0.01], 1), "rate": of(0.5, 0, 0, -1)}]}],
        "coupling": {"interval": of(0.005, 0, 0, 1)},
        "time": {"end": of(0.4, 0, 0, 1), "output_interval": of(0.01, 0, 0, 1)},
    } | own)  # fmt: skip
    simulation, parameters = build(scene)
    state, neighbors = initial_state(scene, simulation, parameters)
    step = jax.jit(simulation.step)
    for _ in range(12):
        state, neighbors, _ = step(parameters, state, neighbors)
    found, force = state.particles, length * mass / time**2
    return [
        np.asarray(found.position) / length,
        np.asarray(found.velocity) * (time / length),
        np.asarray(found.angular_velocity) * time,
        np.asarray(found.contact_force) / force,
    ]


@pytest.mark.parametrize("kind", KINDS)
def test_a_scene_is_the_same_in_other_units(kind):
    """To rounding, which contacts enlarge; grains have touched each other and the plane that moves."""
    plain, other = end_of(kind, 1.0, 1.0, 1.0), end_of(kind, 1000.0, 8.0, 0.25)
    for one, same in zip(plain, other, strict=True):
        assert np.abs(one - same).max() < 1e-10 * np.abs(one).max()
    assert np.abs(plain[3]).max() > 1e-3
