"""The commands of learned closures: dataset, train (one, or an ensemble), evaluate, distill, prune, export.

A command has a parameter for every option, however many.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from jaxdem.cli import options, terminal
from jaxdem.cli.inputs import (
    load_run,
    overrides,
    prepare_file,
    require_closure,
    require_datasets,
    start_jax,
    whole_numbers,
)
from jaxdem.errors import InputError

if TYPE_CHECKING:
    from jaxdem.train.dataset_file import Dataset
    from jaxdem.train.fit import FitResult

ClosureOut = Annotated[Path, options.file_out("Closure file to write (HDF5).")]


def dataset(
    run: options.SampledRun,
    out: Annotated[Path, options.file_out("Dataset file to write (HDF5).")],
    coarsen: options.Coarsen = "1,2,4,8",
    settings: options.CoarseSettings = None,
    quiet: options.Quiet = False,
) -> None:
    """Make training data from a fine run: inputs of the drag law on coarser meshes, and the drag that it should
    give."""
    factors = whole_numbers("--coarsen", coarsen, ",")
    changed = overrides(settings)
    prepare_file(out, run)
    load_run(run)  # refused before JAX is there
    start_jax()
    from jaxdem.cli import progress
    from jaxdem.train.dataset import make_dataset

    with progress.counted("sample", quiet) as report:
        make_dataset(run, out, factors, progress=report, overrides=changed)
    terminal.line(f"Wrote {out}")


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
    require_datasets(datasets, ", or --recipe neighbours for forces on spheres")
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
    datasets: options.SampleData,
    out: ClosureOut,
    hidden: options.Hidden = None,
    seed: options.Seed = None,
    epochs: options.Epochs = None,
    quiet: options.Quiet = False,
) -> None:
    """Train a smaller network to give the same forces as a closure, on the inputs of datasets."""
    layers = _widths(hidden) or (32, 16)
    _prepare(out, closure, datasets)
    from jaxdem.cli import progress
    from jaxdem.closures.file import load_stored
    from jaxdem.train import compress

    teacher, _ = load_stored(closure)
    changes = {"seed": seed, "epochs": epochs, "hidden": layers}
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
    datasets: options.SampleData,
    out: ClosureOut,
    neurons: options.KeptNeurons = 0.5,
    epochs: options.FurtherEpochs = None,
    quiet: options.Quiet = False,
) -> None:
    """Remove the neurons of a closure that change its result least, on the inputs of datasets."""
    _prepare(out, closure, datasets)
    from jaxdem.cli import progress
    from jaxdem.closures.file import load_single
    from jaxdem.train import compress

    network, _ = load_single(closure, "Prune one of its members, or distill it.")
    chosen = compress.settings_for(network, epochs=epochs)
    data = _read(datasets)
    with progress.counted("epoch", quiet) as report:
        result = compress.prune(network, data, neurons, chosen, epochs is not None, report)
    _save(out, result)
    before, after = result.metadata["pruned"]["hidden_before"], result.metadata["settings"]["hidden"]
    terminal.line("Hidden layers reduced from {} to {}".format(*("-".join(map(str, w)) for w in (before, after))))
    for coarsening, value in result.metadata["pruned"]["r2_before"].items():
        terminal.line(f"Coarsening {coarsening}: R2 before pruning was {value:.4f}")


def export(
    closure: options.FilteredClosure,
    form: options.Form,
    out: Annotated[Path, options.file_out("File to write.")],
) -> None:
    """Write a learned drag closure for use in another program, including its base law and fallback."""
    prepare_file(out, closure)
    require_closure("CLOSURE", closure)
    start_jax()
    from jaxdem.closures import load_closure
    from jaxdem.closures.export import export_closure, files_written
    from jaxdem.version import __version__

    for file in files_written(form.value, out):
        prepare_file(file, closure)

    for path in export_closure(*load_closure(closure), form.value, out, __version__):
        terminal.line(f"Wrote {path}")


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
