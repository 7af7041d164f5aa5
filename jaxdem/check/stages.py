"""The check of a scene with stages: each as it will be when the one before has run."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

from jaxdem.check.cautions import wall_times_beyond_the_end
from jaxdem.check.check import CheckReport, check_scene
from jaxdem.run.chain import foreseen_cases
from jaxdem.scene import Scene
from jaxdem.scene.stages import StagedScene


def check_stages(scene: Scene, devices: int | None = None) -> Iterator[tuple[str, CheckReport]]:
    """The report of every stage of a scene, with the stage's name; of a scene without stages one, without a name.

    Where the particles will be at the start of a later stage is not known: they stand where the first one puts them.

    Raises:
        InputError: whatever `simulate` would refuse before its first step.
    """
    if not isinstance(scene, StagedScene):
        yield "", check_scene(scene, devices=devices)
        return
    for stage, start, _ in foreseen_cases(scene.stages):
        report = check_scene(stage.scene, start, devices)
        if stage is not scene.stages[-1]:  # its walls may change in a later stage
            later = set(wall_times_beyond_the_end(stage.scene))
            report = dataclasses.replace(report, warnings=tuple(w for w in report.warnings if w not in later))
        yield stage.name, report
