"""A picture of a frame drawn by matplotlib, for pictures and films; the browser draws the page's (`player`)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patheffects import Normal, Stroke

from jaxdem.report import force_lines
from jaxdem.report.force_lines import draw_force_lines
from jaxdem.report.pictures import FLUID, GRAINS, OPENINGS, QUANTITIES, WALL, WALL_EDGE, WATER, Picture, Tops
from jaxdem.report.walls import Opening, Solid

SURFACE = "#08306B"
"""Line of the surface between two fluids."""


def _scale(tops: Tops, name: str) -> Normalize:
    return Normalize(0.0, tops.get(name) or 1.0)


def draw(
    axis: Axes, picture: Picture | None, box: tuple[float, float], size: tuple[float, float], tops: Tops, color: str
) -> None:
    """Draw a picture in place of an earlier one.

    Args:
        picture: None leaves an empty panel.
        box: length and height of the run's own box [m].
        size: of what the panel shows [m].
        tops: of the colour scales.
        color: of the particles, a key of `QUANTITIES`.
    """
    for artist in (*axis.images, *axis.collections):
        artist.remove()
    axis.set(xlim=(0.0, size[0]), ylim=(0.0, size[1]), aspect="equal")
    axis.grid(False)
    for spine in axis.spines.values():
        spine.set_visible(True)
        spine.set_color("#888888")
    if picture is None:
        axis.set_facecolor("#F4F4F4")
        return
    extent = (0.0, box[0], 0.0, box[1])
    speed = picture.shown_speed(_scale(tops, "fluid").vmax or 1.0)
    if speed is not None:
        axis.imshow(
            speed.T, origin="lower", extent=extent, cmap=WATER, norm=_scale(tops, "fluid"),
            interpolation="nearest", aspect="equal",
        )  # fmt: skip
    if picture.liquid is not None and picture.liquid.min() < 0.5 < picture.liquid.max():
        x, z = ((np.arange(n) + 0.5) * side / n for n, side in zip(picture.liquid.shape, box, strict=True))
        axis.contour(x, z, picture.liquid.T, levels=[0.5], colors=SURFACE, linewidths=1.0, zorder=0.4)
    if picture.walls is not None:
        _draw_walls(axis, picture.walls, box)
    of_walls = () if picture.walls is None else picture.walls.openings
    outlines = [np.asarray(_outline(opening)) for opening in picture.openings] + [line for _, line in of_walls]
    colours = [OPENINGS[kind] for kind in picture.kinds_of_openings]
    axis.add_collection(LineCollection(outlines, colors=colours, linewidths=3.0, clip_on=False, zorder=2.6))
    discs = EllipseCollection(
        2.0 * picture.radius, 2.0 * picture.radius, np.zeros_like(picture.radius), units="xy", offsets=picture.centres,
        offset_transform=axis.transData, linewidths=0.0, cmap=GRAINS, norm=_scale(tops, color),
    )  # fmt: skip
    discs.set_array(picture.values.get(color, np.zeros_like(picture.radius)))
    axis.add_collection(discs, autolim=False)
    if picture.forces is not None:
        draw_force_lines(axis, picture.forces)


def _draw_walls(axis: Axes, walls: Solid, box: tuple[float, float]) -> None:
    """What is solid in grey, and the surface as a line; that of a section on top of the grains that are before it."""
    extent = (0.0, box[0], 0.0, box[1])
    axis.imshow(
        walls.shown_share.T, origin="lower", extent=extent, cmap=WALL, norm=Normalize(0.0, 1.0), aspect="equal",
        zorder=0.5,
    )  # fmt: skip
    if walls.distance.min() < 0.0 < walls.distance.max():
        x, z = ((np.arange(n) + 0.5) * side / n for n, side in zip(walls.distance.shape, box, strict=True))
        order = 2.2 if walls.is_section else 0.9
        line = axis.contour(x, z, walls.distance.T, levels=[0.0], colors=WALL_EDGE, linewidths=1.2, zorder=order)
        if walls.is_section:
            line.set_path_effects([Stroke(linewidth=2.6, foreground="white"), Normal()])


def _outline(opening: Opening) -> list[tuple[float, float]]:
    """Of the rectangle between two corners; a line where they share a coordinate."""
    (x, z), (right, top) = opening.start, opening.stop
    return [(x, z), (right, z), (right, top), (x, top), (x, z)]


def add_legends(
    figure: Figure | SubFigure, axes: Sequence[Axes], shown: Sequence[Picture], tops: Tops, color: str, inches: float
) -> None:
    """Bars of the colour scales below panels that take this width, and what the coloured edges are."""
    for name, quantity in (("fluid", FLUID), (color, QUANTITIES[color])):
        if name in tops:
            tall = figure.bbox.height / figure.dpi
            bar = figure.colorbar(
                ScalarMappable(_scale(tops, name), quantity.colors), ax=axes, label=quantity.label, location="bottom",
                extend="max", fraction=0.3 / tall, pad=0.1 / tall, shrink=min(1.0, 7.0 / inches),
                aspect=min(inches, 7.0) / 0.14,
            )  # fmt: skip
            bar.ax.ticklabel_format(axis="x", scilimits=(-3, 4), useMathText=True)
            bar.ax.locator_params(axis="x", nbins=max(3, int(1.5 * min(inches, 7.0))))
    kinds = {kind for picture in shown for kind in picture.kinds_of_openings}
    handles = [Line2D([], [], color=OPENINGS[kind], linewidth=3.0, label=kind) for kind in OPENINGS if kind in kinds]
    for picture in shown:
        if picture.forces is not None:
            label = f"normal force in a contact, up to {picture.forces.largest:.3g} N"
            handles.append(Line2D([], [], color=force_lines.COLOR, linewidth=force_lines.WIDEST, label=label))
    if handles:
        figure.legend(handles=handles, loc="outside lower right", ncols=2)
