"""Gradients through a wall that a force holds in the fluid and that rides on a given motion, against differences."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxdem
from jaxdem.fluid import cut_projection, surface_response
from tests.cases.pistons_in_fluid import scene_of
from tests.cases.tiers import COMBINATION

NAMES = ("force", "mass", "place", "speed", "density", "viscosity")
STEPS = 4

BODY = {
    "kind": "cylinder", "center": [0.11, 0.083], "radius": 0.045, "inside": False, "fluid": "no_slip",
    "motion": [{"kind": "table", "times": [0.0, 1.0], "displacement": [0.004, 0.05], "direction": [0.6, 0.8]}],
    "piston": {"direction": [1.0, 0.0], "force": 2.0, "mass": 0.05},
}  # fmt: skip
SIDES = {"right": {"kind": "outlet"}, "top": {"kind": "free_slip"}, "bottom": {"kind": "free_slip"}}


@COMBINATION
def test_gradient_of_a_body_that_a_force_holds_in_the_fluid(monkeypatch):
    """Of where body and grain are after four intervals, and of the fluid's speed across, by the force, the mass, the
    place and the given speed of the body, and density and viscosity of the fluid.

    The flux that carries momentum within a step keeps the volume to 1e-3 only, see `cut_projection`. Differences are
    those of the solves that stop there, and the gradient is that of exact ones: 2e-6 of the largest slope apart. Here
    all solves are exact.
    """
    monkeypatch.setattr(cut_projection, "FLUX_TOLERANCE", 1e-12)
    monkeypatch.setattr(surface_response, "TOLERANCE", 1e-11)
    grain = {"position": [[0.21, 0.11]], "density": 2000.0}
    given = scene_of(BODY, [0.3, 0.2], [9, 6], boundary=SIDES, fluid={"viscosity": 1e-3}, particles=grain)
    scene = jaxdem.load_scene(given)
    simulation, parameters = jaxdem.build(scene)
    start, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    (piston,), ((motion,),) = parameters.pistons, parameters.wall_motion
    first, way = motion["values"][0], motion["values"] - motion["values"][0]

    def observed(factor):
        held = piston._replace(force=piston.force * factor[0], mass=piston.mass * factor[1])
        placed = {"values": first * factor[2] + way * factor[3]}
        fluid = parameters.fluid._replace(
            density=parameters.fluid.density * factor[4], viscosity=parameters.fluid.viscosity * factor[5]
        )
        changed = parameters._replace(pistons=(held,), wall_motion=((placed,),), fluid=fluid)
        found = jaxdem.rollout(simulation, changed, start, neighbors, STEPS)
        particles = found.state.particles
        moved = particles.pistons.displacement[0] + particles.position[0, 0] - start.particles.position[0, 0]
        return 1e3 * (moved + jnp.mean(found.state.fluid.face_velocity[1] ** 2)), found.failures

    compiled = jax.jit(jax.value_and_grad(observed, has_aux=True))
    (value, code), slope = compiled(jnp.ones(len(NAMES)))
    assert int(code) == 0
    for k, name in enumerate(NAMES):
        shift = 1e-4 * np.eye(len(NAMES))[k]
        difference = (float(compiled(1.0 + shift)[0][0]) - float(compiled(1.0 - shift)[0][0])) / 2e-4
        np.testing.assert_allclose(float(slope[k]), difference, rtol=1e-6, err_msg=name)
        assert abs(float(slope[k])) > 0.02 * abs(float(value)), f"{name} matters"
