"""A run as a film: GIF without any further program, MP4 with ffmpeg.

Example:
    >>> animate(load_run("runs/settling"), Path("settling.gif"), color="drag")  # doctest: +SKIP
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path

from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter

from jaxdem.errors import InputError
from jaxdem.io import Run
from jaxdem.report import pictures, style
from jaxdem.report.single import Frame, frame_size

MAX_GIF_FRAMES = 300
"""A GIF is put together in memory; of a longer run every second (third, ...) output is drawn."""

DPI = 100

FASTEST = {".gif": 50.0, ".mp4": 240.0}
"""Most pictures a second: a GIF counts in hundredths of a second, and viewers slow down what is under two."""

SLOWEST = 0.01
"""Least: a GIF holds a picture for eleven minutes at most."""


def animate(
    run: Run,
    out: Path,
    *,
    color: str = "velocity",
    fps: float = 10.0,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Draw the outputs of a run one after another: particles over the fluid's speed, one colour scale throughout.

    In 3-D the view is from the front, the fluid's speed averaged over the depth; the title says so.

    Args:
        run: as `jaxdem.load_run` gives it, finished or not.
        out: .gif or .mp4 file.
        color: of the particles, "velocity" or "drag".
        fps: outputs a second.
        progress: called with the number of steps of work done and in all.

    Returns:
        Number of outputs drawn, see `MAX_GIF_FRAMES`.

    Raises:
        InputError: no output yet, a colour or ending that is not known, MP4 without ffmpeg, a rate out of range.
    """
    pictures.require(run, color)
    writer = _writer(out, fps)
    every = math.ceil(run.number_of_frames / MAX_GIF_FRAMES) if out.suffix.lower() == ".gif" else 1
    indices = range(0, run.number_of_frames, every)
    done, total = 0, 2 * len(indices)

    def advance() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, total)

    tops: pictures.Tops = {}
    for index in indices:
        own = pictures.scale_tops([pictures.take(run, index)])
        tops |= {name: max(top, tops.get(name, 0.0)) for name, top in own.items()}
        advance()
    out.parent.mkdir(parents=True, exist_ok=True)
    # The ending tells the writer what to write, so the name aside keeps it.
    part = out.with_name(f".{out.stem}.part{out.suffix}")
    try:
        _film(run, part, writer, indices, tops, color, advance)
        os.replace(part, out)
    except OSError as error:
        error.filename = str(out)
        raise
    finally:
        part.unlink(missing_ok=True)
    return len(indices)


def _film(
    run: Run,
    out: Path,
    writer: AbstractMovieWriter,
    indices: range,
    tops: pictures.Tops,
    color: str,
    advance: Callable[[], None],
) -> None:
    """Draws these outputs into a file."""
    with style.look():
        figure = style.new_figure(*frame_size(run))
        first = pictures.take(run, indices[0])
        frame = Frame(figure, run, tops, color, first)
        frame.draw(first)
        # The layout of the first frame stands still.
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        with writer.saving(figure, str(out), DPI):
            for index in indices:
                frame.draw(pictures.take(run, index))
                writer.grab_frame()
                advance()


def _writer(out: Path, fps: float) -> AbstractMovieWriter:
    ending = out.suffix.lower()
    if ending not in FASTEST:
        raise InputError("--out", str(out), "must end in .gif or .mp4", "Name such a file.")
    if not SLOWEST <= fps <= FASTEST[ending]:
        limit = f"must be {SLOWEST:g} ... {FASTEST[ending]:g} for {ending}"
        raise InputError("--fps", fps, limit, "For example --fps 10.")
    if ending == ".gif":
        return PillowWriter(fps=fps)  # type: ignore[arg-type, unused-ignore]
    if not FFMpegWriter.isAvailable():
        limit = "an .mp4 needs the program ffmpeg, which is not installed"
        raise InputError("--out", str(out), limit, "Install ffmpeg, or name a .gif file, which does not need it.")
    return FFMpegWriter(fps=fps)  # type: ignore[arg-type, unused-ignore]
