"""One scene run to its end, in a run directory."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Unpack

import jax

from jaxdem.closures.base import DragClosure
from jaxdem.devices import divided
from jaxdem.errors import is_whole
from jaxdem.io import Run, RunDirectory, load_run, run_folder
from jaxdem.io.probes import Columns
from jaxdem.io.run_folder import CHECKPOINT, START
from jaxdem.run.observer import columns_of
from jaxdem.run.parts.wear import keep_wear
from jaxdem.run.peers import here
from jaxdem.run.placement import OneDevice, Placement, Slabs
from jaxdem.run.restart import origin, require_same_parameters
from jaxdem.run.samples import sample_attributes, samples_every
from jaxdem.run.signals import noted_signals
from jaxdem.run.time_loop import Progress, TimeLoop
from jaxdem.run.wall_surfaces import keep_walls, place_pistons
from jaxdem.scene import Scene
from jaxdem.setup.builder import Case, build_case
from jaxdem.setup.extensions import Extensions
from jaxdem.setup.start_point import StartPoint, stored_start


@dataclasses.dataclass(frozen=True)
class RunOptions:
    """How a scene is run; see the arguments of `jaxdem.simulate`."""

    closure: DragClosure | None = None
    resume: bool = False
    progress: Progress | None = None
    profile: bool = False
    settling: Progress | None = None
    devices: int | Sequence[jax.Device] | None = None


def simulate_alone(scene: Scene, out: str | Path, options: RunOptions, **extensions: Unpack[Extensions]) -> Run:
    """`jaxdem.simulate` of a scene without stages."""
    resume = options.resume
    complete = resume and run_folder.is_complete(out, scene.to_toml())
    if complete:
        run_folder.require_same_scene(out, scene.to_toml(), scene.defaults())
    case = build_case(scene, options.closure, own_start(scene, out) if resume else None, **extensions)
    if complete:
        require_same_parameters(out, origin(scene.to_toml(), case.parameters, scene.content))
        return load_run(out)
    every = samples_every(scene, case.simulation)
    placement = placement_of(case, options)
    begun = resume and (Path(out) / CHECKPOINT).is_file()
    state, neighbors = case.unsettled_state() if begun else case.initial_state(options.settling)
    placement.require_fit(state)
    attributes = sample_attributes(case) if every else None
    # From the moment that there is a directory a signal is noted only: a checkpoint is left in it.
    columns = columns_of(case.probes)
    with noted_signals() as caught, _opened(scene, out, attributes, columns, resume) as directory:
        if case.start is not None:
            directory.keep_start(case.start.arrays, case.start.attributes)
        if here().first:
            keep_walls(case, directory.path)
        loop = TimeLoop(case, directory, state, neighbors, every, options.profile, placement=placement)
        del state, neighbors  # the loop has another one soon, and this one is of the whole box
        if directory.has_checkpoint:
            loop.restore()
        else:
            loop.place()
        if resume and run_folder.is_longer(out, scene.to_toml()):
            directory.store_scene(scene.to_toml())
        loop.run(options.progress, caught)
        last = loop.instant.state  # of all devices, whoever writes it
        if here().first:
            place_pistons(case, directory.path)
            keep_wear(case, last, directory.path)
    return load_run(out)


def placement_of(case: Case, options: RunOptions) -> Placement:
    """Where the state of a run will be.

    Raises:
        InputError: something in the scene does not work on several devices, or there are not so many.
    """
    if options.devices is None or (is_whole(options.devices) and options.devices == 1):
        return OneDevice(case)
    given = (None, 0) if case.particles is None else (case.particles.position, case.particles.total)
    return Slabs(case, divided(case.simulation, options.devices, *given))


def own_start(scene: Scene, out: str | Path) -> StartPoint | None:
    """The state that the run in a folder has begun from, as it was then; None where it is not kept there."""
    path = Path(out) / START
    return stored_start(path, scene.start.from_) if scene.start is not None and path.is_file() else None


def _opened(
    scene: Scene, out: str | Path, attributes: dict[str, Any] | None, probes: dict[str, Columns], resume: bool
) -> RunDirectory:
    share = here().share()
    if resume:
        return RunDirectory.resume(out, scene.to_toml(), attributes, scene.defaults(), probes, share)
    return RunDirectory.create(out, scene.to_toml(), attributes, probes, share)
