"""One device compiles the program without slabs: no code of theirs is even run while it is traced."""

import sys
from pathlib import Path

import jax
import pytest

import jaxdem
from jaxdem.numerics import blocks
from tests.cases.fluid_slabs import ALONG_X, FLUIDS, coupled_scene

PACKAGE = Path(jaxdem.__file__).parent
PATTERNS = ("devices/*.py", "particles/ghosts.py", "particles/slab_*.py", "particles/migration.py", "fluid/slabs.py")
OF_SLABS = {str(path) for pattern in PATTERNS for path in PACKAGE.glob(pattern)}
PASS_ON = {"total", "largest", "any_of", "all_of"}
"""Functions of `numerics.blocks` that give back what they are given where there are no slabs; see test_blocks.py."""

SCENES = {
    "grains and a fluid": coupled_scene(2, ALONG_X, virtual_mass=0.5, lift=["magnus"], rotational_drag=True),
    "a fluid": FLUIDS["jet"],
}


def lowered(simulation, parameters, state, neighbors):
    """Text of the program of an interval, and the functions of slabs that were called for it."""
    called = set()

    def seen(frame, event, _):
        code = frame.f_code
        own = code.co_filename == blocks.__file__
        passed_on = own and code.co_name in PASS_ON and frame.f_locals.get("blocks", blocks) is None
        if event == "call" and (code.co_filename in OF_SLABS or own) and not passed_on:
            called.add(f"{Path(code.co_filename).stem}.{code.co_name}")

    jax.clear_caches()
    sys.setprofile(seen)
    try:
        text = jax.jit(lambda p, s, n: simulation.step(p, s, n)).lower(parameters, state, neighbors).as_text()
    finally:
        sys.setprofile(None)
    return text, called


@pytest.mark.parametrize(("name", "reversible"), [("grains and a fluid", False), ("a fluid", True)])
def test_one_device_runs_no_code_of_slabs(name, reversible):
    """So its program does not depend on that code. With slabs the same look sees it called.

    Texts of earlier programs cannot be kept for this: they change with JAX, and where code is moved. When the stencils
    learned of slabs some slices were traced twice, which XLA joins again, and in reversible loops the weights of
    measured sides became arguments of the loop: other texts, with the same arithmetic.
    """
    scene = jaxdem.load_scene(SCENES[name])
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    assert neighbors is None or (neighbors.ghosts is None and state.particles.identity is None)
    text, called = lowered(simulation.reversible() if reversible else simulation, parameters, state, neighbors)
    assert not called
    assert not any(word in text for word in ("collective", "all_reduce", "all_to_all", "partition_id", "manual"))
    if state.particles is None:
        divided, _ = jaxdem.build(scene, devices=2)
        assert lowered(divided, parameters, *jaxdem.initial_state(scene, divided, parameters))[1]
