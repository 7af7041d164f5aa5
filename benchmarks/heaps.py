"""What the benchmarks of heaps share: the slope of one, and the figure of slopes and heaps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np


def slope(position: np.ndarray) -> float:
    """Slope of the wedge against the wall that has the same centre of mass [degrees].

    A wedge of height H and length L has it at H/3 and L/3. A line through the surface says less: cohesive heaps break
    into blocks, whose tops have no slope.
    """
    x, z = position.mean(axis=0)
    return math.degrees(math.atan2(z, x))


def heaps_figure(
    found: dict[float, list[float]],
    heaps: dict[float, tuple[np.ndarray, np.ndarray]],
    size: tuple[float, float],
    name: str,
    edge: str = "none",
) -> tuple[Any, Any]:
    """Slopes with their means over a parameter, and some heaps.

    Args:
        found: slopes by the parameter [degrees].
        heaps: centres and radii of discs by the parameter [m].
        size: of what is shown of a heap [mm].
        name: of the parameter, above a heap.
        edge: colour of the edge of discs.

    Returns:
        the figure and its axes; the first, of the slopes, lacks the label of the parameter.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.collections import EllipseCollection

    figure, axes = plt.subplots(1, 1 + len(heaps), figsize=(13, 3.4), width_ratios=[1.3] + [1.0] * len(heaps))
    for value, angles in found.items():
        axes[0].plot([value] * len(angles), angles, "o", color="tab:blue", markersize=4, alpha=0.6)
    axes[0].plot(list(found), [float(np.mean(angles)) for angles in found.values()], "-", color="tab:blue")
    axes[0].set_ylabel("slope [degrees]")
    axes[0].set_ylim(0.0, 45.0)
    axes[0].grid(alpha=0.3)
    for axis, (value, (position, radius)) in zip(axes[1:], heaps.items(), strict=True):
        width = 2e3 * radius
        axis.add_collection(
            EllipseCollection(width, width, np.zeros(len(width)), units="x", offsets=1e3 * position,
                              offset_transform=axis.transData, facecolor="tab:orange", edgecolor=edge, linewidth=0.2)
        )  # fmt: skip
        axis.set_xlim(0.0, size[0])
        axis.set_ylim(0.0, size[1])
        axis.set_aspect("equal")
        axis.set_title(f"{name} {value:g}", fontsize=10)
        axis.set_xlabel("x [mm]")
    axes[1].set_ylabel("z [mm]")
    return figure, axes
