"""Damaged files: cut, overwritten, altered in a bit or exchanged for those of another program, and read.

    python -m tests.cases.damage KIND NUMBER BITS SEED

prints how many of NUMBER files, and of BITS files with one bit altered, were refused with a message, how many read as
they were written and how many read as something else, as JSON; anything else is an error.
"""

from __future__ import annotations

import collections
import dataclasses
import hashlib
import json
import random
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import jax
import numpy as np

from jaxdem.closures import KochHill, save_closure
from jaxdem.closures.file import load_single
from jaxdem.closures.network import PaperNetwork
from jaxdem.errors import InputError
from jaxdem.files import hdf5
from jaxdem.io import RunDirectory, load_run, read_checkpoint, write_checkpoint
from jaxdem.scene.rows import rows_of
from jaxdem.train.dataset_file import SCALARS, VECTORS, Dataset, read_dataset, write_dataset

Made = tuple[Path, Callable[[], object]]
"""Path of a file and a reader of it, which returns the content."""

RUN_SCENE = "[domain]\nsize = [0.4, 0.3]\n[fluid]\ncells = [4, 3]\n"


def _closure(folder: Path) -> Made:
    path = folder / "closure.h5"
    save_closure(path, PaperNetwork.initial(2, KochHill(), (4, 4), "elu"), {"seed": 1})

    def read() -> object:
        closure, metadata = load_single(path, "")
        static = [str(getattr(closure, name)) for name in ("hidden", "activation")]
        return closure, type(closure.base).__name__, static, metadata

    return path, read


def _dataset(folder: Path) -> Made:
    path, rows = folder / "data.h5", np.random.default_rng(0)
    columns = {name: rows.uniform(0.1, 0.3, 20) for name in SCALARS}
    columns |= {name: rows.normal(size=(20, 2)) for name in VECTORS}
    attributes = {
        "drag": "koch_hill", "fluid_density": 1000.0, "dynamic_viscosity": 1e-3, "dimension": 2, "run": "one",
        "scene_toml": "seed = 1\n",
    }  # fmt: skip
    write_dataset(path, attributes, {2: {"filter_size": 0.1, "kernel_width": 0.1, **columns}})
    return path, lambda: read_dataset(path)


def _checkpoint(folder: Path) -> Made:
    path = folder / "checkpoint.h5"
    write_checkpoint(path, {f"a{k}": np.arange(20.0) + k for k in range(30)}, {"frames": 1, "samples": 1})
    return path, lambda: read_checkpoint(path)


def _rows(name: str) -> Callable[[Path], Made]:
    def make(folder: Path) -> Made:
        path, values = folder / name, np.random.default_rng(0).uniform(size=(20, 2))
        if path.suffix == ".npy":
            np.save(path, values)
        else:
            np.savetxt(path, values, delimiter=",")
        return path, lambda: rows_of("particles.position", str(path), 2)

    return make


def _run(name: str) -> Callable[[Path], Made]:
    def make(folder: Path) -> Made:
        out = folder / "run"
        with RunDirectory.create(out, RUN_SCENE) as run:
            vectors, cells = np.ones((5, 2), np.float32), np.ones((4, 3), np.float32)
            particles = {
                "position": vectors,
                "velocity": vectors,
                "radius": vectors[:, 0],
                "id": np.arange(5),
            }
            fluid = {"velocity": np.ones((4, 3, 2), np.float32), "pressure": cells, "void_fraction": cells}
            for index in range(4):
                row = {"runoff": 0.1 * index}
                run.write_sample(index, 0.1 * index, {"slip_velocity": vectors})
                run.write_frame(index, 0.1 * index, {"particles": particles, "fluid": fluid}, row)
            run.finish({"valid": True})

        def read() -> object:
            found = load_run(out)
            frames = [(found.particles(index), found.fluid(index)) for index in range(found.number_of_frames)]
            samples = found.samples or ()
            sampled = [samples.frame(index) for index in range(len(samples))]  # type: ignore[union-attr]
            return frames, sampled, found.history, found.summary, found.scene

        return out / name, read

    return make


def _before_110(name: str) -> Callable[[Path], Made]:
    """A file as HDF5 writes it by default: tables without checksums, text of variable length."""

    def make(folder: Path) -> Made:
        path, read = KINDS[name](folder)
        with h5py.File(path) as new, h5py.File(folder / "old", "w", libver="earliest") as old:

            def attributes(item: Any, target: Any) -> None:
                for key, value in hdf5.attributes_of(item).items():
                    target.attrs[key] = value

            def one(where: str, item: Any) -> None:
                is_group = isinstance(item, h5py.Group)
                target = old.require_group(where) if is_group else old.create_dataset(where, data=item[()])
                attributes(item, target)

            attributes(new, old)
            new.visititems(one)
        (folder / "old").replace(path)
        return path, read

    return make


KINDS: dict[str, Callable[[Path], Made]] = {
    "closure": _closure,
    "dataset": _dataset,
    "checkpoint": _checkpoint,
    "positions.npy": _rows("positions.npy"),
    "positions.csv": _rows("positions.csv"),
    **{
        name: _run(name)
        for name in (
            "particles.vtkhdf",
            "fluid.vtkhdf",
            "samples.h5",
            "history.csv",
            "summary.json",
            "scene.toml",
        )
    },
}
"""Name -> a function that writes such a file into a folder and returns its path and a reader of it."""

BEFORE_110 = tuple(f"{name} of HDF5 before 1.10" for name in ("closure", "dataset", "samples.h5"))
KINDS |= {name: _before_110(name.partition(" ")[0]) for name in BEFORE_110}
"""Those of earlier versions, in which single altered bits hang or crash the HDF5 library."""

CHANGES = ("cut", "empty", "text", "foreign HDF5", "zeros", "noise")
BIT = ("bit",)


def damaged(content: bytes, change: str, generator: random.Random) -> bytes:
    """The content with a change; zeros and noise are written over the second half, where the numbers are."""
    if change == "cut":
        return content[: generator.randrange(len(content))]
    if change in ("empty", "text"):
        return b"" if change == "empty" else b"Dear Sir,\n"
    if change == "bit":
        place, bit = generator.randrange(len(content)), generator.randrange(8)
        return content[:place] + bytes([content[place] ^ (1 << bit)]) + content[place + 1 :]
    if change == "foreign HDF5":
        with h5py.File("foreign", "w", driver="core", backing_store=False) as file:
            file["x"] = np.arange(3)
            file.flush()
            return bytes(file.id.get_file_image())
    start = generator.randrange(len(content) // 2, len(content))
    length = min(64, len(content) - start)
    patch = bytes(length) if change == "zeros" else generator.randbytes(length)
    return content[:start] + patch + content[start + length :]


def read_damaged(kind: str, number: int, seed: int, changes: tuple[str, ...] = CHANGES) -> dict[str, int]:
    """How many damaged files of a kind were refused, read as they were written, and read as something else."""
    generator = random.Random(seed)
    found: collections.Counter[str] = collections.Counter()
    with tempfile.TemporaryDirectory() as folder:
        path, read = KINDS[kind](Path(folder))
        written, content = _digest(read()), path.read_bytes()
        for index in range(number):
            path.write_bytes(damaged(content, changes[index % len(changes)], generator))
            try:
                same = _digest(read()) == written
            except InputError as error:
                assert error.key and error.remedy, error
                found["refused"] += 1
            else:
                found["read as written" if same else "read as something else"] += 1
    return dict(found)


def _digest(content: object) -> str:
    """A checksum of everything that a reader returned."""
    digest = hashlib.sha256()
    for place, leaf in jax.tree_util.tree_flatten_with_path(_unwrapped(content))[0]:
        array = np.asarray(leaf)
        digest.update(f"{jax.tree_util.keystr(place)} {array.dtype} {array.shape}".encode() + array.tobytes())
    return digest.hexdigest()


def _unwrapped(content: object) -> object:
    """Datasets as dictionaries; JAX takes all else apart by itself."""
    return dataclasses.asdict(content) if isinstance(content, Dataset) else content


def main(kind: str, number: int, bits: int, seed: int) -> None:
    """Prints the counts of all damages and those of single bits."""
    hdf5.TRIAL_SECONDS = 5.0
    found = read_damaged(kind, number, seed)
    altered = read_damaged(kind, bits, seed, BIT)
    print(json.dumps(found | {f"one bit altered, {name}": n for name, n in altered.items()}))


if __name__ == "__main__":
    main(sys.argv[1], *(int(number) for number in sys.argv[2:]))
