"""The command `jaxdem finetune`, which has a parameter for every option, however many."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from jaxdem.cli import options, terminal
from jaxdem.cli.inputs import load_run, prepare_file, read_scene, require_closure, start_jax, whole_numbers
from jaxdem.errors import InputError

if TYPE_CHECKING:
    from jaxdem.train.closures import Closures

NEW = "new"
"""Value of --subgrid for a stress that has not been trained."""


def finetune(
    scene: options.SceneFile,
    reference: options.ReferenceOption,
    out: Annotated[
        Path, options.file_out("Closure file to write (HDF5); that of the drag closure, if both are trained.")
    ],
    closure: options.StartClosure = None,
    subgrid: options.StartSubgrid = None,
    subgrid_out: options.SubgridOut = None,
    horizons: options.Horizons = None,
    updates: options.Updates = 10,
    learning_rate: options.LearningRate = 3e-3,
    settings: options.Settings = None,
    quiet: options.Quiet = False,
) -> None:
    """Train closures through runs of a coarse scene, so that these have the same statistics as a fine run."""
    from jaxdem.scene import named_files

    description = read_scene(scene, settings)
    chosen = None if horizons is None else whole_numbers("--horizons", horizons, ",")
    stress = None if subgrid in (None, NEW) else Path(subgrid)
    read = (scene, reference, *named_files(description.model_dump()), closure, stress)
    prepare_file(out, *read)
    if subgrid_out is not None:
        prepare_file(subgrid_out, *read, option="--subgrid-out")
    require_closure("--closure", closure)
    require_closure("--subgrid", stress)
    names = _trained(closure, subgrid)
    files = _files(names, out, subgrid_out)
    load_run(reference)  # refused before JAX is there
    start_jax(description.precision)
    from jaxdem.cli import progress
    from jaxdem.closures import save_closure
    from jaxdem.train import finetune as solver

    training = solver.FinetuneSettings(horizons=chosen, updates=updates, learning_rate=learning_rate)
    start, metadata = _start(closure, subgrid, names)
    with progress.counted("update", quiet) as report:
        result = solver.finetune(description, reference, start, metadata, training, report)
    for name, path in files.items():
        save_closure(path, getattr(result.closures, name), result.metadata[name])
    record = result.metadata[names[0]]["finetune"]
    before, after = record["validation_loss_before"], record["validation_loss"]
    skipped = f", {record['skipped']} updates skipped" if record["skipped"] else ""
    terminal.line(f"Loss over the longest horizon: {before:.4g} before, {after:.4g} after{skipped}")
    terminal.line(f"Wrote {' and '.join(map(str, files.values()))} after {record['seconds']:.3g} s")
    if result.stopped:
        terminal.fail(result.stopped, 1)


def _trained(closure: Path | None, subgrid: str | None) -> tuple[str, ...]:
    """Names of the closures that are given: all of them are trained."""
    given = tuple(name for name, source in (("drag", closure), ("subgrid", subgrid)) if source is not None)
    if not given:
        raise InputError("--closure", "", "is needed, or --subgrid", "Give a closure file, or --subgrid new.")
    return given


def _start(
    closure: Path | None, subgrid: str | None, names: tuple[str, ...]
) -> tuple[Closures, dict[str, dict[str, Any]]]:
    """The closures to start from, and the metadata of their files."""
    from jaxdem.closures import SubgridClosure, load_subgrid
    from jaxdem.closures.file import load_single
    from jaxdem.train.closures import Closures

    metadata: dict[str, dict[str, Any]] = {}
    drag = stress = None
    if closure is not None:
        drag, metadata["drag"] = load_single(closure, "Fine-tune one of its members, or distill it first.")
    if subgrid == NEW:
        stress, metadata["subgrid"] = SubgridClosure.initial(), {}
    elif subgrid is not None:
        stress, metadata["subgrid"] = load_subgrid(subgrid)
    return Closures(drag, stress, names), metadata


def _files(trained: tuple[str, ...], out: Path, subgrid_out: Path | None) -> dict[str, Path]:
    """Where each closure that is trained is written to."""
    if len(trained) == 1 and subgrid_out is not None:
        limit = f"is only used where both closures are trained; here only {trained[0]} is trained"
        raise InputError("--subgrid-out", str(subgrid_out), limit, "Remove --subgrid-out.")
    if len(trained) == 1:
        return {trained[0]: out}
    if subgrid_out is None or subgrid_out.resolve() == out.resolve():
        limit = "is needed where both closures are trained, and must differ from --out"
        raise InputError("--subgrid-out", str(subgrid_out or ""), limit, "Give a file for the subgrid stress.")
    return {"drag": out, "subgrid": subgrid_out}
