"""Water is injected into a pack of 1,500 grains for one second: `scenes/injection_demo.toml`.

Prints the wall time of each part of the program.

Run: python examples/injection.py [PICTURE]
"""

import matplotlib.pyplot as plt
from pictures import SCENES, draw, new_folder, save

import jaxdem


def picture(run, frames=(0, 4, 10, 20)):
    """Grains and water at four outputs."""
    figure, axes = plt.subplots(4, 1, figsize=(8.0, 7.4), layout="constrained")
    for axis, frame in zip(axes, frames, strict=True):
        grains, water = draw(axis, run, frame, fastest_grain=2.0, fastest_water=4.0)
    figure.colorbar(grains, ax=axes[:2], label="grain speed [m/s]", extend="max")
    figure.colorbar(water, ax=axes[2:], label="water speed [m/s]", extend="max")
    return figure


def main() -> None:
    """Run the scene and draw it."""
    run = jaxdem.simulate(jaxdem.load_scene(SCENES / "injection_demo.toml"), new_folder("injection"))
    save(picture(run), "injection")
    stages = {name: seconds for name, seconds in run.summary["stages_s"].items() if seconds}
    print(", ".join(f"{name} {seconds:.1f} s" for name, seconds in stages.items()))


if __name__ == "__main__":
    main()
