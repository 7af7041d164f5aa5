"""The commands that compare and draw runs: compare, plot, animate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from jaxdem.cli import options, terminal
from jaxdem.cli.inputs import load_run, prepare_file, prepare_folder


def compare(
    reference: options.ReferenceRun,
    runs: options.ComparedRuns,
    out: Annotated[Path, options.folder_out("Folder for report.html, comparison.csv and pictures.")],
) -> None:
    """Compare runs with a reference run: errors of nine metrics, and error against run time."""
    from jaxdem.io.access import locked
    from jaxdem.io.outputs import refuse_run_folder

    refuse_run_folder("--out", out)
    loaded = [load_run(path) for path in (reference, *runs)]
    prepare_folder(out)
    from jaxdem.report import compare as compare_runs

    with locked(out):
        comparison = compare_runs(loaded[0], loaded[1:], out)
    terminal.print_comparison(comparison)


def plot(
    run: options.RunFolder,
    out: options.PlotOut = None,
    time: options.SnapshotTime = None,
    color: options.Colour = options.Color.velocity,
    forces: options.Forces = False,
) -> None:
    """Draw the metrics of a run over time, and its particles and fluid at one time."""
    place = run / "plots" if out is None else out
    loaded = load_run(run)
    from jaxdem.report.single import is_file, plot_run

    if is_file(place):
        prepare_file(place, run)
    else:
        prepare_folder(place)
    files = plot_run(loaded, place, time=time, color=color.value, forces=forces)
    for file in files:
        terminal.line(f"Wrote {file}")


def animate(
    run: options.RunFolder,
    out: Annotated[Path, options.file_out(".gif, or .mp4 where ffmpeg is installed.")],
    color: options.Colour = options.Color.velocity,
    fps: options.FrameRate = 10.0,
    quiet: options.Quiet = False,
) -> None:
    """Draw a run as a film: the particles over the speed of the fluid."""
    loaded = load_run(run)
    prepare_file(out, run)
    from jaxdem.cli import progress
    from jaxdem.report.animation import animate as make_film

    with progress.counted("picture", quiet) as report:
        number = make_film(loaded, out, color=color.value, fps=fps, progress=report)
    text = f"Wrote {out}: {number} of {loaded.number_of_frames} outputs"
    terminal.line(text)
