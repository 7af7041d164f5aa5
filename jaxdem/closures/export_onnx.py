"""A closure as an ONNX graph: float32, the number of particles free, operators of ONNX alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxdem.closures.base import DragClosure, asked_inputs
from jaxdem.closures.export_trace import OPERATIONS, UNITS, VECTORS, ExportedDrag, Result, Value, trace, walk
from jaxdem.errors import InputError

OPERATOR_SET, FORMAT = 17, 8
"""Versions of the operators and of the file: of 2022, so that older runtimes read it too."""


def onnx_model(closure: DragClosure, dimension: int, about: str, version: str) -> bytes:
    """Bytes of an ONNX file with the `asked_inputs` and the outputs of `ExportedDrag` by name.

    Vectors are (particles, D), all else (particles,); everything float32, `out_of_range` bool.

    Args:
        closure: drag closure.
        dimension: D.
        about: description kept in the file.
        version: of jaxdem.

    Raises:
        InputError: the package onnx is not installed.
    """
    writer = Writer()
    inputs = [
        writer.input(name, (dimension,) if name in VECTORS else (), UNITS[name]) for name in asked_inputs(closure)
    ]
    results = walk(trace(closure, dimension), inputs, writer.apply)
    for name, value in zip(ExportedDrag._fields, results, strict=True):
        vector = name in ("remainder", "force")
        writer.output(value, name, (dimension,) if vector else (), UNITS[name])
    return writer.model(about, version)


class Tensor(str):
    """Name of a tensor of the graph, with the particles as its first axis.

    Attributes:
        shape: lengths of the other axes.
    """

    shape: tuple[int, ...] = ()


class Writer:
    """Nodes, constants, inputs and outputs of the graph.

    A value of shape s in the program of one particle is a tensor (particles, *s); a constant stays (*s), and the
    broadcasting rules of ONNX bring the two together.

    Raises:
        InputError: the package onnx is not installed.
    """

    def __init__(self) -> None:
        try:
            import onnx
        except ImportError:
            raise InputError(
                "--format",
                "onnx",
                "the package onnx is not installed",
                "Install it: pip install 'jaxdem[export]'",
            ) from None
        self.onnx: Any = onnx
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self.inputs: list[Any] = []
        self.outputs: list[Any] = []

    def input(
        self, name: str, shape: tuple[int, ...], about: str, rows: str = "particles", kind: Any = np.float32
    ) -> Tensor:
        """An input of the graph, one row of this shape for each of the `rows`."""
        self.inputs.append(self._described(name, kind, rows, shape, about))
        return _shaped(name, shape)

    def output(self, value: Value, name: str, shape: tuple[int, ...], about: str, rows: str = "particles") -> None:
        """A value as an output of the graph, a constant for each of the particles of its first input."""
        kind = np.bool_ if name == "out_of_range" else np.float32
        whole = value if isinstance(value, Tensor) else self._whole(value, shape, Tensor(self.inputs[0].name))
        self.nodes.append(self.onnx.helper.make_node("Identity", [whole], [name]))
        self.outputs.append(self._described(name, kind, rows, shape, about))

    def model(self, about: str, version: str) -> bytes:
        """Bytes of the file, checked."""
        helper = self.onnx.helper
        graph = helper.make_graph(self.nodes, "drag", self.inputs, self.outputs, self.constants, about)
        model = helper.make_model(
            graph,
            producer_name="jaxdem",
            producer_version=version,
            opset_imports=[helper.make_opsetid("", OPERATOR_SET)],
            ir_version=FORMAT,
            doc_string=about,
        )
        self.onnx.checker.check_model(model, full_check=True)
        return bytes(model.SerializeToString())

    def _described(self, name: str, kind: Any, rows: str, shape: tuple[int, ...], about: str) -> Any:
        return self.onnx.helper.make_tensor_value_info(name, self._kind(kind), [rows, *shape], about)

    def apply(self, operation: str, operands: Sequence[Value], settings: dict[str, Any], result: Result) -> Value:
        """One operation; see `jaxdem.closures.export_trace.Apply`."""
        value = self._moved(operation, operands, settings, result)
        if value is None:
            rank = len(result.shape)
            value = self._elementwise(operation, [self._fitted(v, rank) for v in operands], settings, result)
        value.shape = result.shape
        return value

    def _elementwise(self, operation: str, operands: list[Value], settings: dict[str, Any], result: Result) -> Value:
        """Operations on one element of each operand."""
        if operation in OPERATIONS and OPERATIONS[operation].onnx:
            return self.node(OPERATIONS[operation].onnx, *operands)
        if operation == "ne":
            return self.node("Not", self.node("Equal", *operands))
        if operation == "select_n":
            return self.node("Where", operands[0], operands[2], operands[1])
        if operation == "expm1":  # without the cancellation of exp(x) - 1
            half = self.node("Tanh", self.node("Mul", operands[0], _number(0.5)))
            return self.node("Mul", half, self.node("Add", self.node("Exp", operands[0]), _number(1.0)))
        if operation == "log1p":
            return self._log1p(operands[0])
        if operation == "convert_element_type":
            return self.node("Cast", operands[0], to=self._kind(result.dtype))
        raise NotImplementedError(f"no ONNX for the operation {operation}")

    def _moved(self, operation: str, operands: Sequence[Value], settings: dict[str, Any], result: Result) -> Value:
        """Operations that know axes, which lie one to the right in the graph; None of any other operation."""
        first = operands[0]
        if operation == "dot_general":
            return self.node("MatMul", *operands)
        if operation in ("reshape", "squeeze"):
            return self._reshaped(first, result.shape)
        if operation == "transpose":
            return self.node("Transpose", first, perm=[0, *(place + 1 for place in settings["permutation"])])
        if operation == "broadcast_in_dim":
            shape = [1] * len(result.shape)
            for length, place in zip(first.shape, settings["broadcast_dimensions"], strict=True):
                shape[place] = length
            return self.node("Expand", self._reshaped(first, shape), _whole(1, *result.shape))
        if operation == "slice":
            axes = _whole(*range(1, len(result.shape) + 1))
            bounds = (_whole(*settings["start_indices"]), _whole(*settings["limit_indices"]))
            return self.node("Slice", first, *bounds, axes)
        if operation == "stack":
            axis = settings["axis"]
            shape = [*result.shape[:axis], 1, *result.shape[axis + 1 :]]
            return self.node("Concat", *(self._reshaped(v, shape) for v in self._of_rows(operands)), axis=axis + 1)
        if operation == "concatenate":
            return self.node("Concat", *self._of_rows(operands), axis=settings["dimension"] + 1)
        if operation == "reduce_sum":
            axes = _whole(*(axis + 1 for axis in settings["axes"]))
            return self.node("ReduceSum", first, axes, keepdims=0)
        if operation == "reduce_and":
            number = self.node("Cast", first, to=self._kind(np.int32))
            right = [axis + 1 for axis in settings["axes"]]
            smallest = self.node("ReduceMin", number, axes=right, keepdims=0)
            return self.node("Cast", smallest, to=self._kind(np.bool_))
        return None

    def node(self, operator: str, *operands: Value, **settings: Any) -> Tensor:
        """A node of the graph, and the name of what it gives."""
        name = Tensor(f"t{len(self.nodes) + 1}")
        names = [self._named(value) for value in operands]
        self.nodes.append(self.onnx.helper.make_node(operator, names, [name], **settings))
        return name

    def _whole(self, value: Value, shape: tuple[int, ...], like: Tensor) -> Tensor:
        """A constant with the particles as its first axis, as many as another tensor has."""
        count = self.node("Shape", like, start=0, end=1)
        return self.node("Expand", value, self.node("Concat", count, _whole(*shape), axis=0))

    def _of_rows(self, operands: Sequence[Value]) -> list[Value]:
        """The operands with the particles as their first axis, also those that are constants."""
        like = next(value for value in operands if isinstance(value, Tensor))
        return [value if isinstance(value, Tensor) else self._whole(value, value.shape, like) for value in operands]

    def _fitted(self, value: Value, rank: int) -> Value:
        """A single number for each particle gets as many axes as what it meets."""
        if isinstance(value, Tensor) and len(value.shape) < rank:
            return self._reshaped(value, (1,) * rank)
        return value

    def _reshaped(self, value: Value, shape: Sequence[int]) -> Tensor:
        return self.node("Reshape", value, _whole(-1, *shape))

    def _log1p(self, value: Value) -> Tensor:
        """ln(1 + x) to all digits of a small x: x ln(y) / (y - 1) with y = 1 + x as it is rounded."""
        rounded = self.node("Add", value, _number(1.0))
        excess = self.node("Sub", rounded, _number(1.0))
        none = self.node("Equal", excess, _number(0.0))
        divisor = self.node("Where", none, _number(1.0), excess)
        exact = self.node("Div", self.node("Mul", self.node("Log", rounded), value), divisor)
        return self.node("Where", none, value, exact)

    def _named(self, value: Value) -> str:
        if isinstance(value, Tensor):
            return value
        name = f"c{len(self.constants) + 1}"
        self.constants.append(self.onnx.numpy_helper.from_array(np.ascontiguousarray(value), name))
        return name

    def _kind(self, dtype: Any) -> int:
        return int(self.onnx.helper.np_dtype_to_tensor_dtype(np.dtype(dtype)))


def _shaped(name: str, shape: tuple[int, ...]) -> Tensor:
    tensor = Tensor(name)
    tensor.shape = shape
    return tensor


def _number(value: float) -> np.ndarray:
    return np.asarray(value, np.float32)


def _whole(*values: int) -> np.ndarray:
    return np.asarray(values, np.int64)
