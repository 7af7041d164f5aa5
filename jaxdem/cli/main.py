"""The command line: reads files and options, calls the library, says what happened.

A command has a parameter for every option, however many.
Exit codes: 0 done, 1 the run failed, 2 the input is wrong, 130 and 143 after SIGINT and SIGTERM.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from jaxdem.cli import networks, options, process, run, study, terminal
from jaxdem.cli.grouped_help import GroupedHelp
from jaxdem.cli.inputs import (
    overrides,
    prepare_file,
    prepare_folder,
    read_scene,
    require_closure,
    start_jax,
    this_command,
    whole_numbers,
)
from jaxdem.cli.units import warn_of_units
from jaxdem.errors import InputError, JaxdemError

if TYPE_CHECKING:
    from jaxdem.io import Run

OUT_OF_MEMORY = "RESOURCE_EXHAUSTED"


class Commands(TyperGroup):
    """The commands; what jaxdem raises on purpose becomes one message and an exit code."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """The first sentence of each, as many lines as it needs."""
        rows = [(name, self.commands[name].get_short_help_str(limit=200)) for name in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl(rows)

    def make_context(self, *args: Any, **options: Any) -> Any:
        """Read the arguments; `--help` and `--version` are printed here."""
        try:
            return super().make_context(*args, **options)
        except BrokenPipeError:
            raise SystemExit(process.BROKEN_PIPE) from None

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        try:
            return super().invoke(ctx)
        except JaxdemError as error:
            terminal.fail(str(error), error.exit_code)
        except BrokenPipeError:  # who read the output has gone
            raise SystemExit(process.BROKEN_PIPE) from None
        except OSError as error:
            place, what = f"{error.filename}: " if error.filename else "", error.strerror or error
            terminal.fail(f"{place}{what}. Free some disk space or correct the permissions, and try again.", 1)
        except (MemoryError, RuntimeError) as error:
            if isinstance(error, RuntimeError) and OUT_OF_MEMORY not in str(error):
                raise
            first = (str(error).splitlines() or ["out of memory"])[0]
            remedy = "`jaxdem check` prints the estimated memory. Use fewer particles or cells."
            terminal.fail(f"Out of memory ({first}). {remedy}", 1)


app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help: rich's takes longer to load than all the rest
    help="Particles in a fluid (unresolved CFD-DEM), with learned drag closures.",
)


def main() -> None:
    """The command line of this process, with its exit code."""
    process.run(lambda: app(prog_name="jaxdem"))


def _version(wanted: bool) -> None:
    if wanted:
        from jaxdem.version import __version__

        typer.echo(f"jaxdem {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


app.command()(run.check)


@app.command()
def scene(
    key: Annotated[str, typer.Argument(help="A key or a table, such as contact.friction; all without.")] = "",
) -> None:
    """Explain a key of a scene file, or list the keys of a table, or all tables."""
    from jaxdem.scene.reference import explain

    terminal.line(explain(key))


@app.command("import")
def import_command(
    deck: options.DeckFile,
    out: Annotated[Path, options.file_out("Scene file to write (TOML).")],
) -> None:
    """Make a scene of a script of LIGGGHTS or LAMMPS or a CFDEM case, and say line by line what became of it."""
    prepare_file(out, deck)
    from jaxdem.foreign import import_deck

    made = import_deck(deck, out)
    made.write(out)
    terminal.show_import(made.notes)
    terminal.line(f"Wrote {', '.join(str(place) for place in (out, *(out.parent / name for name in made.files)))}")


@app.command()
def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="bed, hopper, chute, stream or settling.")],
    out: Annotated[Path | None, options.file_out("Scene file to write; it must be new. [NAME.toml]")] = None,
) -> None:
    """Write a commented scene to begin with: bed, hopper, chute, stream or settling."""
    from jaxdem.scene.commented import beginning

    text, place = beginning(name), out or Path(f"{name}.toml")
    prepare_folder(place.parent)
    try:
        with place.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise InputError("--out", str(place), "exists already", "Name another file.") from None
    terminal.line(f"Wrote {place}. Next: jaxdem check {place}")


app.command(cls=GroupedHelp)(run.run)


@app.command()
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
    _load_run(run)  # refused before JAX is there
    start_jax()
    from jaxdem.cli import progress
    from jaxdem.train.dataset import make_dataset

    with progress.counted("sample", quiet) as report:
        make_dataset(run, out, factors, progress=report, overrides=changed)
    terminal.line(f"Wrote {out}")


app.command(cls=GroupedHelp)(networks.train)
app.command()(networks.evaluate)
app.command()(networks.distill)
app.command()(networks.prune)
app.command(cls=GroupedHelp)(networks.finetune)


@app.command()
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


@app.command()
def compare(
    reference: options.ReferenceRun,
    runs: options.ComparedRuns,
    out: Annotated[Path, options.folder_out("Folder for report.html, comparison.csv and pictures.")],
) -> None:
    """Compare runs with a reference run: errors of nine metrics, and error against run time."""
    from jaxdem.io.access import locked
    from jaxdem.io.outputs import refuse_run_folder

    refuse_run_folder("--out", out)
    loaded = [_load_run(path) for path in (reference, *runs)]
    prepare_folder(out)
    from jaxdem.report import compare as compare_runs

    with locked(out):
        comparison = compare_runs(loaded[0], loaded[1:], out)
    terminal.print_comparison(comparison)


@app.command()
def plot(
    run: options.RunFolder,
    out: options.PlotOut = None,
    time: options.SnapshotTime = None,
    color: options.Colour = options.Color.velocity,
    forces: options.Forces = False,
) -> None:
    """Draw the metrics of a run over time, and its particles and fluid at one time."""
    place = run / "plots" if out is None else out
    loaded = _load_run(run)
    from jaxdem.report.single import is_file, plot_run

    if is_file(place):
        prepare_file(place, run)
    else:
        prepare_folder(place)
    files = plot_run(loaded, place, time=time, color=color.value, forces=forces)
    for file in files:
        terminal.line(f"Wrote {file}")


@app.command()
def animate(
    run: options.RunFolder,
    out: Annotated[Path, options.file_out(".gif, or .mp4 where ffmpeg is installed.")],
    color: options.Colour = options.Color.velocity,
    fps: options.FrameRate = 10.0,
    quiet: options.Quiet = False,
) -> None:
    """Draw a run as a film: the particles over the speed of the fluid."""
    loaded = _load_run(run)
    prepare_file(out, run)
    from jaxdem.cli import progress
    from jaxdem.report.animation import animate as make_film

    with progress.counted("picture", quiet) as report:
        number = make_film(loaded, out, color=color.value, fps=fps, progress=report)
    text = f"Wrote {out}: {number} of {loaded.number_of_frames} outputs"
    terminal.line(text)


@app.command()
def sweep(
    context: typer.Context,
    scene: options.SceneFile,
    out: Annotated[Path, options.folder_out("Folder for sweep.csv and the runs.")],
    vary: options.Vary,
    settings: options.Settings = None,
    closure: options.ClosureFile = None,
    subgrid: options.SubgridFile = None,
    quiet: options.QuietRun = False,
) -> None:
    """Run a scene with all combinations of the values of some keys. The same command continues a stopped sweep."""
    from jaxdem.io.outputs import refuse_run_folder, refuse_what_is_read
    from jaxdem.run.sweep import TABLE, check_sweep, parse_variation, run_sweep
    from jaxdem.scene import named_files

    variations = [parse_variation(text) for text in vary]
    # What is wrong without variations is said here.
    description = read_scene(scene, settings, closure, subgrid)
    refuse_run_folder("--out", out)
    refuse_what_is_read("--out", out / TABLE, (scene, *named_files(description.model_dump())))
    changed = overrides(settings, closure, subgrid)
    check_sweep(scene, changed, variations, out)
    if not quiet:
        warn_of_units(description)
    start_jax(description.precision)
    from jaxdem.cli import progress
    from jaxdem.run.time_loop import Interrupted

    try:
        with progress.study_display(quiet) as display:
            result = run_sweep(scene, changed, variations, out, display)
    except Interrupted as stop:
        hint = f"Continue with: {this_command(context)}"
        terminal.fail(f"{str(stop).capitalize()} of a run of the sweep. {hint}", 128 + stop.number)
    terminal.print_sweep(result)
    if result.problems:
        names = ", ".join(run.name for run in result.problems)
        code = 2 if all(run.refused for run in result.problems) else 1
        terminal.fail(f"{len(result.problems)} of {len(result.runs)} runs are not valid: {names}", code)


app.command()(study.study)


def _load_run(path: Path) -> Run:
    from jaxdem.io import load_run

    return load_run(path)


if __name__ == "__main__":
    main()
