"""Parity of a closure: the forces of its base law and its own against the target."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import LogNorm

from jaxdem.errors import InputError
from jaxdem.report import style
from jaxdem.report.runs import Array

Forces = Mapping[str, Array]
"""`target`, `predicted` and, where it is known, `base`, each (M, D) [N]."""

WORDS = {"base": "base law", "predicted": "closure"}


def r_squared(target: Array, estimate: Array) -> float:
    """R2 = 1 - sum |t - e|^2 / sum |t - mean t|^2 over all components together, the mean by component; (M, D) each."""
    spread = float(np.sum((target - target.mean(axis=0)) ** 2))
    return 1.0 - float(np.sum((target - estimate) ** 2)) / spread if spread > 0 else float("nan")


def check_parity(parity: Mapping[str, Forces]) -> None:
    """Refuse arrays of unlike, empty or other than (M, D) shape, and entries without a target or a prediction.

    Raises:
        InputError: naming the entry and the array.
    """
    for name, forces in parity.items():
        wanted = np.shape(forces.get("target", ()))
        for column in ("target", "predicted", *(["base"] if "base" in forces else [])):
            shape = np.shape(forces.get(column, ()))
            if shape != wanted or len(shape) != 2 or 0 in shape:
                limit = f"(M, D) like the target, {wanted}"
                raise InputError(f"parity[{name!r}].{column}", shape, limit, "Give arrays of one shape.")


def parity_figure(parity: Mapping[str, Forces], path: Path) -> Path:
    """parity.png: force by the base law and by the closure against the target, one row for each entry."""
    with style.look():
        figure = style.new_figure(9.6, 4.6 * len(parity))
        rows = figure.subfigures(len(parity), 1, squeeze=False)[:, 0]
        for row, (name, forces) in zip(rows, parity.items(), strict=True):
            row.suptitle(style.escaped(name, 9.0, 12.0), fontsize=12)
            columns = [column for column in WORDS if column in forces]
            axes = row.subplots(1, 2, squeeze=False)[0]
            for axis in axes[len(columns) :]:
                axis.set_axis_off()
            panels = zip(axes, columns, strict=False)
            images = [image for axis, column in panels if (image := _panel(axis, column, forces))]
            if images:
                # One scale for both panels, so that their shades can be compared.
                most = max(2.0, *(float(np.max(np.asarray(image.get_array()))) for image in images))
                for image in images:
                    image.set_norm(LogNorm(1.0, most))
                row.colorbar(images[0], ax=list(axes), label="values in a cell", shrink=0.8)
        return style.save(figure, path)


def _panel(axis: Axes, column: str, forces: Forces) -> PolyCollection | None:
    """Estimates against targets; of many the density, which is returned to be given its scale."""
    target, estimate = (np.asarray(forces[name], dtype=np.float64) for name in ("target", column))
    low, high = np.percentile(target, [0.1, 99.9])
    margin = 0.1 * ((high - low) or 1.0)
    span = (low - margin, high + margin)
    outside = np.mean(np.maximum(abs(estimate - 0.5 * sum(span)), abs(target - 0.5 * sum(span))) > 0.5 * np.ptp(span))
    pairs, image = (target.ravel(), estimate.ravel()), None
    if target.size > 3000:
        image = axis.hexbin(*pairs, gridsize=60, extent=(*span, *span), mincnt=1, cmap="viridis_r", linewidths=0.1)
    else:
        axis.plot(*pairs, "o", markersize=3, alpha=0.5, color=style.COLOURS[0], markeredgewidth=0)
    axis.plot(span, span, color="#333333", linewidth=1.0)
    word = WORDS[column]
    axis.set(xlim=span, ylim=span, aspect="equal", xlabel="target force [N]", ylabel=f"{word}'s force [N]")
    axis.locator_params(nbins=6)
    axis.ticklabel_format(scilimits=(-3, 4), useMathText=True)
    note = f", {100 * outside:.1f} % outside the panel" if outside > 0.005 else ""
    axis.set_title(f"{word}: R² = {r_squared(target, estimate):.3f}{note}")
    return image
