"""What a scene may ask for and what seldom does what was meant: sentences for `jaxdem check`. Host side."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from jaxdem.check.engineering import ScreenLoad
from jaxdem.check.run_cost import RunCost
from jaxdem.fluid.interval import SUBSTEPS
from jaxdem.scene import Scene
from jaxdem.scene.drive import is_driven
from jaxdem.scene.particles import radius_key
from jaxdem.setup.bodies import Bodies
from jaxdem.setup.boundaries import boundary_speed

UNEQUAL = 1.2
"""Largest over smallest diameter from which grains are of several sizes to a drag law [-]."""

DEAR = 3.0
"""Cost of a contact step over that of equal grains from which it is worth a word [-]."""


def cautions(
    scene: Scene,
    bodies: Bodies,
    spacing: tuple[float, ...] | None,
    load: ScreenLoad | None,
    cost: RunCost,
) -> tuple[str, ...]:
    """Sentences, each with a key and what to do.

    Args:
        scene: that is looked over.
        bodies: of its particles.
        spacing: of the mesh [m]; None without a fluid.
        load: on a side that holds grains in a stream.
        cost: of the run.
    """
    if bodies.radius.size == 0:
        return (*stream_from_rest(scene), *wall_times_beyond_the_end(scene))
    smallest, largest = 2.0 * float(np.min(bodies.radius)), 2.0 * float(np.max(bodies.radius))
    return (
        *_cells(scene, spacing, largest),
        *_sizes(scene, smallest, largest, cost),
        *_screen(scene, load),
        *stream_from_rest(scene),
        *wall_times_beyond_the_end(scene),
    )


def stream_from_rest(scene: Scene) -> Iterator[str]:
    """A sentence where a stream is driven from rest, so that no key tells how fast it becomes."""
    fluid = scene.fluid
    if fluid is None or not is_driven(fluid, scene.domain, scene.periodic):
        return
    if boundary_speed(scene) == 0.0:
        yield (
            "fluid.velocity: the stream is driven from rest, and no key tells how fast it becomes. So there is no "
            "limit of the Courant number on fluid.time_step here. The run cuts coupling intervals into up to "
            f"{SUBSTEPS[-1]} fluid steps, and stops where these do not suffice. Give the velocity that you expect as "
            "fluid.velocity, and the limit is known."
        )


def _cells(scene: Scene, spacing: tuple[float, ...] | None, diameter: float) -> Iterator[str]:
    if spacing is not None and scene.fluid is not None and scene.fluid.bed_mixing is not None:
        spacing = spacing[:-1]  # over a bed the mean velocity changes within a diameter of height
    if spacing is not None and min(spacing) < diameter:
        yield (
            f"fluid.cells: the cell side is {min(spacing) / diameter:.2g} of the largest diameter. The equations of "
            f"the fluid are averaged over the grains and the kernel (coupling.kernel_width). Cells smaller than a "
            f"diameter add cost but no detail; 2 to 4 diameters are usual."
        )


def _sizes(scene: Scene, smallest: float, largest: float, cost: RunCost) -> Iterator[str]:
    ratio = largest / smallest
    if cost.over_equal > DEAR:
        key = "particles.radius" if scene.particles is None else radius_key(scene.particles)
        yield (
            f"{key}: diameters range from {smallest:.3g} to {largest:.3g} m (1 : {ratio:.3g}). The "
            f"neighbour list has up to {cost.slots} entries of a grain. A contact step costs about "
            f"{cost.over_equal:.2g} times as much as with equal grains. Use sizes that differ less, or a wall in place "
            f"of the largest grains."
        )
    if scene.fluid is not None and scene.coupling is not None and ratio > UNEQUAL and not scene.coupling.polydisperse:
        law = "the closure" if scene.closure.file is not None else f"coupling.drag = {scene.coupling.drag!r}"
        yield (
            f"{law}: this is a drag law for equal grains, but the diameters are 1 : {ratio:.3g}. In a dense mixture "
            f"small grains get too much drag and large ones too little (see the page Limits: for 1 : 2 at a solid "
            f"fraction of 0.5 it is 1.5 and 0.5 times the drag of a law for mixtures). Set "
            f"coupling.polydisperse = true."
        )


def _screen(scene: Scene, load: ScreenLoad | None) -> Iterator[str]:
    contact = scene.contact
    if load is None or contact is None or load.overlap <= contact.maximum_overlap:
        return
    hertz = contact.law == "hertz_mindlin"
    key = "contact.young_modulus" if hertz else "contact.normal_stiffness"
    stiffness = contact.young_modulus if hertz else contact.normal_stiffness or 0.0
    needed = stiffness * (load.overlap / contact.maximum_overlap) ** (1.5 if hertz else 1.0)
    yield (
        f"{key} = {stiffness:.3g}: the flow can press grains against the {load.side} side, on average with "
        f"{load.weights:.2g} times their weight. They would overlap by {100 * load.overlap:.3g} % of a diameter; the "
        f"limit is {100 * contact.maximum_overlap:.3g} %. Grains may be lost through this side. Set {key} to "
        f"{needed:.2g} or more."
    )


def wall_times_beyond_the_end(scene: Scene) -> Iterator[str]:
    """Walls that come or vanish at a time that the run does not reach."""
    for k, wall in enumerate(scene.walls):
        for name, time, never in (("begin", wall.begin, "comes"), ("end", wall.end, "vanishes")):
            if time is not None and time >= scene.time.end:
                yield (
                    f"walls.{k}.{name} = {time:g}: the run ends at time.end = {scene.time.end:g} s, so this wall never "
                    f"{never}. Lower {name}, or raise time.end."
                )
