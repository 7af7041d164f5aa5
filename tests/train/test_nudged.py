"""Runs that are nudged to a fine one: the law, the fields in time, and a run whose slip is known."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.closures import DragInputs, WenYu
from jaxdem.closures.nudged import NudgedDrag
from jaxdem.errors import InputError
from jaxdem.train.dataset_file import read_dataset
from jaxdem.train.nudged import Mixed, NudgedRun, Nudging, Reference
from tests.cases.tiers import COMBINATION

FALL, RISE = -0.02, 0.3
"""Velocities of grains and gas in the reference [m/s]."""


def _inputs() -> DragInputs:
    rows = jnp.zeros((2, 2))
    fluid = jnp.array([[0.0, 0.2], [0.1, 0.3]])
    numbers = (jnp.asarray(value, jnp.float32) for value in (75e-6, 1.8e-3, 1.3, 1.8e-5))
    return DragInputs(rows, fluid, jnp.array([0.05, 0.1]), rows, rows, *numbers, jnp.full(2, 0.06))


def test_without_nudging_it_is_the_law_itself():
    inputs = _inputs()
    drag, base = NudgedDrag.of(WenYu(), 2, 2)(inputs), WenYu()(inputs)
    np.testing.assert_array_equal(drag.coefficient, base.coefficient)
    np.testing.assert_array_equal(drag.remainder, 0.0)


def test_the_force_is_the_law_and_what_the_wrong_slip_and_the_push_add():
    """k c w + s c (w - w_r) + f; at the slip of the fine run without a push it is k times the law for any s."""
    inputs = _inputs()
    c, w = np.asarray(WenYu()(inputs).coefficient)[:, None], np.asarray(inputs.slip_velocity)
    wanted, push = np.array([[0.0, 0.25], [0.0, 0.2]], np.float32), np.full((2, 2), 1e-9, np.float32)
    law = dataclasses.replace(
        NudgedDrag.of(WenYu(), 2, 2), factor=jnp.asarray(0.7), stiffness=jnp.asarray(3.0), slip=wanted, push=push
    )
    drag = law(inputs)
    force = np.asarray(drag.coefficient)[:, None] * w + np.asarray(drag.remainder)
    np.testing.assert_allclose(force, 0.7 * c * w + 3.0 * c * (w - wanted) + push, rtol=1e-5)
    drag = dataclasses.replace(law, slip=inputs.slip_velocity, push=0.0 * push)(inputs)
    np.testing.assert_allclose(np.asarray(drag.coefficient)[:, None] * w + drag.remainder, 0.7 * c * w, rtol=1e-5)


def _fields(rise: float) -> Mixed:
    solids = jnp.full((4, 4), 0.05)
    gas = jnp.zeros((4, 4, 2)).at[..., 1].set(rise)
    return Mixed(gas, solids, jnp.stack([0.0 * solids, FALL * solids], axis=-1))


def test_fields_between_two_samples_are_in_proportion_and_the_slip_is_gas_less_grains():
    one, two = _fields(0.1), _fields(0.3)
    fields = Mixed(*(jnp.stack(pair) for pair in zip(one, two, strict=True)))
    reference = Reference(jnp.array([1.0, 2.0]), fields)
    for time, rise in ((0.0, 0.1), (1.0, 0.1), (1.25, 0.15), (2.0, 0.3), (9.0, 0.3)):
        np.testing.assert_allclose(reference.at(jnp.asarray(time)).slip, [0.0, rise - FALL], atol=1e-6)


@pytest.mark.parametrize("wrong", [Nudging(-1.0, 1.0), Nudging(0.0, 0.0), Nudging(0.0, 1.0, -1.0)])
def test_numbers_out_of_range_are_refused(wrong):
    with pytest.raises(InputError):
        wrong.check()


@COMBINATION
def test_a_run_gets_the_slip_of_the_fine_one_by_the_box_and_by_the_cells():
    """The factor finds the slip of the reference, which the run has not by itself, and the samples have it: mean force
    over mean force of the law. Drawn in every cell, parcels see more nearly the slip of the reference than without, and
    their velocities, which are even in the reference, differ less."""
    from benchmarks.clusters_runs import Case

    case = Case(0.05, 24.0, box=(96, 96), parcel=4, step=5e-4)
    scene = case.scene()
    simulation, parameters = jaxdem.build(scene, closure=NudgedDrag.of(WenYu(), case.count, 2))
    start = jaxdem.initial_state(scene, simulation, parameters)
    fields = Mixed(*(jnp.stack([field, field]) for field in _fields(RISE)))
    run = NudgedRun(simulation, parameters, Reference(jnp.array([0.0, 1.0]), fields))
    found, seen, spread = {}, {}, {}
    for control in (5e-3, np.inf):
        rows, series = run.samples(Nudging(0.0, np.inf, control), *start, 20, 11)
        late = series["time"] > 0.055
        found[control] = series["slip"][late, 1].mean() / (RISE - FALL)
        own = rows["time"] > 0.055
        quotient = rows["target_force"][own, 1].sum() / rows["drag_force"][own, 1].sum()
        assert quotient == pytest.approx(series["factor"][late].mean(), rel=0.03)
        assert len(rows["time"]) == 20 * case.count
    assert found[5e-3] == pytest.approx(1.0, abs=0.02)
    assert abs(found[np.inf] - 1.0) > 0.1
    for name, nudging in (("cells", Nudging(3.0, 5e-3)), ("none", Nudging(0.0, np.inf))):
        rows, _ = run.samples(nudging, *start, 20, 11)
        own = rows["time"] > 0.055
        seen[name] = abs((rows["fluid_velocity"] - rows["particle_velocity"])[own, 1].mean() - (RISE - FALL))
        spread[name] = rows["particle_velocity"][own, 1].std()
    assert seen["cells"] < 0.6 * seen["none"]
    assert spread["cells"] < 0.8 * spread["none"]
    with pytest.raises(InputError, match="cannot be nudged"):
        NudgedRun(simulation, parameters._replace(closure=WenYu()), run.reference)
    sizes = parameters.bodies._replace(density=parameters.bodies.density * np.linspace(1.0, 1.1, case.count))
    with pytest.raises(InputError, match="several masses"):
        NudgedRun(simulation, parameters._replace(bodies=sizes), run.reference)


@COMBINATION
def test_the_steps_of_the_page_make_a_dataset(tmp_path, monkeypatch):
    """The Python code of docs/learned_closures.md, on a fine run and a nudged one that are short."""
    root = Path(__file__).parents[2]
    page = (root / "docs" / "learned_closures.md").read_text(encoding="utf-8")
    (steps,) = (code for code in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "NudgedRun" in code)
    (tmp_path / "scenes").symlink_to(root / "scenes")
    monkeypatch.chdir(tmp_path)
    changes = {"time.end": 0.01, "output.samples": 0.005}
    jaxdem.simulate(jaxdem.load_scene("scenes/clusters_demo.toml", changes), "runs/fine")
    names: dict[str, object] = {}
    exec(steps.replace("outputs=20", "outputs=2"), names)
    found = read_dataset("runs/nudged.h5")
    assert (found.run, found.drag, list(found.groups)) == ("fine", "wen_yu", [4])
    assert len(names["rows"]["time"]) == 2 * 688
