"""A scene run to its end, in a run directory: `jaxdem.simulate`."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Unpack

import jax
import numpy as np

from jaxdem.closures.base import DragClosure
from jaxdem.errors import InputError
from jaxdem.io import Run, load_run, run_folder
from jaxdem.io.chain import stage_names
from jaxdem.io.run_folder import SCENE
from jaxdem.run.chain import simulate_stages
from jaxdem.run.restart import origin, require_same_parameters
from jaxdem.run.single_run import RunOptions, own_start, simulate_alone
from jaxdem.run.time_loop import Progress
from jaxdem.scene import Scene
from jaxdem.scene.stages import StagedScene
from jaxdem.setup.builder import build_case
from jaxdem.setup.extensions import Extensions
from jaxdem.setup.given import require_scene


def simulate(
    scene: Scene,
    out: str | Path,
    *,
    closure: DragClosure | None = None,
    resume: bool = False,
    progress: Progress | None = None,
    profile: bool = False,
    settling: Progress | None = None,
    devices: int | Sequence[jax.Device] | None = None,
    **extensions: Unpack[Extensions],
) -> Run:
    """Runs a scene to its end and writes the run directory.

    Args:
        scene: from `jaxdem.load_scene`.
        out: run directory, of a scene with stages the folder of their run directories; must be new or empty unless
            `resume`.
        closure: drag law or learned closure in place of the scene's, see `jaxdem.build`. This and the extensions are
            not in the scene file: a resumed run must be given the same.
        resume: go on from the directory's checkpoint.
        progress: called now and then, at every output at least.
        profile: compile fluid and particles apart and measure both in every interval, for `stages_s` of the summary;
            slower.
        settling: called now and then while particles of a settled pack come to rest, with the time since they began to
            fall and the longest that they may take [s].
        devices: as many devices as are given, each with a part of the box, see `jaxdem.build`.
        extensions: further parts in place of the scene's, see `jaxdem.build`. With stages these and the closure go to
            those stages that have what reads them.

    Returns:
        The run, of a scene with stages that of the last one, as `jaxdem.load_run` gives it.

    Raises:
        InputError: the scene or the directory cannot be used; nothing was started.
        RunError: the run could not go on; what was done is kept, with `valid: false` in the summary.
        Interrupted: SIGINT or SIGTERM; a checkpoint was written.
    """
    require_scene(scene)
    if not isinstance(out, (str, os.PathLike)) or "\0" in os.fspath(out):
        raise InputError("out", out, "is no path", "give the folder of the run")
    for name, function in (("progress", progress), ("settling", settling)):
        if function is not None and not callable(function):
            raise InputError(name, function, "is no function", "give one that is called now and then, or None")
    for name, value in (("resume", resume), ("profile", profile)):
        if not isinstance(value, (bool, np.bool_)):
            raise InputError(name, value, "is neither True nor False", "give one of them")
    options = RunOptions(closure, resume, progress, profile, settling, devices)
    if isinstance(scene, StagedScene):
        return simulate_stages(scene, Path(out), options, **extensions)
    return simulate_alone(scene, out, options, **extensions)


def simulate_once(scene: Scene, out: Path, begin: Callable[[], Progress]) -> Run:
    """The run of a scene in `out`: made, gone on with from its checkpoint, or taken as it is where it is complete.

    Args:
        scene: from `jaxdem.load_scene`.
        out: run directory; one that was stopped before its first checkpoint is begun anew.
        begin: called where there is something to compute; gives `progress` of `simulate`.

    Raises:
        InputError, RunError, Interrupted: see `simulate`.
    """
    if isinstance(scene, StagedScene):
        return simulate_stages(scene, out, RunOptions(resume=stage_names(out) is not None, progress=begin()))
    if run_folder.is_complete(out, scene.to_toml()):
        case = build_case(scene, start=own_start(scene, out))
        require_same_parameters(out, origin(scene.to_toml(), case.parameters, scene.content))
        return load_run(out)
    return simulate(scene, out, resume=(out / SCENE).is_file(), progress=begin())
