"""The commands that make networks: train (one, several at once, an ensemble), distill, prune."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from jaxdem import terminal
from jaxdem.cli_options import prepare_file, prepare_folder, whole_numbers
from jaxdem.compilation_cache import use_compilation_cache
from jaxdem.errors import InputError

if TYPE_CHECKING:
    from jaxdem.train.dataset_file import Dataset
    from jaxdem.train.fit import FitResult, FitSettings

FIGURE = "sweep.png"


class Recipe(StrEnum):
    """How a closure is fitted."""

    paper = "paper"
    filtered = "filtered"


Datasets = Annotated[list[Path], typer.Argument(metavar="DATASET...", help="From `jaxdem dataset`.")]
Closure = Annotated[Path, typer.Argument(metavar="CLOSURE", help="Closure file.", show_default=False)]
Out = Annotated[Path, typer.Option(metavar="FILE", help="Closure file to write (HDF5).")]
Seed = Annotated[int | None, typer.Option(min=0, help="Of weights, shuffling and choice of rows.")]
Epochs = Annotated[int | None, typer.Option(min=1, help="Passes through the data.")]
Rows = Annotated[int | None, typer.Option(min=1, help="Largest number of training rows.")]
Hidden = Annotated[
    str | None, typer.Option(metavar="N-N-...", help="Widths of the hidden layers: 170-70-30.")
]


def train(
    datasets: Datasets,
    out: Annotated[Path, typer.Option(metavar="PATH", help="Closure file to write; with --sweep a folder.")],
    recipe: Annotated[Recipe, typer.Option(help="The source paper's, or the one on filtered inputs.")] = (
        Recipe.filtered
    ),
    seed: Seed = None,
    epochs: Epochs = None,
    samples: Rows = None,
    hidden: Hidden = None,
    activation: Annotated[str | None, typer.Option(help="Of the hidden layers, e.g. elu.")] = None,
    loss: Annotated[str | None, typer.Option(help="mse, mae, ...; the filtered recipe has its own.")] = None,
    terms: Annotated[
        str | None,
        typer.Option(metavar="A,B", help="Of the remainder (filtered): void_fraction_gradient, ..."),
    ] = None,
    ensemble: Annotated[
        int | None, typer.Option(metavar="N", min=2, help="Train N networks and keep them as one closure.")
    ] = None,
    sweep: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=A,B,C", help="Train all combinations: seed=0,1,2; may be given many times."
        ),
    ] = None,
) -> None:
    """Fit a learned drag closure to datasets; the last dataset's run is held out."""
    changes: dict[str, Any] = {
        "seed": seed, "epochs": epochs, "samples": samples, "activation": activation, "loss": loss,
        "hidden": _widths(hidden),
        "terms": None if terms is None else tuple(terms.split(",")),
    }  # fmt: skip
    if sweep and ensemble is not None:
        raise InputError("--ensemble", ensemble, "cannot be had with --sweep", "Give one of them.")
    (prepare_folder if sweep else prepare_file)(out)
    use_compilation_cache()
    from jaxdem.train.fit import FitSettings, fit_filtered, fit_paper

    make = FitSettings if recipe is Recipe.paper else FitSettings.filtered
    chosen = make(**{name: value for name, value in changes.items() if value is not None})
    data = _read(datasets)
    if sweep:
        _search(data, recipe, chosen, sweep, out)
        return
    with terminal.counted("epoch") as progress:
        if ensemble is not None:
            from jaxdem.train.ensemble import fit_ensemble

            result = fit_ensemble(data, recipe.value, chosen, ensemble, progress)
        else:
            result = (fit_paper if recipe is Recipe.paper else fit_filtered)(data, chosen, progress)
    _save(out, result)
    for coarsening, figures in result.metadata.get("spread", {}).items():
        _line(
            f"Coarsening {coarsening}: spread {figures['spread']:.2g}, error {figures['error']:.2g} of the force; "
            f"{100 * figures['within_two_spreads']:.0f} % of the errors are within two spreads"
        )


def _search(
    data: Sequence[Dataset], recipe: Recipe, settings: FitSettings, sweep: Sequence[str], out: Path
) -> None:
    from jaxdem.report.networks import Scores, networks_figure
    from jaxdem.train.architecture_search import parse_sweep, search
    from jaxdem.train.architecture_table import as_text

    varied = [parse_sweep(text) for text in sweep]
    with terminal.study_display() as display:
        found = search(data, recipe.value, settings, varied, out, display)
    scores = [
        Scores(
            ", ".join(f"{name} {as_text(value)}" for name, value in chosen.items()) or "all seeds",
            {n: [network.r2(n) for network in networks] for n in found.coarsenings},
            found.paper_r2(networks[0]),
        )
        for chosen, networks in found.by_seed()
    ]
    networks_figure(scores, out / FIGURE)
    _line(found.page())
    _line(f"Wrote {len(found.networks)} networks and their table to {out}")
    lost = [network.name for network in found.networks if network.metadata is None]
    if lost:
        terminal.fail(
            f"{len(lost)} of {len(found.networks)} networks have no finite loss: {', '.join(lost)}", 1
        )


def distill(
    closure: Closure,
    datasets: Datasets,
    out: Out,
    hidden: Hidden = None,
    seed: Seed = None,
    epochs: Epochs = None,
    samples: Rows = None,
    activation: Annotated[str | None, typer.Option(help="Of the hidden layers; the teacher's.")] = None,
) -> None:
    """Train a smaller network on the forces that a closure gives for the inputs of datasets."""
    changes: dict[str, Any] = {
        "seed": seed, "epochs": epochs, "samples": samples, "activation": activation,
        "hidden": _widths(hidden) or (32, 16),
    }  # fmt: skip
    prepare_file(out)
    use_compilation_cache()
    from jaxdem.closures import load_closure
    from jaxdem.train.compress import distill as teach
    from jaxdem.train.compress import settings_for

    teacher, _ = load_closure(closure)
    chosen, data = settings_for(teacher, **changes), _read(datasets)
    with terminal.counted("epoch") as progress:
        result = teach(teacher, data, chosen, progress)
    _save(out, result)
    record = result.metadata["distilled"]
    for coarsening, value in record["r2_of_teacher"].items():
        against = record["r2_against_teacher"][coarsening]
        _line(
            f"Coarsening {coarsening}: the teacher has R2 {value:.4f}; against it the student {against:.4f}"
        )


def prune(
    closure: Closure,
    datasets: Datasets,
    out: Out,
    neurons: Annotated[float, typer.Option(help="Part of each layer's neurons that is kept.")] = 0.5,
    epochs: Annotated[int | None, typer.Option(min=1, help="Train the smaller network so long.")] = None,
    seed: Seed = None,
    samples: Rows = None,
) -> None:
    """Remove the neurons of a closure that matter least for the inputs of datasets."""
    prepare_file(out)
    use_compilation_cache()
    from jaxdem.closures.file import load_single
    from jaxdem.train.compress import prune as make_smaller
    from jaxdem.train.compress import settings_for

    given, _ = load_single(closure, "Prune one of its members, or distill it.")
    chosen = settings_for(given, seed=seed, epochs=epochs, samples=samples)
    data = _read(datasets)
    with terminal.counted("epoch") as progress:
        result = make_smaller(given, data, neurons, chosen, epochs is not None, progress)
    _save(out, result)
    widths = ("-".join(map(str, result.metadata[key][name])) for key, name in (
        ("pruned", "hidden_before"), ("settings", "hidden")))  # fmt: skip
    _line("Hidden layers from {} to {}".format(*widths))
    for coarsening, value in result.metadata["pruned"]["r2_before"].items():
        _line(f"Coarsening {coarsening}: R2 was {value:.4f}")


def _widths(hidden: str | None) -> tuple[int, ...] | None:
    return None if hidden is None else whole_numbers("--hidden", hidden, "-")


def _read(datasets: Sequence[Path]) -> list[Dataset]:
    from jaxdem.train.dataset_file import read_dataset

    return [read_dataset(path) for path in datasets]


def _save(out: Path, result: FitResult) -> None:
    """Write the closure and say how good it is."""
    from jaxdem.closures import save_closure

    metadata: dict[str, Any] = result.metadata
    save_closure(out, result.closure, metadata)
    terminal.output().print(terminal.fit_table(metadata))
    _line(f"Split {result.split}")
    _line(f"Wrote {out} after {metadata['seconds']:.3g} s of training")


def _line(text: str) -> None:
    terminal.output().print(text, markup=False, highlight=False, soft_wrap=True)
