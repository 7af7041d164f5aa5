"""Write a learned closure for other programs: C header, ONNX, StableHLO."""

from __future__ import annotations

import inspect
import os
import re
from pathlib import Path
from typing import Any

from jaxdem.closures.base import DragClosure
from jaxdem.closures.ensemble import EnsembleClosure
from jaxdem.closures.export_c import c_header
from jaxdem.closures.export_neighbors import neighbor_module
from jaxdem.closures.export_neighbors_c import neighbor_header
from jaxdem.closures.export_neighbors_onnx import neighbor_onnx
from jaxdem.closures.export_onnx import onnx_model
from jaxdem.closures.export_stablehlo import stablehlo_module
from jaxdem.closures.file import AnyClosure, StoredClosure
from jaxdem.closures.neighbors import NeighborClosure
from jaxdem.closures.network import PaperNetwork
from jaxdem.closures.registry import drag_law_name
from jaxdem.errors import InputError
from jaxdem.files.stored import write_whole

FORMATS = ("c", "onnx", "stablehlo")
"""Formats that `export_closure` writes."""


def export_closure(
    closure: AnyClosure, metadata: dict[str, Any], form: str, path: str | os.PathLike[str], version: str
) -> tuple[Path, ...]:
    """Write the whole evaluation of a closure: normalisation, network, base law, fallback out of range.

    Sizes are fixed but for the number of particles. Vectors have D components: those of the training for the
    paper's network; three for the invariant closure, which gives the same with a third component of zero. A closure of
    neighbours is a function of arrays of all spheres in StableHLO and ONNX, see `neighbor_module` and `neighbor_onnx`,
    and in C the functions of a pair and of a sphere that it is made of, see `neighbor_header`.

    Args:
        closure: from `load_closure`.
        metadata: of its file; the recipe goes into the description.
        form: "c", "onnx" or "stablehlo".
        path: file to write. StableHLO gives two, the artifact of `jax.export` and the text, which ends in .mlir:
            if `path` ends so, the artifact lies beside it with the ending .bin.
        version: of jaxdem, for the description.

    Returns:
        The files written.

    Raises:
        InputError: unknown format, the package onnx is missing, or the place cannot be written.
    """
    if form not in FORMATS:
        raise InputError("--format", form, "is not known", f"Use one of {', '.join(FORMATS)}.")
    target = Path(path)
    if isinstance(closure, NeighborClosure):
        return _written(_neighbors(closure, metadata, form, target, version))
    dimension = getattr(closure, "dimension", 3)
    about = describe(closure, metadata, dimension)
    law: DragClosure = closure.one_by_one() if isinstance(closure, EnsembleClosure) else closure
    if form == "c":
        text = c_header(law, dimension, identifier(target), about, version)
        contents = {target: text.encode()}
    elif form == "onnx":
        contents = {target: onnx_model(law, dimension, about, version)}
    else:
        artifact, text = stablehlo_module(law, dimension)
        contents = dict(zip(files_written(form, target), (artifact, text.encode()), strict=True))
    return _written(contents)


def _neighbors(
    closure: NeighborClosure, metadata: dict[str, Any], form: str, target: Path, version: str
) -> dict[Path, bytes]:
    """The files of a closure of neighbours."""
    about = f"base law: {drag_law_name(closure.base)}\nrecipe: {metadata.get('recipe', 'unknown')}"
    if form == "onnx":
        return {target: neighbor_onnx(closure, about, version)}
    if form == "c":
        return {target: neighbor_header(closure, identifier(target), about, version).encode()}
    artifact, text = neighbor_module(closure)
    return dict(zip(files_written(form, target), (artifact, text.encode()), strict=True))


def _written(contents: dict[Path, bytes]) -> tuple[Path, ...]:
    """The files, written."""
    for file, content in contents.items():
        write_whole(file, content, "--out")
    return tuple(contents)


def files_written(form: str, path: Path) -> tuple[Path, ...]:
    """The files that `export_closure` writes: of StableHLO the artifact and the text."""
    if form != "stablehlo":
        return (path,)
    is_text = path.suffix == ".mlir"
    return (path.with_suffix(".bin"), path) if is_text else (path, path.with_suffix(".mlir"))


def describe(closure: StoredClosure, metadata: dict[str, Any], dimension: int) -> str:
    """What the closure is, for whoever finds the file."""
    kind = type(closure)
    text = inspect.cleandoc(kind.__doc__ or "").split("\n\nAttributes:")[0]
    one = closure.members if isinstance(closure, EnsembleClosure) else closure
    terms = () if isinstance(one, PaperNetwork) else one.terms
    members = f", {closure.count} of {type(one).__name__}" if isinstance(closure, EnsembleClosure) else ""
    facts = {
        "closure": kind.__name__ + members,
        "base law": drag_law_name(one.base),
        "hidden layers": "-".join(map(str, one.hidden)),
        "activation": one.activation,
        "terms of the remainder": ", ".join(terms) or "none",
        "components of vectors": dimension,
        "recipe": metadata.get("recipe", "unknown"),
    }
    return "\n".join([f"{name}: {value}" for name, value in facts.items()] + ["", text])


def identifier(path: Path) -> str:
    """C identifier from the name of a file."""
    name = re.sub(r"\W", "_", path.stem.split(".")[0], flags=re.ASCII).lower()
    return name if re.match(r"[a-z]", name) else f"closure_{name}".rstrip("_")
