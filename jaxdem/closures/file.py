"""A learned closure in one HDF5 file: structure, weights, normalisation, and how it was trained."""

from __future__ import annotations

import itertools
import json
import os
from typing import Any

import h5py
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from jaxdem.closures.ensemble import EnsembleClosure
from jaxdem.closures.invariant import WITHOUT_PRESSURE, InvariantClosure
from jaxdem.closures.moments import MomentBasis
from jaxdem.closures.neighbor_level import ORDER, Width
from jaxdem.closures.neighbors import NeighborClosure
from jaxdem.closures.network import PaperNetwork
from jaxdem.closures.registry import drag_law, drag_law_name
from jaxdem.closures.subgrid import SubgridClosure
from jaxdem.errors import InputError, cut
from jaxdem.files.hdf5 import attributes_of, image_of, in_memory, store, write_attributes
from jaxdem.files.reading import parse_json
from jaxdem.files.stored import CLOSURE, SUBGRID, Kind, reading, write_whole

SMALLEST_FLOAT = 2
"""Bytes of the shortest number that a file may hold weights in."""

LearnedClosure = PaperNetwork | InvariantClosure
"""A closure with one network."""
StoredClosure = LearnedClosure | EnsembleClosure
"""A drag closure that is trained on datasets of runs."""
AnyClosure = StoredClosure | NeighborClosure
"""A drag closure in a file."""


def save_closure(path: str | os.PathLike[str], closure: AnyClosure | SubgridClosure, metadata: dict[str, Any]) -> None:
    """Write a closure; an earlier file is replaced in one step, only when the new one is complete.

    Layout: attributes format, version, kind ("paper", "invariant", "ensemble", "neighbors" or "subgrid"), base (scene
    name of the base law, not of a subgrid stress), hidden, activation, dimension (paper), terms, features and bounded
    where it is true (invariant), members and member_kind (ensemble), scalars, channels, basis, carried and wake
    (neighbors: reach, number of radial functions and degree; of a stretched basis also stretch and decay); dataset
    `metadata` (JSON in UTF-8, as bytes); group `arrays` with every data field, the weights below
    `arrays/weights/<layer>/<kernel or bias>`, those of an ensemble below `arrays/members/` with the members along their
    first axis, those of a closure of neighbours below `arrays/levels/<number>/`.

    Args:
        path: file to write; its folder must exist.
        closure: a `PaperNetwork`, an `InvariantClosure`, an ensemble of one of them, a `NeighborClosure`, or a
            `SubgridClosure`.
        metadata: anything JSON can hold (numpy numbers and arrays included): recipe, R2, datasets, seed,
            seconds.

    Raises:
        InputError: it is no learned closure, its base law is not a registered one, a number in it is not finite, or the
            folder cannot be written.
    """
    if not isinstance(closure, AnyClosure | SubgridClosure):
        limit = "is no learned closure, whose weights a file holds"
        raise InputError("closure", type(closure).__name__, limit, "name a correlation in the scene: coupling.drag")
    for name, leaf in _named_leaves(closure).items():
        if reason := _unusable(name, np.asarray(leaf)):
            raise InputError("closure", type(closure).__name__, reason, "train it again")
    structure = _structure(closure)
    text = json.dumps(metadata, default=_plain)
    with in_memory("closure") as file:
        write_attributes(file, {"format": CLOSURE.format, "version": CLOSURE.version, **structure})
        store(file, "metadata", np.frombuffer(text.encode(), np.uint8))
        for name, leaf in _named_leaves(closure).items():
            store(file, f"arrays/{name}", leaf)
        content = image_of(file)
    write_whole(path, content, (SUBGRID if isinstance(closure, SubgridClosure) else CLOSURE).key)


def load_closure(path: str | os.PathLike[str]) -> tuple[AnyClosure, dict[str, Any]]:
    """Read a drag closure and its metadata; the weights are those written, bit for bit.

    Raises:
        InputError: no such file, not HDF5 or cut short, not a drag closure, of a newer version, or arrays that are
            missing, do not have the shapes of the structure, or are not finite.
    """
    return _load(path, CLOSURE)


def load_subgrid(path: str | os.PathLike[str]) -> tuple[SubgridClosure, dict[str, Any]]:
    """`load_closure` of a subgrid stress.

    Raises:
        InputError: as `load_closure`; a drag closure is refused.
    """
    return _load(path, SUBGRID)


def _load(path: str | os.PathLike[str], kind: Kind) -> tuple[Any, dict[str, Any]]:
    """The closure that a key of the scene stands for."""
    with reading(path, kind) as file:
        own = attributes_of(file)
        found = SUBGRID if own["kind"] == "subgrid" else CLOSURE
        if found != kind:
            what = "subgrid stress" if found == SUBGRID else "drag closure"
            raise kind.refusal(path, f"holds a {what}", f"Give it as {found.key}.")
        _check_sizes(own, file.id.get_filesize(), path, kind)
        template = _template(own, str(path))
        leaves = [_array(file, name, leaf.shape, path, kind) for name, leaf in _named_leaves(template).items()]
        closure = jax.tree.unflatten(jax.tree.structure(template), leaves)
        return closure, parse_json(_bytes(file["metadata"][()]).decode())


def _check_sizes(own: dict[str, Any], size: int, path: str | os.PathLike[str], kind: Kind) -> None:
    """Refuse a structure whose weights a file of `size` bytes cannot hold, before anything of it is made."""
    hidden, _ = _network(own)
    if own["kind"] == "neighbors":
        hidden = (*hidden, *map(int, own["scalars"]), int(own["channels"]))
    members = int(own["members"]) if own["kind"] == "ensemble" else 1
    weights = members * (sum(hidden) + sum(one * other for one, other in itertools.pairwise(hidden)))
    least = weights * SMALLEST_FLOAT
    if min(members, *hidden, 1) < 1 or least > size:
        claim = f"claims {members} network(s) with hidden layers {list(hidden)}, {least} bytes at least"
        raise kind.refusal(path, cut(f"{claim}; the file has {size}"))


def _array(file: h5py.File, name: str, shape: tuple[int, ...], path: str | os.PathLike[str], kind: Kind) -> Array:
    """An array of floats that are finite in single precision, in which runs compute; scales are positive."""
    stored = file.get(f"arrays/{name}")
    if not isinstance(stored, h5py.Dataset):
        raise kind.refusal(path, f"the array {name} is missing")
    if stored.shape != shape or stored.dtype.kind != "f":
        found = f"{stored.shape} {stored.dtype}"
        raise kind.refusal(path, f"the array {name} has shape {found}, its structure asks for {shape} floats")
    values = stored[()]
    if reason := _unusable(name, values):
        raise kind.refusal(path, reason)
    return jnp.asarray(values)


def _unusable(name: str, values: NDArray[np.floating]) -> str:
    """Why an array cannot be one of a closure; empty where it can."""
    with np.errstate(over="ignore"):
        single = values.astype(np.float32)
    unbounded = name.endswith(("_low", "_high"))  # the range of a closure that has not been trained
    if np.isnan(single).any() or (np.isinf(single).any() and not unbounded):
        return f"the array {name} holds values that are not finite numbers in single precision"
    if name.endswith("_scale") and not (single > 0.0).all():
        return f"the array {name} holds values that are not positive"
    return ""


def _bytes(stored: Any) -> bytes:
    """Text that is kept as an array of bytes; files before HDF5 1.10's format have a string of variable length."""
    return stored if isinstance(stored, bytes) else stored.tobytes()


def _structure(closure: AnyClosure | SubgridClosure) -> dict[str, Any]:
    """The static part as HDF5 attributes."""
    if isinstance(closure, EnsembleClosure):
        one = _structure(closure.members)
        return {**one, "kind": "ensemble", "member_kind": one["kind"], "members": closure.count}
    if isinstance(closure, NeighborClosure):
        level = closure.levels[0]
        return {
            "kind": "neighbors", "base": drag_law_name(closure.base), "activation": level.activation,
            "scalars": [one.width.scalars for one in closure.levels], "channels": level.channels,
            "hidden": np.asarray(level.width.hidden, np.int64),
            "basis": _numbers(closure.basis), "carried": _numbers(closure.carried), "wake": _numbers(closure.wake),
        }  # fmt: skip
    network = {"hidden": np.asarray(closure.hidden, np.int64), "activation": closure.activation}
    if isinstance(closure, SubgridClosure):
        return {"kind": "subgrid", **network}
    common = {"base": drag_law_name(closure.base), **network}
    if isinstance(closure, PaperNetwork):
        return {"kind": "paper", "dimension": closure.dimension, **common}
    names = {"terms": ",".join(closure.terms), "features": ",".join(closure.features)}
    bound = {"bounded": True} if closure.bounded else {}  # a file without is read by versions that know no bound
    return {"kind": "invariant", **names, **bound, **common}


def _template(attributes: Any, path: str) -> AnyClosure | SubgridClosure:
    """The shapes of a closure of the stored structure."""
    if attributes["kind"] == "subgrid":
        return jax.eval_shape(lambda: SubgridClosure.initial(*_network(attributes)))
    ensemble = attributes["kind"] == "ensemble"
    kind = str(attributes["member_kind" if ensemble else "kind"])
    single = jax.eval_shape(lambda: _single(attributes, kind, path))
    if not ensemble:
        return single
    count = int(attributes["members"])
    return EnsembleClosure(jax.tree.map(lambda leaf: jax.ShapeDtypeStruct((count, *leaf.shape), leaf.dtype), single))


def _single(attributes: Any, kind: str, path: str) -> LearnedClosure | NeighborClosure:
    base = drag_law(str(attributes["base"]), CLOSURE.key)
    hidden, activation = _network(attributes)
    if kind == "paper":
        dimension = int(attributes["dimension"])
        if dimension not in (2, 3):
            raise CLOSURE.refusal(path, f"is of {dimension} dimensions")
        return PaperNetwork.initial(dimension, base, hidden, activation)
    if kind == "neighbors":
        basis, carried = (_basis(attributes[name], order, path) for name, order in (("basis", ORDER), ("carried", 2)))
        widths = [Width(int(scalars), int(attributes["channels"]), hidden) for scalars in attributes["scalars"]]
        wake = _basis(attributes.get("wake", []), 1, path)  # files of the first versions have none
        return NeighborClosure.initial(basis, carried, widths, 0, base, wake)
    if kind == "invariant":
        terms = tuple(name for name in str(attributes["terms"]).split(",") if name)
        # Files of the first versions do not name their features.
        features = str(attributes.get("features", ",".join(WITHOUT_PRESSURE))).split(",")
        bounded = bool(attributes.get("bounded", False))
        return InvariantClosure.initial(base, hidden, activation, terms, features=features, bounded=bounded)
    raise InputError(CLOSURE.key, path, f"holds a closure of kind {kind!r}", "Update jaxdem or train it again.")


def _numbers(basis: MomentBasis | None) -> NDArray[np.float64]:
    """Reach, number of radial functions, degree; of a stretched basis also stretch and decay; nothing for none."""
    if basis is None:
        return np.asarray([], np.float64)
    stretched = [] if (basis.stretch, basis.decay) == (1.0, 2) else [basis.stretch, basis.decay]
    return np.asarray([basis.reach, basis.radial, basis.degree, *stretched], np.float64)


def _basis(numbers: Any, order: int, path: str) -> Any:
    """The inverse of `_numbers`: a `MomentBasis`, or None.

    Raises:
        InputError: the numbers cannot be those of one.
    """
    found = np.ravel(numbers)
    if order < ORDER and not len(found):
        return None
    plain = (*found, 1.0, 2.0) if len(found) == 3 else found
    reach, radial, degree, stretch, decay = plain if len(plain) == 5 else [0.0] * 5
    possible = 1.5 <= reach <= 10.0 and 2 <= radial <= 100 and order <= degree <= 20
    if not (possible and 1.0 <= stretch <= 10.0 and decay in (2.0, 4.0, 6.0, 8.0)):
        raise CLOSURE.refusal(path, f"has moments that cannot be ({found.tolist()})")
    return MomentBasis(float(reach), int(radial), int(degree), order, float(stretch), int(decay))


def _network(attributes: Any) -> tuple[tuple[int, ...], str]:
    """Widths of the hidden layers, and the activation."""
    return tuple(int(width) for width in attributes["hidden"]), str(attributes["activation"])


def load_neighbors(path: str | os.PathLike[str]) -> tuple[NeighborClosure, dict[str, Any]]:
    """`load_closure` of a closure of neighbours.

    Raises:
        InputError: as `load_closure`, or the file holds another closure.
    """
    closure, metadata = load_closure(path)
    if not isinstance(closure, NeighborClosure):
        limit = "is not a closure of neighbours"
        raise InputError("CLOSURE", str(path), limit, "Give a file of `jaxdem train --recipe neighbours`.")
    return closure, metadata


def load_stored(path: str | os.PathLike[str]) -> tuple[StoredClosure, dict[str, Any]]:
    """`load_closure` where the inputs are those that datasets of runs have.

    Raises:
        InputError: as `load_closure`, or the file holds a closure of neighbours.
    """
    closure, metadata = load_closure(path)
    if isinstance(closure, NeighborClosure):
        limit = "is a closure of neighbours, whose inputs are not in datasets of runs"
        raise InputError("CLOSURE", str(path), limit, "Train another size with `jaxdem train --recipe neighbours`.")
    return closure, metadata


def load_single(path: str | os.PathLike[str], remedy: str) -> tuple[LearnedClosure, dict[str, Any]]:
    """`load_stored` where an ensemble will not do; `remedy` says what to do instead.

    Raises:
        InputError: as `load_stored`, or the file holds an ensemble.
    """
    closure, metadata = load_stored(path)
    if isinstance(closure, EnsembleClosure):
        raise InputError("CLOSURE", str(path), f"is an ensemble of {closure.count}", remedy)
    return closure, metadata


def _named_leaves(closure: AnyClosure | SubgridClosure) -> dict[str, Any]:
    """Every array of the closure by its path, such as weights/Dense_0/kernel, in tree order."""
    leaves, _ = jax.tree_util.tree_flatten_with_path(closure)
    return {jax.tree_util.keystr(path, simple=True, separator="/"): leaf for path, leaf in leaves}


def _plain(value: Any) -> Any:
    """What JSON writes for a value that it does not know."""
    if hasattr(value, "tolist"):
        return np.asarray(value).tolist()
    return str(value)
