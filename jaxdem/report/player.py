"""The animations of the page: all runs side by side at the same time, drawn by the browser from the data itself.

Positions, sizes, particle speeds, drags and the fluid's speed lie in the page as small whole numbers, compressed: a
tenth of what pictures would take, sharp at any size, and nothing has to be drawn while the page is made.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.colors import to_hex

from jaxdem.report import pictures
from jaxdem.report import runs as read
from jaxdem.report.comparison import Row
from jaxdem.report.pictures import FLUID, QUANTITIES, Picture, Tops
from jaxdem.report.runs import Array
from jaxdem.report.walls import Solid

MAX_BYTES = 16_000_000
"""Most that all animations may add to a page; outputs are left out evenly until they fit."""

MAX_TIMES = 150
"""Most outputs shown: what is read and written here grows with it."""

MAX_CELLS = 800
"""Cells along a side of the fluid's picture; of a finer mesh every second (third, ...) one is shown."""

SCRIPT = Path(__file__).with_name("player.js")


class _Clip(NamedTuple):
    """A run in the page: sides of the box and largest radius [m], first picture, frames at the common times, and the
    walls in each of them."""

    row: Row
    box: tuple[float, float]
    radius: float
    first: Picture | None
    frames: list[str | None]
    walls: list[Solid | None]


def player(rows: Sequence[Row], max_bytes: int = MAX_BYTES) -> str | None:
    """The animations of all runs at the output times of the first, which is the reference; one colour scale for all.

    Returns:
        A fragment of the page, with its caption; None where the reference has fewer than two outputs, or where two
        would not fit into `max_bytes`.
    """
    outputs = rows[0].history["time"]
    rows = [row for row in rows if read.domain_size(row.run)]
    times = _thinned(outputs, MAX_TIMES)
    if len(times) < 2 or not rows:
        return None
    # Of a few outputs: what is above has the last colour.
    tops = pictures.common_tops(
        [[pictures.take_nearest(row.run, time, times[-1]) for time in _thinned(times, 8)] for row in rows]
    )
    one = sum(len(_clip(row, times[-1:], tops).frames[0] or "") for row in rows)
    times = _thinned(times, max_bytes // max(one, 1))
    clips = [_clip(row, times, tops) for row in rows]
    sizes = np.sum([[len(frame or "") for frame in clip.frames] for clip in clips], axis=0)
    every = next((n for n in range(1, len(times)) if sizes[::n].sum() <= max_bytes), None)
    if every is None or not sizes.any():
        return None
    clips = [clip._replace(frames=clip.frames[::every], walls=clip.walls[::every]) for clip in clips]
    shown = times[::every]
    return _html(clips, shown, tops) + f'<p class="caption">{_caption(clips, len(shown), len(outputs))}</p>'


def _thinned(times: Array, most: int) -> Array:
    """At most `most` of the times, evenly, the first among them."""
    return times[:: math.ceil(len(times) / most)] if most > 0 else times[:0]


def _clip(row: Row, times: Array, tops: Tops) -> _Clip:
    size, begun = read.domain_size(row.run) or (), row.run.number_of_frames > 0
    box, particles = (size[0], size[-1]), (row.run.particles(0) if begun else None) or {}
    radius = float(np.max(particles.get("radius", 0.0), initial=0.0))
    frames: list[str | None] = []
    walls: list[Solid | None] = []
    for time in times:
        shot = pictures.take_nearest(row.run, float(time), float(times[-1]))
        frames.append(None if shot is None else _packed(_planes(shot, box, radius, tops)))
        walls.append(None if shot is None else shot.walls)
    return _Clip(row, box, radius, pictures.take(row.run, 0) if begun else None, frames, walls)


def _planes(shot: Picture, box: tuple[float, float], radius: float, tops: Tops) -> bytes:
    """One frame as the script reads it: counts, then bytes by plane.

    Little endian: uint32 number of particles N, of cells along x and up; then N bytes each of x low, x high, height
    low, height high (65535 is the box's side), radius (255 is the largest), then of each quantity N bytes, then the
    cells' speed, x fastest; 255 is the top of a scale.
    """
    count, cells = len(shot.centres), (0, 0)
    places = np.clip(np.rint(shot.centres / box * 65535), 0, 65535).astype(np.uint16)
    planes = [part.astype(np.uint8) for column in places.T for part in (column & 255, column >> 8)]
    planes.append(_bytes(shot.radius, radius))
    planes += [_bytes(shot.values.get(name, np.zeros(count)), tops.get(name, 1.0)) for name in QUANTITIES]
    speed = shot.shown_speed(tops.get("fluid", 1.0))
    if speed is not None:
        every = max(1, math.ceil(max(speed.shape) / MAX_CELLS))
        cells = speed[::every, ::every].shape
        planes.append(_bytes(speed[::every, ::every].T.ravel(), tops.get("fluid", 1.0)))
    return b"".join([np.array([count, *cells], "<u4").tobytes(), *(plane.tobytes() for plane in planes)])


def _bytes(values: Array, top: float) -> np.ndarray:
    """Values from zero to `top` as 0 to 255; what is not finite as the top."""
    levels = np.rint(np.nan_to_num(values, nan=top, posinf=top) / (top or 1.0) * 255)
    return np.clip(levels, 0, 255).astype(np.uint8)


def _packed(data: bytes) -> str:
    """Deflated, as text."""
    return base64.b64encode(zlib.compress(data, 6)).decode("ascii")


def _lines(lines: Sequence[Array], box: tuple[float, float]) -> bytes:
    """Lines of walls as the script reads them, little endian: uint32 number of lines, that of the points of each, then
    uint16 x and height of every point (65535 is the box's side)."""
    counts = np.array([len(lines), *map(len, lines)], "<u4")
    points = np.concatenate([np.zeros((0, 2)), *lines])
    return counts.tobytes() + np.clip(np.rint(points / box * 65535), 0, 65535).astype("<u2").tobytes()


def _data(clip: _Clip) -> dict[str, object]:
    """Of a run: its frames, and its walls: points along x and up, how solid each is, and the lines of their surfaces,
    over the grains where they are those of a section.

    Walls that come or vanish make another set of walls; each frame has the number of its set, -1 for none.
    """
    sets = {id(walls): walls for walls in clip.walls if walls is not None}
    numbers = {one: number for number, one in enumerate(sets)}
    openings = clip.first.openings if clip.first else ()
    return {
        "box": clip.box,
        "radius": clip.radius,
        "walls": [
            {
                "points": walls.share.shape,
                "share": _packed(_bytes(walls.shown_share.T.ravel(), 1.0).tobytes()),
                "lines": _packed(_lines(walls.outlines(clip.box), clip.box)),
                "over": walls.is_section,
                "openings": [
                    {"color": pictures.OPENINGS[kind], "lines": _packed(_lines([line], clip.box))}
                    for kind, line in walls.openings
                ],
            }
            for walls in sets.values()
        ],
        "wall": [-1 if walls is None else numbers[id(walls)] for walls in clip.walls],
        "openings": [{"color": pictures.OPENINGS[o.kind], "corners": [*o.start, *o.stop]} for o in openings],
        "frames": clip.frames,
    }  # fmt: skip


def _html(clips: Sequence[_Clip], times: Array, tops: Tops) -> str:
    scales = {"fluid": FLUID} | QUANTITIES
    settings = {
        "times": [float(f"{time:.6g}") for time in times],
        "tops": tops,
        "planes": list(QUANTITIES),
        "water": [to_hex(pictures.WATER(level)) for level in range(256)],
        "grains": [to_hex(pictures.GRAINS(level)) for level in range(256)],
        "wall": to_hex(pictures.WALL(255), keep_alpha=True),
        "edge": pictures.WALL_EDGE,
        "runs": [_data(clip) for clip in clips],
    }
    quantities = [name for name in QUANTITIES if name in tops and (name != "drag" or "fluid" in tops)]
    panels = "".join(
        f'<figure><figcaption><span class="swatch" style="background:{clip.row.look.color}"></span>'
        f"{escape(clip.row.label)}<small></small></figcaption>"
        f'<canvas role="img" aria-label="Particles and fluid of {escape(clip.row.name)}"></canvas></figure>'
        for clip in clips
    )
    options = "".join(f'<option value="{name}">{scales[name].label}</option>' for name in quantities)
    choice = f'<label>particles by <select name="color">{options}</select></label>' if quantities else ""
    bars = "".join(
        f'<span class="scale" data-scale="{name}"></span>'
        for name in ["fluid"] * ("fluid" in tops) + ["grains"] * bool(quantities)
    )
    long = " long" if max(clip.box[0] / clip.box[1] for clip in clips) >= pictures.LONG_BOX else ""
    # `<` cannot stand in a script: nothing in the data may end it.
    text = json.dumps(settings).replace("<", "\\u003c")
    return (
        '<div id="player"><div class="controls"><button type="button">Play</button>'
        f'<input type="range" min="0" max="{len(times) - 1}" value="0" aria-label="output"><output></output>{choice}'
        f'</div><div class="panels{long}">{panels}</div><div class="controls">{bars}</div></div>'
        f'<script type="application/json" id="player-data">{text}</script>'
        f"<script>{SCRIPT.read_text(encoding='utf-8')}</script>"
    )


def _caption(clips: Sequence[_Clip], shown: int, outputs: int) -> str:
    parts = ["Discs have their true radius, but are at least one pixel wide. All runs have the same colour scale."]
    boxes = {clip.box for clip in clips}
    if len(boxes) == 1:
        parts.append("The box is {:.4g} m long and {:.4g} m high.".format(*boxes.pop()))
    if any(clip.row.run.dimension == 3 for clip in clips):
        parts.append(
            "3-D runs are seen from the front. The speed of the fluid is averaged over the depth; a wall is the darker "
            "the more of the depth it takes."
        )
    if any(walls.is_section for clip in clips for walls in clip.walls if walls is not None):
        parts.append("Lines over the grains are the section of the walls at half depth.")
    if any(clip.first and clip.first.liquid is not None for clip in clips):
        parts.append("Of two fluids the liquid is shown, pale where it is at rest.")
    if any(clip.first and clip.first.kinds_of_openings for clip in clips):
        parts.append("Green lines are inlets, pink lines are outlets.")
    if shown < outputs:
        parts.append(f"To keep the page small, {shown} of {outputs} outputs are shown.")
    return " ".join(parts)
