"""The commands that make networks: train (one, or an ensemble), evaluate, distill, prune, finetune.

A command has a parameter for every option, however many.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from jaxdem.cli import options, terminal
from jaxdem.cli.inputs import (
    prepare_file,
    read_scene,
    require_closure,
    require_datasets,
    start_jax,
    whole_numbers,
)
from jaxdem.errors import InputError
from jaxdem.train import check_trained

if TYPE_CHECKING:
    from jaxdem.train.closures import Closures
    from jaxdem.train.dataset_file import Dataset
    from jaxdem.train.fit import FitResult

NEW = "new"
"""Value of --subgrid for a stress that has not been trained."""
ALL = ("drag", "subgrid")
"""What can be trained through the solver, by the names of `jaxdem.train.closures`."""

ClosureOut = Annotated[Path, options.file_out("Closure file to write (HDF5).")]


def train(
    datasets: options.Datasets,
    out: ClosureOut,
    recipe: options.RecipeName = options.Recipe.filtered,
    seed: options.Seed = None,
    epochs: options.Epochs = None,
    samples: options.Rows = None,
    hidden: options.Hidden = None,
    terms: options.Terms = None,
    features: options.Features = None,
    bounded: options.Bounded = False,
    loss: options.LossName = None,
    ensemble: options.Members = None,
    size: options.SizeName = None,
    quiet: options.Quiet = False,
) -> None:
    """Train a drag closure on datasets; for testing the run of the last one is held out, or a tenth of the arrays of
    spheres."""
    changes: dict[str, Any] = {
        "seed": seed, "epochs": epochs, "samples": samples, "hidden": _widths(hidden),
        "terms": _names(terms), "features": _names(features), "bounded": bounded or None,
        "loss": None if loss is None else loss.value,
    }  # fmt: skip
    if recipe is not options.Recipe.filtered:
        _refuse_options_of_filtered(changes)
    prepare_file(out, *datasets)
    if recipe is options.Recipe.neighbours:
        _train_neighbours(datasets, out, {**changes, "ensemble": ensemble, "size": size}, quiet)
        return
    if size is not None:
        raise InputError("--size", size.value, "belongs to --recipe neighbours", "Give --hidden, or the recipe.")
    require_datasets(datasets)
    start_jax()
    from jaxdem.cli import progress
    from jaxdem.train.ensemble import fit_ensemble
    from jaxdem.train.fit import FitSettings, fit_filtered, fit_paper

    paper = recipe is options.Recipe.paper
    chosen = (FitSettings if paper else FitSettings.filtered)(**{n: v for n, v in changes.items() if v is not None})
    data = _read(datasets)
    with progress.counted("epoch", quiet) as report:
        if ensemble is not None:
            result = fit_ensemble(data, recipe.value, chosen, ensemble, report)
        else:
            result = (fit_paper if paper else fit_filtered)(data, chosen, report)
    _save(out, result)
    for coarsening, figures in result.metadata.get("spread", {}).items():
        terminal.line(
            f"Coarsening {coarsening}: spread {figures['spread']:.2g}, error {figures['error']:.2g} of the force; "
            f"{100 * figures['within_two_spreads']:.0f} % of the errors are within two spreads"
        )


def _names(given: str | None) -> tuple[str, ...] | None:
    """Names that are separated by commas; None where they are left out."""
    return None if given is None else tuple(given.split(","))


def _refuse_options_of_filtered(given: dict[str, Any]) -> None:
    for name in ("terms", "features", "bounded", "loss"):
        if given[name] is not None:
            limit = "belongs to --recipe filtered"
            raise InputError(f"--{name}", given[name], limit, f"Leave out --{name}, or take that recipe.")


def _train_neighbours(data: Sequence[Path], out: Path, given: dict[str, Any], quiet: bool) -> None:
    """Train a closure of neighbours on forces on spheres."""
    chosen = {name: value for name, value in given.items() if value is not None}
    if "ensemble" in chosen:
        limit = "belongs to --recipe filtered or paper"
        raise InputError("--ensemble", chosen["ensemble"], limit, "Leave out --ensemble.")
    if len(data) != 1:
        raise InputError("DATA", list(map(str, data)), "must be one file", "Put all groups into one file.")
    start_jax()
    from jaxdem.cli import progress
    from jaxdem.closures import save_closure
    from jaxdem.train.neighbor_settings import NeighborSettings
    from jaxdem.train.neighbors import fit_neighbors

    settings = NeighborSettings(**{**chosen, **({"size": chosen["size"].value} if "size" in chosen else {})})
    with progress.counted("epoch", quiet) as report:
        trained = fit_neighbors(data[0], settings, report)
    save_closure(out, trained.closure, trained.metadata)
    terminal.show(terminal.sphere_table(trained.metadata["r2"], trained.metadata["r2_linear"]))
    terminal.line(f"Wrote {out} after {trained.metadata['seconds']:.3g} s of training")


def evaluate(
    closure: options.Closure,
    data: options.SphereData,
) -> None:
    """Compare a closure of neighbours with the forces on spheres in a file, all its arrays."""
    require_closure("CLOSURE", closure)
    start_jax()
    from jaxdem.closures.file import load_neighbors
    from jaxdem.train.neighbor_scores import evaluate_neighbours

    terminal.show(terminal.sphere_table(evaluate_neighbours(load_neighbors(closure)[0], data)))


def distill(
    closure: options.Closure,
    datasets: options.Datasets,
    out: ClosureOut,
    hidden: options.Hidden = None,
    seed: options.Seed = None,
    epochs: options.Epochs = None,
    samples: options.Rows = None,
    quiet: options.Quiet = False,
) -> None:
    """Train a smaller network to give the same forces as a closure, on the inputs of datasets."""
    layers = _widths(hidden) or (32, 16)
    _prepare(out, closure, datasets)
    from jaxdem.cli import progress
    from jaxdem.closures.file import load_stored
    from jaxdem.train import compress

    teacher, _ = load_stored(closure)
    changes = {"seed": seed, "epochs": epochs, "samples": samples, "hidden": layers}
    chosen, data = compress.settings_for(teacher, **changes), _read(datasets)
    with progress.counted("epoch", quiet) as report:
        result = compress.distill(teacher, data, chosen, report)
    _save(out, result)
    record = result.metadata["distilled"]
    for coarsening, value in record["r2_of_teacher"].items():
        against = record["r2_against_teacher"][coarsening]
        terminal.line(
            f"Coarsening {coarsening}: the R2 of the given closure is {value:.4f}; "
            f"the R2 of the new one against it is {against:.4f}"
        )


def prune(
    closure: options.Closure,
    datasets: options.Datasets,
    out: ClosureOut,
    neurons: options.KeptNeurons = 0.5,
    epochs: options.FurtherEpochs = None,
    seed: options.Seed = None,
    samples: options.Rows = None,
    quiet: options.Quiet = False,
) -> None:
    """Remove the neurons of a closure that change its result least, on the inputs of datasets."""
    _prepare(out, closure, datasets)
    from jaxdem.cli import progress
    from jaxdem.closures.file import load_single
    from jaxdem.train import compress

    network, _ = load_single(closure, "Prune one of its members, or distill it.")
    chosen = compress.settings_for(network, seed=seed, epochs=epochs, samples=samples)
    data = _read(datasets)
    with progress.counted("epoch", quiet) as report:
        result = compress.prune(network, data, neurons, chosen, epochs is not None, report)
    _save(out, result)
    before, after = result.metadata["pruned"]["hidden_before"], result.metadata["settings"]["hidden"]
    terminal.line("Hidden layers reduced from {} to {}".format(*("-".join(map(str, w)) for w in (before, after))))
    for coarsening, value in result.metadata["pruned"]["r2_before"].items():
        terminal.line(f"Coarsening {coarsening}: R2 before pruning was {value:.4f}")


def finetune(
    scene: options.SceneFile,
    reference: options.ReferenceOption,
    out: Annotated[
        Path, options.file_out("Closure file to write (HDF5); that of the drag closure, if both are trained.")
    ],
    closure: options.StartClosure = None,
    subgrid: options.StartSubgrid = None,
    trained: options.TrainedClosures = None,
    subgrid_out: options.SubgridOut = None,
    horizons: options.Horizons = None,
    updates: options.Updates = 10,
    learning_rate: options.LearningRate = 3e-3,
    method: options.MethodName = options.Method.gradient,
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
    names = _trained(closure, subgrid, trained)
    files = _files(names, out, subgrid_out)
    from jaxdem.io import load_run

    load_run(reference)  # refused before JAX is there
    start_jax(description.precision)
    from jaxdem.cli import progress
    from jaxdem.closures import save_closure
    from jaxdem.train import finetune as solver

    training = solver.FinetuneSettings(
        horizons=chosen, updates=updates, learning_rate=learning_rate, method=method.value
    )
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


def _trained(closure: Path | None, subgrid: str | None, trained: options.Trained | None) -> tuple[str, ...]:
    """Names of the closures that are trained."""
    present = [name for name, source in zip(ALL, (closure, subgrid), strict=True) if source is not None]
    names = tuple(present) if trained is None else ALL if trained is options.Trained.both else (trained.value,)
    check_trained(names, present)
    return names


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


def _prepare(out: Path, closure: Path, datasets: Sequence[Path]) -> None:
    """Refuse files that cannot be used, and start JAX."""
    prepare_file(out, closure, *datasets)
    require_closure("CLOSURE", closure)
    require_datasets(datasets)
    start_jax()


def _widths(hidden: str | None) -> tuple[int, ...] | None:
    return None if hidden is None else whole_numbers("--hidden", hidden, "-")


def _read(datasets: Sequence[Path]) -> list[Dataset]:
    from jaxdem.train.dataset_file import read_dataset

    return [read_dataset(path) for path in datasets]


def _save(out: Path, result: FitResult) -> None:
    """Write the closure and say how good it is."""
    from jaxdem.closures import save_closure

    save_closure(out, result.closure, result.metadata)
    terminal.show(terminal.fit_table(result.metadata))
    terminal.line(f"Split {result.split}")
    terminal.line(f"Wrote {out} after {result.metadata['seconds']:.3g} s of training")
