"""What a traced program depends on, as one number: its static description, the kinds of its arguments, code and
versions."""

from __future__ import annotations

import dataclasses
import enum
import functools
import hashlib
from importlib.metadata import version
from pathlib import Path

import jax
import numpy as np

PACKAGES = ("jax", "jaxlib", "numpy")
"""Beside jaxdem's own source, whose versions decide what is traced."""

PLAIN = (type(None), bool, int, float, str, bytes, np.generic, np.dtype)
"""What its own text says all of."""


class UnknownKind(TypeError):
    """A value of which it cannot be told whether it is the same as in another process, such as a function."""


def fingerprint(static: object, arguments: object) -> str:
    """Equal for two programs of this version, device and settings of JAX only if they would be traced to the same text.

    Args:
        static: what is compiled in; the content of its arrays counts.
        arguments: what is traced; of its arrays only shape and type count.

    Raises:
        UnknownKind: something in them is neither data nor of a class of jaxdem.
    """
    digest = hashlib.sha256(surroundings().encode())
    _feed(digest, static, content=True)
    _feed(digest, arguments, content=False)
    return digest.hexdigest()


def surroundings() -> str:
    """Source of jaxdem, versions, device, and settings of JAX that are not about its files."""
    settings = {name: value for name, value in jax.config.values.items() if "cache" not in name}
    versions = {name: version(name) for name in PACKAGES}
    device = jax.devices()[0]
    return repr((_source(), versions, device.platform, device.device_kind, sorted(settings.items(), key=str)))


@functools.cache
def _source() -> str:
    """Of all modules of the package."""
    root, digest = Path(__file__).parents[1], hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        digest.update(str(path.relative_to(root)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def _feed(digest: hashlib._Hash, value: object, content: bool) -> None:
    kind = type(value)
    digest.update(f"({kind.__module__}.{kind.__qualname__} ".encode())
    if isinstance(value, (jax.Array, np.ndarray)):
        weak = getattr(value, "weak_type", False)
        digest.update(f"{value.dtype} {value.shape} {weak} ".encode())
        if content:
            digest.update(np.asarray(value).tobytes())
    elif kind in PLAIN or isinstance(value, (np.generic, np.dtype)):
        digest.update(f"{value!r}".encode())
    elif isinstance(value, enum.Enum):
        digest.update(value.name.encode())
    elif isinstance(value, (tuple, list)):
        for item in value:
            _feed(digest, item, content)
    elif isinstance(value, dict):
        for name, item in value.items():
            _feed(digest, name, content)
            _feed(digest, item, content)
    elif kind.__module__.split(".")[0] == "jaxdem":
        fields = [field.name for field in dataclasses.fields(value)] if dataclasses.is_dataclass(value) else vars(value)
        for name in fields:
            digest.update(f"{name}=".encode())
            _feed(digest, getattr(value, name), content)
    else:
        raise UnknownKind(kind.__qualname__)
    digest.update(b")")
