"""The examples of the page on extending do what they say; the page of keys and the tables of the study are current."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pydantic import Field

from jaxdem import InputError, build, load_scene
from jaxdem.numerics.static import static
from jaxdem.scene.base import Section
from tests.cases.jax_md_alone import light_jax_md

ROOT = Path(__file__).parent.parent


def load(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def quickly_compiled():
    """Tiny scenes: compiling takes far longer than running, so it is done with few optimisations."""
    before = jax.config.read("jax_disable_most_optimizations")
    jax.config.update("jax_disable_most_optimizations", True)
    yield
    jax.config.update("jax_disable_most_optimizations", before)


def extending(name):
    return load(ROOT / "examples" / "extending" / f"{name}.py").main()


def test_a_drag_law_of_ones_own(quickly_compiled):
    found, expected = extending("drag_law")
    assert found == pytest.approx(expected, rel=0.01)  # the cell hides about 0.5 % of the slip


def test_a_contact_law_of_ones_own(quickly_compiled):
    found, expected = extending("contact_law")
    assert found == pytest.approx(expected, rel=1e-3)


def test_a_force_of_ones_own(quickly_compiled):
    found, expected, momentum = extending("force")
    assert found == pytest.approx(expected, rel=0.01)  # the cell hides about 0.5 % of the slip
    assert abs(momentum) < 1e-3  # they have none together: the fluid loses what the swimmer gets


def test_forces_of_ones_own_that_nothing_feels_are_refused():
    force = load(ROOT / "examples" / "extending" / "force.py")
    dry = {name: table for name, table in force.SCENE.items() if name not in ("fluid", "coupling")}
    thrust = force.Thrust(size=1e-7)
    for tables, forces, reason in (
        (dry, [thrust], "which the scene has not"),
        (force.SCENE, [thrust] * 2, "another force"),
    ):
        with pytest.raises(InputError, match=reason):
            build(load_scene(tables), forces=forces)


def test_what_a_force_remembers_has_a_row_for_every_particle():
    """(..., N, C): arrays of other shapes would be cut in the wrong place, on several devices or at a start."""
    force = load(ROOT / "examples" / "extending" / "force.py")

    @static
    class Remembering(force.Thrust):
        remembered: Any = None

        def start(self, slip):
            return self.remembered(slip)

    def built(start):
        return build(load_scene(force.SCENE), forces=[Remembering(size=1e-7, remembered=start)])

    built(lambda slip: {"past": jnp.zeros((4, *slip.shape)), "age": slip[:, :1]})
    for start, name in (
        (lambda slip: slip[:, 0], r"forces\.thrust\.start = \(7,\)"),
        (lambda slip: {"past": jnp.zeros((len(slip), 4, 2))}, r"forces\.thrust\.start\['past'\] = \(7, 4, 2\)"),
    ):
        with pytest.raises(InputError, match=f"{name}.*\\(N, 1\\)"):
            built(start)


def test_a_cohesion_of_ones_own():
    """Adhesive elastic spheres against Thornton & Ning: they stick below the sticking speed and rebound above. At 1.1
    times it an error of 1 % in the work of the neck would be one of 0.01 in the restitution."""
    found, expected = extending("cohesion")
    assert found[0] == expected[0] == 0.0
    np.testing.assert_allclose(found[1:], expected[1:], atol=0.01)


def test_a_wall_of_ones_own(quickly_compiled):
    position, gap = extending("wall")
    elastic = -(((0.75 * 0.1027 * 2 * 0.91) / (1e6 * 0.1)) ** (2.0 / 3.0))  # Hertz under the grain's weight
    assert gap == pytest.approx(elastic, rel=0.02)
    assert position[:, 0] == pytest.approx([0.09, 0.11], abs=2e-4)  # beside each other, in the trough


def test_an_inlet_profile_of_ones_own(quickly_compiled):
    inflow, rate = extending("inlet_profile")
    assert rate == pytest.approx(0.1, rel=1e-6)
    assert inflow.max() == pytest.approx(0.5 * 8 / 7, rel=0.03)
    assert np.all(np.diff(inflow[: len(inflow) // 2]) > 0.0)


def test_a_kind_of_side_of_ones_own(quickly_compiled):
    found, expected = extending("slip_wall")
    assert found == pytest.approx(expected, rel=1e-4)  # the scheme is exact for a line; float32


def test_neighbour_lists_of_jax_md(quickly_compiled):
    with light_jax_md(), jax.numpy_rank_promotion("allow"):  # jax-md relies on it
        found, expected, made = extending("jax_md_list")
    assert made == 0  # jax-md's lists were all that the contacts saw
    assert (
        np.ptp(expected[:, 0]) > 0.2 and expected[:, 1].max() < 0.09
    )  # some have crossed the side, all have come down
    # Sums in another order, after some collisions of each.
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_every_key_of_a_scene_is_described():
    reference = load(ROOT / "docs" / "tools" / "scene_reference.py")
    text = reference.markdown()
    assert "| `viscosity` | number ≥ 0 | m²/s | `1e-06` | Kinematic viscosity. |" in text
    assert "## `[[particles.inlet]]`" in text
    page = reference.PAGE.read_text(encoding="utf-8")
    assert page == reference.filled(page), "run python docs/tools/scene_reference.py"
    assert "## `[[walls]]`" in page and "| `apex` | list of numbers | m |" in page

    class Undescribed(Section):
        """A table.

        Attributes:
            known: of the table [m].
        """

        known: float = 0.0
        forgotten: float = Field(default=0.0)

    with pytest.raises(ValueError, match="forgotten"):
        list(reference.rows(Undescribed))


def test_tables_of_the_study_are_its_numbers():
    tables = load(ROOT / "docs" / "tools" / "study_tables.py")
    page = tables.PAGE.read_text(encoding="utf-8")
    numbers = json.loads(tables.NUMBERS.read_text(encoding="utf-8"))["parts"]
    assert len(tables.MARKED.findall(page)) > 10
    assert page == tables.filled(page, numbers)
