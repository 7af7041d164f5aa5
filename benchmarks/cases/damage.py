"""Damaged files: cut, overwritten, altered in a bit or exchanged for those of another program, and read.

    python -m benchmarks.cases.damage KIND NUMBER SEED

prints how many were refused with a message and how many read, as JSON; anything else is an error.
"""

from __future__ import annotations

import collections
import json
import random
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from jaxdem.closures import KochHill, load_closure, save_closure
from jaxdem.closures.network import PaperNetwork
from jaxdem.errors import InputError
from jaxdem.io import RunDirectory, load_run, read_checkpoint, write_checkpoint
from jaxdem.rows import rows_of
from jaxdem.train.dataset_file import SCALARS, VECTORS, read_dataset, write_dataset

RUN_SCENE = "[domain]\nsize = [0.4, 0.3]\n[fluid]\ncells = [4, 3]\n"


def _closure(folder: Path) -> tuple[Path, Callable[[], object]]:
    path = folder / "closure.h5"
    save_closure(path, PaperNetwork.initial(2, KochHill(), (4, 4), "elu"), {"seed": 1})
    return path, lambda: load_closure(path)


def _dataset(folder: Path) -> tuple[Path, Callable[[], object]]:
    path, rows = folder / "data.h5", np.random.default_rng(0)
    columns = {name: rows.uniform(0.1, 0.3, 20) for name in SCALARS}
    columns |= {name: rows.normal(size=(20, 2)) for name in VECTORS}
    attributes = {
        "drag": "koch_hill", "fluid_density": 1000.0, "dynamic_viscosity": 1e-3, "dimension": 2, "run": "one",
        "scene_toml": "seed = 1\n",
    }  # fmt: skip
    write_dataset(path, attributes, {2: {"filter_size": 0.1, "kernel_width": 0.1, **columns}})
    return path, lambda: read_dataset(path)


def _checkpoint(folder: Path) -> tuple[Path, Callable[[], object]]:
    path = folder / "checkpoint.h5"
    write_checkpoint(path, {f"a{k}": np.arange(20.0) + k for k in range(30)}, {"frames": 1, "samples": 1})
    return path, lambda: read_checkpoint(path)


def _rows(name: str) -> Callable[[Path], tuple[Path, Callable[[], object]]]:
    def make(folder: Path) -> tuple[Path, Callable[[], object]]:
        path, values = folder / name, np.random.default_rng(0).uniform(size=(20, 2))
        if path.suffix == ".npy":
            np.save(path, values)
        else:
            np.savetxt(path, values, delimiter=",")
        return path, lambda: rows_of("particles.position", str(path), 2)

    return make


def _run(name: str) -> Callable[[Path], tuple[Path, Callable[[], object]]]:
    def make(folder: Path) -> tuple[Path, Callable[[], object]]:
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
                run.write_frame(index, 0.1 * index, particles, fluid, {"slip_velocity": vectors}, row)
            run.finish({"valid": True})

        def read() -> None:
            found = load_run(out)
            for index in range(found.number_of_frames):
                found.particles(index), found.fluid(index)
            for index in range(len(found.samples or ())):
                found.samples.frame(index)  # type: ignore[union-attr]

        return out / name, read

    return make


KINDS: dict[str, Callable[[Path], tuple[Path, Callable[[], object]]]] = {
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

CHANGES = ("cut", "empty", "text", "foreign HDF5", "zeros", "noise")


def damaged(content: bytes, change: str, generator: random.Random) -> bytes:
    """The content with a change; zeros and noise are written over the second half, where the numbers are."""
    if change == "cut":
        return content[: generator.randrange(len(content))]
    if change in ("empty", "text"):
        return b"" if change == "empty" else b"Dear Sir,\n"
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
    """How many damaged files of a kind were read, and how many refused."""
    generator = random.Random(seed)
    found: collections.Counter[str] = collections.Counter()
    with tempfile.TemporaryDirectory() as folder:
        path, read = KINDS[kind](Path(folder))
        read()
        content = path.read_bytes()
        for index in range(number):
            path.write_bytes(damaged(content, changes[index % len(changes)], generator))
            try:
                read()
            except InputError as error:
                assert error.key and error.remedy, error
                found["refused"] += 1
            else:
                found["read"] += 1
    return dict(found)


if __name__ == "__main__":
    print(json.dumps(read_damaged(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))))
