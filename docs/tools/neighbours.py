"""Figure of docs/results/neighbours.md: R2 of a closure of neighbours and of pairwise least squares, by group.

python docs/tools/neighbours.py CLOSURE [--out docs/pictures/neighbours.png]

The numbers are those that the training has left in the closure file.
"""

from __future__ import annotations

import argparse

import matplotlib
import numpy as np

from jaxdem.closures.file import load_neighbors

AIMS = {"along": 0.88, "across": 0.88, "torque": 0.95}
TITLES = {"along": "force along the stream", "across": "force across the stream", "torque": "torque across the stream"}


def main() -> None:
    """Draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("closure")
    parser.add_argument("--out", default="docs/pictures/neighbours.png")
    options = parser.parse_args()
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    metadata = load_neighbors(options.closure)[1]
    groups = [name for name in metadata["r2"] if name != "all"]
    labels = [f"{metadata['r2'][name]['reynolds']:g}\n{metadata['r2'][name]['solid_fraction']:g}" for name in groups]
    places = np.arange(len(groups))
    figure, axes = plt.subplots(3, 1, figsize=(8.0, 6.5), sharex=True, layout="constrained")
    for panel, (quantity, title) in zip(axes, TITLES.items(), strict=True):
        for shift, (key, label, color) in enumerate(
            (("r2_linear", "pairwise least squares", "0.7"), ("r2", "closure of neighbours", "tab:blue"))
        ):
            values = [metadata[key][name][quantity] for name in groups]
            panel.bar(places + 0.4 * shift - 0.2, values, 0.4, label=label, color=color)
        panel.axhline(AIMS[quantity], color="tab:red", linewidth=1.0, label="aim")
        panel.set(title=title, ylabel="R2 [-]", ylim=(0.6, 1.0))
    figure.legend(*axes[0].get_legend_handles_labels(), ncols=3, loc="outside upper center", fontsize="small")
    axes[-1].set_xticks(places, labels)
    axes[-1].set_xlabel("Reynolds number (above) and solid fraction (below) [-]")
    figure.savefig(options.out, dpi=110)


if __name__ == "__main__":
    main()
