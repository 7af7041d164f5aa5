"""Exported closures against the closures themselves: C compiled here, ONNX in onnxruntime, StableHLO called back."""

import ctypes
import dataclasses
import shutil
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import onnx
import onnxruntime
import pytest

from jaxdem.closures import (
    ACTIVATIONS,
    DRAG_LAWS,
    Drag,
    DragInputs,
    EnsembleClosure,
    InvariantClosure,
    PaperNetwork,
)
from jaxdem.closures.base import sees_wide
from jaxdem.closures.export import export_closure, identifier
from jaxdem.closures.export_c import c_header
from jaxdem.closures.export_onnx import onnx_model
from jaxdem.closures.export_trace import ExportedDrag, input_shapes, one_particle
from jaxdem.closures.invariant import TERMS, WIDE, WITHOUT_PRESSURE
from jaxdem.errors import InputError

COMPILER = shutil.which("cc")
ROWS = 400
ROW_NAMES = (
    "particle_velocity",
    "fluid_velocity",
    "solid_fraction",
    "void_fraction_gradient",
    "pressure_gradient",
)


def inputs_for(dimension, seed=0, wide=False):
    """Inputs of all sizes in float32: random ones, still ones, packed beyond every law, far out of any range."""
    generator = np.random.default_rng(seed)

    def vectors(scale):
        return generator.normal(size=(ROWS, dimension)) * scale

    inputs = DragInputs(
        particle_velocity=vectors(1.0),
        fluid_velocity=vectors(1.0),
        solid_fraction=generator.uniform(0.0, 0.7, ROWS),
        void_fraction_gradient=vectors(3.0),
        pressure_gradient=vectors(1e4),
        diameter=generator.uniform(0.005, 0.03, ROWS),
        filter_size=generator.uniform(0.02, 0.3, ROWS),
        fluid_density=generator.uniform(1.0, 1500.0, ROWS),
        dynamic_viscosity=10.0 ** generator.uniform(-1, 0.5, ROWS),
    )
    if wide:
        inputs = inputs._replace(wide_solid_fraction=generator.uniform(0.0, 0.7, ROWS))
    inputs.fluid_velocity[:20] = inputs.particle_velocity[:20]
    inputs.void_fraction_gradient[10:30] = 0.0
    inputs.solid_fraction[[5, 25]] = 0.0
    inputs.solid_fraction[30:40] = generator.uniform(0.8, 1.0, 10)
    inputs.solid_fraction[40] = -1e-7
    inputs.fluid_velocity[45:50] *= 1e4
    inputs.particle_velocity[50:60] *= 1e-12
    inputs.fluid_velocity[50:60] *= 1e-12
    return jax.tree.map(lambda value: np.asarray(value, np.float32), inputs)


def invariant_values(closure):
    """(rows, K) features of an invariant closure."""

    names = (*ROW_NAMES, "wide_solid_fraction") if closure.sees_wide else ROW_NAMES

    @jax.jit
    def features(inputs):
        return jax.vmap(
            lambda row: closure.prepare(row._replace(**{n: getattr(row, n)[None] for n in names})).features[0]
        )(inputs)

    return np.asarray(features(inputs_for(3, wide=closure.sees_wide)))


def shaken(closure, seed):
    """Random weights everywhere; normalisation and range such that most of the inputs lie within and some do not."""
    generator = np.random.default_rng(seed)
    if isinstance(closure, PaperNetwork):
        inputs, prefix = inputs_for(closure.dimension), "input"
        void_fraction = 1.0 - inputs.solid_fraction[:, None]
        values = np.concatenate([inputs.particle_velocity, inputs.fluid_velocity, void_fraction], axis=1)
    else:
        prefix, values = "feature", invariant_values(closure)
    values = values[60:].astype(np.float32)
    changes = {
        f"{prefix}_mean": values.mean(axis=0),
        f"{prefix}_scale": values.std(axis=0),
        f"{prefix}_low": np.quantile(values, 0.02, axis=0),
        f"{prefix}_high": np.quantile(values, 0.98, axis=0),
    }
    leaves, structure = jax.tree.flatten(closure.weights)
    leaves = [(np.asarray(leaf) + 0.2 * generator.normal(size=leaf.shape)).astype(np.float32) for leaf in leaves]
    return dataclasses.replace(closure, weights=jax.tree.unflatten(structure, leaves), **changes)


class Activations:
    """Every activation of the networks, as one closure."""

    def __call__(self, inputs):
        values = 20.0 * inputs.solid_fraction - 5.0
        total = sum(weight * function(values) for weight, function in enumerate(ACTIVATIONS.values(), 1))
        return Drag(40.0 + total, None, inputs.solid_fraction > 0.5)


LEARNED = {
    "invariant": lambda: shaken(InvariantClosure.initial(hidden=(12, 5), terms=TERMS), 1),
    "plain": lambda: shaken(
        InvariantClosure.initial(DRAG_LAWS["ergun"](), (4,), "softplus", features=WITHOUT_PRESSURE), 2
    ),
    "bounded": lambda: shaken(InvariantClosure.initial(hidden=(4,), terms=TERMS[:1], bounded=True), 4),
    "wide": lambda: shaken(InvariantClosure.initial(hidden=(4,), features=("log_solid_fraction", WIDE)), 5),
    "paper": lambda: shaken(PaperNetwork.initial(2), 3),
}
CLOSURES = LEARNED | DRAG_LAWS | {"activations": Activations}


@pytest.fixture(scope="module")
def closures():
    return {name: make() for name, make in CLOSURES.items()}


@pytest.fixture(scope="module")
def expected(closures):
    """What the closures themselves give in float32, (inputs, drag) by name; one compiled program for all."""
    inputs = {name: inputs_for(dimension_of(one), wide=sees_wide(one)) for name, one in closures.items()}

    @jax.jit
    def evaluate(inputs):
        return {name: jax.vmap(one_particle(closures[name]))(*given(inputs[name]).values()) for name in closures}

    drags = jax.tree.map(np.asarray, evaluate(inputs))
    for name, drag in drags.items():
        assert 0.02 < drag.out_of_range.mean() < 0.9, name
        assert all(np.isfinite(value).all() for value in drag), name
    return {name: (inputs[name], drag) for name, drag in drags.items()}


def given(inputs):
    """The inputs that there are, by name."""
    return {name: value for name, value in inputs._asdict().items() if value is not None}


def dimension_of(closure):
    return closure.dimension if isinstance(closure, PaperNetwork) else 3


def assert_equal_drag(drag, name, inputs, expected):
    """To 1e-6 of the coefficient, and for vectors of the forces that they are sums and differences of.

    A network's output is as exact as its scale, not as itself where it passes through zero. Beetstra's and Tang's
    fits end at Re = 1000; beyond, they are differences of large powers, and float32 loses digits in JAX as well.
    """
    slip = np.linalg.norm(inputs.fluid_velocity - inputs.particle_velocity, axis=1)
    size = np.linalg.norm(expected.force, axis=1)
    scale = expected.coefficient * slip + size + np.median(size) + np.linalg.norm(expected.remainder, axis=1)
    np.testing.assert_array_equal(drag.out_of_range, expected.out_of_range)
    reynolds = inputs.fluid_density * slip * inputs.diameter / inputs.dynamic_viscosity
    rows = reynolds < (1000.0 if name in ("beetstra", "tang") else np.inf)
    assert rows.sum() > 0.9 * ROWS
    np.testing.assert_allclose(drag.coefficient[rows], expected.coefficient[rows], rtol=1e-6)
    for field in ("remainder", "force"):
        error = (getattr(drag, field) - getattr(expected, field)) / scale[:, None]
        np.testing.assert_allclose(error[rows], 0.0, atol=1e-6, err_msg=field)


@pytest.fixture(scope="module")
def library(closures, tmp_path_factory):
    """All closures as C in one shared library, by the compiler with warnings as errors."""
    if COMPILER is None:
        pytest.skip("no C compiler (cc) on this machine: the exported C is not compiled and compared here")
    folder = tmp_path_factory.mktemp("c")
    parts = []
    for name, closure in closures.items():
        (folder / f"{name}.h").write_text(c_header(closure, dimension_of(closure), name, "*/ closed", "0"))
        parts.append(f'#include "{name}.h"\n' + LOOP.replace("NAME", name))
    (folder / "all.c").write_text("\n".join(parts))
    options = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
    command = [COMPILER, *options, "all.c", "-o", "all.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(folder / "all.so")


LOOP = """
void run_NAME(int count, const NAME_inputs *in, NAME_result *out);
void run_NAME(int count, const NAME_inputs *in, NAME_result *out)
{
    for (int i = 0; i < count; ++i) out[i] = NAME_drag(in + i);
}
"""


def rows_of(fields, dimension, values=None):
    """A numpy array of the C struct with these fields."""
    vectors = ("velocity", "gradient", "remainder", "force")
    kinds = [
        (
            name,
            np.int32 if name == "out_of_range" else np.float32,
            dimension if name.endswith(vectors) else (),
        )
        for name in fields
    ]
    rows = np.zeros(ROWS, kinds)
    for name, value in zip(fields, () if values is None else values, strict=False):
        rows[name] = value
    return rows


@pytest.mark.parametrize("name", CLOSURES)
def test_c_gives_the_same(library, closures, expected, name):
    inputs, drag = expected[name]
    dimension = dimension_of(closures[name])
    asked = given(inputs)
    rows = rows_of(asked, dimension, asked.values())
    result = rows_of(ExportedDrag._fields, dimension)
    pointers = (array.ctypes.data_as(ctypes.c_void_p) for array in (rows, result))
    getattr(library, f"run_{name}")(ROWS, *pointers)
    assert_equal_drag(ExportedDrag(*(result[field] for field in ExportedDrag._fields)), name, inputs, drag)


@pytest.mark.parametrize("name", CLOSURES)
def test_onnx_gives_the_same(closures, expected, tmp_path, name):
    inputs, drag = expected[name]
    path = tmp_path / "closure.onnx"
    path.write_bytes(onnx_model(closures[name], dimension_of(closures[name]), name, "0"))
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    assert_equal_drag(ExportedDrag(*session.run(list(ExportedDrag._fields), given(inputs))), name, inputs, drag)
    few = {field: value[:3] for field, value in given(inputs).items()}
    assert session.run(["force"], few)[0].shape == (3, dimension_of(closures[name]))


@pytest.fixture
def source_lines():
    """Programs with the lines of source that users have in them; other tests are without (tests/conftest.py)."""
    before = jax.config.jax_traceback_in_locations_limit
    jax.config.update("jax_traceback_in_locations_limit", 100)
    yield
    jax.config.update("jax_traceback_in_locations_limit", before)


@pytest.mark.parametrize("name", ("wide", "paper"))
def test_stablehlo_gives_the_same(closures, expected, tmp_path, name, source_lines):
    inputs, drag = expected[name]
    artifact, text = export_closure(closures[name], {}, "stablehlo", tmp_path / "closure.bin", "0")
    assert (artifact, text) == (tmp_path / "closure.bin", tmp_path / "closure.mlir")
    exported = jax.export.deserialize(bytearray(artifact.read_bytes()))
    result = jax.tree.map(np.asarray, exported.call(*map(jnp.asarray, given(inputs).values())))
    assert_equal_drag(ExportedDrag(*result), name, inputs, drag)
    assert "stablehlo.dot_general" in text.read_text()
    for written in (artifact, text):
        assert b".py" not in written.read_bytes(), "where the program lies on this machine is nobody's business"


def test_a_third_component_of_zero_changes_nothing(closures):
    """The invariant closure is exported for three components; a 2-D code leaves the third zero."""
    flat = inputs_for(2)
    padded = jax.tree.map(lambda value: np.pad(value, ((0, 0), (0, 1))) if value.ndim == 2 else value, flat)
    two, three = (
        onnxruntime.InferenceSession(onnx_model(closures["invariant"], dimension, "", "0")).run(
            ["force"], given(values)
        )[0]
        for dimension, values in ((2, flat), (3, padded))
    )
    np.testing.assert_allclose(three[:, :2], two, rtol=1e-6)
    np.testing.assert_array_equal(three[:, 2], 0.0)


def test_an_ensemble_is_written_member_after_member(closures, tmp_path):
    """Two equal members give what the one gives."""
    path = tmp_path / "closure.onnx"
    ensemble = EnsembleClosure.of([closures["plain"]] * 2)
    export_closure(ensemble, {}, "onnx", path, "0")
    assert "2 of InvariantClosure" in onnx.load(path).doc_string
    inputs = given(inputs_for(3))
    two, one = (
        onnxruntime.InferenceSession(model).run(["force"], inputs)[0]
        for model in (path.read_bytes(), onnx_model(closures["plain"], 3, "", "0"))
    )
    np.testing.assert_allclose(two, one, rtol=1e-6)
    export_closure(ensemble, {}, "c", tmp_path / "closure.h", "0")


def test_operations_that_no_format_knows_are_named():
    class Strange:
        def __call__(self, inputs):
            drag = DRAG_LAWS["stokes"]()(inputs)
            return drag._replace(coefficient=drag.coefficient * jax.lax.erf(inputs.solid_fraction))

    with pytest.raises(NotImplementedError, match="erf"):
        c_header(Strange(), 2, "strange", "", "0")
    with pytest.raises(NotImplementedError, match="erf"):
        onnx_model(Strange(), 2, "", "0")
    assert [shape.shape for shape in input_shapes(Strange(), 2)][:3] == [(2,), (2,), ()]


def test_what_cannot_be_written_is_refused(closures, tmp_path, monkeypatch):
    closure = closures["paper"]
    with pytest.raises(InputError, match="--format = 'fortran'.*c, onnx, stablehlo"):
        export_closure(closure, {}, "fortran", tmp_path / "closure.f90", "0")
    with pytest.raises(InputError, match="--out.*cannot be written"):
        export_closure(closure, {}, "c", tmp_path / "nowhere" / "closure.h", "0")
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(InputError, match=r"onnx is not installed.*pip install 'jaxdem\[export\]'"):
        export_closure(closure, {}, "onnx", tmp_path / "closure.onnx", "0")
    assert list(tmp_path.iterdir()) == []


def test_files_say_what_they_are(closures, tmp_path):
    path, header = tmp_path / "closure.onnx", tmp_path / "closure.h"
    export_closure(closures["paper"], {"recipe": "paper"}, "onnx", path, "0")
    model = onnx.load(path)
    assert [value.name for value in model.graph.input] == list(DragInputs._fields[:-1])
    assert [value.name for value in model.graph.output] == list(ExportedDrag._fields)
    assert "recipe: paper" in model.doc_string
    assert export_closure(closures["invariant"], {}, "c", header, "0") == (header,)
    text = header.read_text()
    assert "base law: koch_hill" in text and "float particle_velocity[3];" in text
    assert "/tmp" not in text and "double" not in text


@pytest.mark.parametrize(
    ("name", "expected"), [("my-drag.closure.h", "my_drag"), ("2nd.h", "closure_2nd"), ("D.h", "d")]
)
def test_c_names_come_from_the_file(tmp_path, name, expected):
    assert identifier(tmp_path / name) == expected
