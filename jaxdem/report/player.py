"""The animations of the page: all runs side by side at the same time, drawn by the browser from the data itself.

Positions, sizes, particle speeds, drags and the fluid's speed lie in the page as small whole numbers, compressed: a tenth of
what pictures would take, sharp at any size, and nothing has to be drawn while the page is made.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.colors import Colormap, to_hex

from jaxdem.report import pictures
from jaxdem.report import runs as read
from jaxdem.report.comparison import Entry, Row
from jaxdem.report.figures import label
from jaxdem.report.pictures import QUANTITIES, Picture, Scales
from jaxdem.report.runs import Array
from jaxdem.report.style import RunStyle
from jaxdem.report.walls import openings

MAX_BYTES = 16_000_000
"""Most that all animations may add to a page; outputs are left out evenly until they fit."""

MAX_TIMES = 150
"""Most outputs shown: what is read and written here grows with it."""

MAX_CELLS = 800
"""Cells along a side of the fluid's picture; of a finer mesh every second (third, ...) one is shown."""

SCRIPT = Path(__file__).with_name("player.js")
LONG_BOX = 2.0
"""From this ratio of length to height on at most two runs stand in a row."""


class Player(NamedTuple):
    """Fragment of the page, and what one must know of it; None where there is nothing to show."""

    html: str
    caption: str


class _Scene(NamedTuple):
    """What is the same in all frames of a run."""

    box: tuple[float, float]
    largest_radius: float


def player(
    entries: Sequence[Entry],
    rows: Mapping[str, Row],
    styles: Mapping[str, RunStyle],
    max_bytes: int = MAX_BYTES,
) -> Player | None:
    """The animations of all runs at the reference's output times, one colour scale for all.

    Args:
        entries: the reference first.
        rows: by name.
        styles: by name.
        max_bytes: see `MAX_BYTES`.

    Returns:
        None where the reference has fewer than two outputs, or where two would not fit.
    """
    outputs = entries[0].history["time"]
    shown = [entry for entry in entries if read.domain_size(entry.run)]
    times = _thinned(outputs, MAX_TIMES)
    if len(times) < 2 or not shown:
        return None
    scales = _scales(shown, times)
    size = sum(len(_encoded(entry, times[-1], times, scales) or b"") for entry in shown) * 4 / 3
    while True:
        times = _thinned(times, int(max_bytes / max(size, 1.0)))
        if len(times) < 2:
            return None
        data = [[_encoded(entry, time, times, scales) for time in times] for entry in shown]
        total = sum(len(frame or b"") for frames in data for frame in frames) * 4 / 3
        if total <= max_bytes:
            break
        size = total / len(times)
    if not any(frame for frames in data for frame in frames):
        return None
    return Player(_html(shown, rows, styles, times, data, scales), _caption(shown, outputs, times))


def _thinned(times: Array, most: int) -> Array:
    """At most `most` of the times, evenly, the first among them."""
    return times[:: math.ceil(len(times) / most)] if most > 0 else times[:0]


def _picture(entry: Entry, time: float, times: Array) -> Picture | None:
    index = pictures.nearest(entry.run, float(time), float(times[-1]))
    return None if index is None else pictures.take(entry.run, index)


def _scales(entries: Sequence[Entry], times: Array) -> dict[str, float]:
    """Top of the scale of the fluid's speed, and of each quantity of the particles, by the reference where it has one.

    From a few outputs: what is above has the last colour.
    """
    tops: dict[str, float] = {}
    for entry in entries:
        some = [shot for time in _thinned(times, 8) if (shot := _picture(entry, time, times)) is not None]
        for quantity in QUANTITIES:
            scales = Scales.of(some, quantity)
            for name, scale in (("fluid", scales.water), (quantity, scales.grains)):
                if scale is not None and scale.vmax:
                    tops.setdefault(name, float(scale.vmax))
    return tops


def _scene(entry: Entry) -> _Scene:
    size = read.domain_size(entry.run)
    assert size is not None
    particles = (entry.run.particles(0) if entry.run.number_of_frames else None) or {}
    radius = np.asarray(particles.get("radius", 0.0), dtype=np.float64)
    return _Scene((size[0], size[-1]), float(radius.max(initial=0.0)))


def _encoded(entry: Entry, time: float, times: Array, scales: Mapping[str, float]) -> bytes | None:
    """One frame as the script reads it: counts, then bytes by plane, deflated.

    Little endian: uint32 number of particles N, of cells along x and up; then N bytes each of x low, x high, height
    low, height high (65535 is the box's side), radius (255 is the largest), then of each quantity N bytes, then the
    cells' speed, x fastest; 255 is the top of a scale.
    """
    shot = _picture(entry, time, times)
    if shot is None:
        return None
    scene = _scene(entry)
    count = 0 if shot.centres is None else len(shot.centres)
    planes: list[Any] = []
    if shot.centres is not None and shot.radius is not None:
        places = np.clip(np.rint(shot.centres / scene.box * 65535), 0, 65535).astype("<u2")
        planes += [places[:, 0] & 255, places[:, 0] >> 8, places[:, 1] & 255, places[:, 1] >> 8]
        planes.append(_bytes(shot.radius, scene.largest_radius))
        planes += [_bytes(shot.values.get(name, np.zeros(count)), scales.get(name, 1.0)) for name in QUANTITIES]
    cells = (0, 0)
    if shot.speed is not None:
        every = max(1, math.ceil(max(shot.speed.shape) / MAX_CELLS))
        speed = shot.speed[::every, ::every]
        cells = speed.shape
        planes.append(_bytes(speed.T.ravel(), scales.get("fluid", 1.0)))
    head = np.array([count, *cells], "<u4").tobytes()
    return zlib.compress(head + b"".join(np.asarray(plane, np.uint8).tobytes() for plane in planes), 6)


def _bytes(values: Array, top: float) -> np.ndarray:
    """Values from zero to `top` as 0 to 255; what is not finite as the top."""
    return np.clip(np.rint(np.nan_to_num(values, nan=top, posinf=top) / (top or 1.0) * 255), 0, 255)


def _colours(colours: Colormap) -> list[str]:
    return [to_hex(colours(level)) for level in range(256)]


def _walls(shot: Picture) -> dict[str, Any] | None:
    """The walls, which stand still: numbers of points along x and up, and how solid each is, x fastest, 255 all."""
    if shot.walls is None:
        return None
    share = shot.walls.share
    packed = zlib.compress(_bytes(share.T.ravel(), 1.0).astype(np.uint8).tobytes(), 6)
    return {"points": share.shape, "share": base64.b64encode(packed).decode("ascii")}


def _openings(shot: Picture) -> list[dict[str, Any]]:
    return [{"color": pictures.OPENINGS[one.kind], "corners": [*one.start, *one.stop]} for one in shot.openings]


def _html(
    entries: Sequence[Entry],
    rows: Mapping[str, Row],
    styles: Mapping[str, RunStyle],
    times: Array,
    data: Sequence[Sequence[bytes | None]],
    scales: Mapping[str, float],
) -> str:
    scenes = [_scene(entry) for entry in entries]
    first = [pictures.take(entry.run, 0) if entry.run.number_of_frames else None for entry in entries]
    long = max(scene.box[0] / scene.box[1] for scene in scenes) >= LONG_BOX
    has_fluid = "fluid" in scales
    quantities = [name for name in QUANTITIES if name in scales and (name != "drag" or has_fluid)]
    settings = {
        "times": [float(f"{time:.6g}") for time in times],
        "tops": dict(scales),
        "planes": list(QUANTITIES),
        "water": _colours(pictures.WATER),
        "grains": _colours(pictures.GRAINS),
        "wall": to_hex(pictures.WALL(255), keep_alpha=True),
        "runs": [
            {
                "box": scene.box,
                "radius": scene.largest_radius,
                "walls": shot and _walls(shot),
                "openings": _openings(shot) if shot else [],
                "frames": [None if f is None else base64.b64encode(f).decode("ascii") for f in frames],
            }
            for scene, frames, shot in zip(scenes, data, first, strict=True)
        ],
    }
    panels = "".join(
        f'<figure><figcaption><span class="swatch" style="background:{styles[entry.name].color}"></span>'
        f"{escape(label(rows[entry.name]))}<small></small></figcaption>"
        f'<canvas role="img" aria-label="Particles and fluid of {escape(entry.name)}"></canvas></figure>'
        for entry in entries
    )
    options = "".join(
        f'<option value="{name}">{QUANTITIES[name].label} [{QUANTITIES[name].unit}]</option>' for name in quantities
    )
    choice = f'<label>particles by <select name="color">{options}</select></label>' if quantities else ""
    bars = "".join(
        f'<span class="scale" data-scale="{name}"></span>' for name in ("fluid", "grains")
        if (has_fluid if name == "fluid" else quantities)
    )  # fmt: skip
    # `<` cannot stand in a script: nothing in the data may end it.
    text = json.dumps(settings).replace("<", "\\u003c")
    return (
        f'<div id="player"><div class="controls"><button type="button">Play</button>'
        f'<input type="range" min="0" max="{len(times) - 1}" value="0" aria-label="output">'
        f"<output></output>{choice}</div>"
        f'<div class="panels{" long" if long else ""}">{panels}</div><div class="controls">{bars}</div></div>'
        f'<script type="application/json" id="player-data">{text}</script>'
        f"<script>{SCRIPT.read_text(encoding='utf-8')}</script>"
    )


def _caption(entries: Sequence[Entry], outputs: Array, times: Array) -> str:
    parts = ["Discs have their true radius, but are at least one pixel wide. All runs have the same colour scale."]
    if any(entry.run.dimension == 3 for entry in entries):
        parts.append(
            "3-D runs are seen from the front. The speed of the fluid and the walls are averaged over the depth."
        )
    if any(openings(entry.run.scene, read.domain_size(entry.run) or ()) for entry in entries):
        parts.append("Green lines are inlets, pink lines are outlets.")
    if len(times) < len(outputs):
        parts.append(f"To keep the page small, {len(times)} of {len(outputs)} outputs are shown.")
    return " ".join(parts)
