"""Training a drag closure: a fine run, its dataset, a fit, and a coarse run with and without the closure.

The same steps as `jaxdem dataset`, `jaxdem train` and `jaxdem run --closure`, from Python, with 600 grains.

Run: python examples/train_closure.py [PICTURE]
"""

import matplotlib.pyplot as plt
import numpy as np
from pictures import SCENES, new_folder, save

import jaxdem
from jaxdem.closures import save_closure
from jaxdem.train.dataset import make_dataset
from jaxdem.train.dataset_file import read_dataset
from jaxdem.train.fit import FitSettings, fit_filtered

FINE = {
    "domain.size": [2.4, 0.8],
    "fluid.cells": [60, 20],
    "particles.count": 600,
    "particles.pack.vertices": [[0.2, 0.0], [1.0, 0.0], [0.8, 0.5], [0.2, 0.5]],
    "time.end": 0.6,
    "output.samples": 0.02,
}
FACTOR = 2


def main() -> None:
    """Make the fine run, train, make the coarse runs, and draw how good the closure is."""
    folder, scene = new_folder("train_closure"), SCENES / "injection_demo.toml"
    fine = jaxdem.simulate(jaxdem.load_scene(scene, FINE), folder / "fine")
    make_dataset(fine.path, folder / "dataset.h5", coarsen=(1, FACTOR))
    fit = fit_filtered([read_dataset(folder / "dataset.h5")], FitSettings.filtered(epochs=40, samples=20_000))
    save_closure(folder / "filtered.closure.h5", fit.closure, fit.metadata)

    coarse = FINE | {"fluid.cells": [n // FACTOR for n in FINE["fluid.cells"]], "output.samples": 0.0}
    plain = jaxdem.simulate(jaxdem.load_scene(scene, coarse), folder / "coarse")
    learned = jaxdem.simulate(jaxdem.load_scene(scene, coarse), folder / "coarse_filtered", closure=fit.closure)
    held_out = {name: np.ravel(array) for name, array in fit.parity[FACTOR].items()}
    histories = {
        name: (run.times, run.history["drag_force_mean"])
        for name, run in (("fine", fine), (f"{FACTOR}x coarser", plain), ("with the closure", learned))
    }
    save(picture(held_out, fit.metadata["r2"][str(FACTOR)], histories), "train_closure")
    for factor, figures in fit.metadata["r2"].items():
        print(
            f"held-out rows, cells {factor}x as large: R2 of closure {figures['closure']:.3f}, "
            f"of base law {figures['base']:.3f}"
        )


def picture(held_out: dict, r2: dict, histories: dict):
    """Forces by the base law and by the closure against those needed, and the mean drag of three runs over time."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 4.2), layout="constrained")
    target = held_out["target"]
    for name, label, color in (("base", "Koch-Hill", "#56B4E9"), ("predicted", "closure", "#D55E00")):
        score = r2["closure" if name == "predicted" else name]
        left.plot(target, held_out[name], ".", ms=2, color=color, label=f"{label}, R² = {score:.3f}")
    ends = np.quantile(target, (0.001, 0.999))
    left.plot(ends, ends, "k-", lw=0.8)
    left.set(xlabel="force that a coarse run needs [N]", ylabel="force given [N]", xlim=ends, ylim=ends)
    left.locator_params(nbins=6)
    left.legend(markerscale=5)
    looks = (("k", "-"), ("#56B4E9", "--"), ("#D55E00", "-."))
    for (label, (times, drag)), (color, dashes) in zip(histories.items(), looks, strict=True):
        right.plot(times, drag, color=color, ls=dashes, lw=1.4, label=label)
    right.set(xlabel="time [s]", ylabel="mean drag force [N]", ylim=0)
    right.legend()
    return figure


if __name__ == "__main__":
    main()
