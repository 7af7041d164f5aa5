"""A scene run to its end, in a run directory: `jaxdem.simulate`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Unpack

from jaxdem.closures.base import DragClosure
from jaxdem.io import Run, RunDirectory, load_run
from jaxdem.io.probes import Columns
from jaxdem.io.run_directory import CHECKPOINT, SCENE
from jaxdem.run.observer import columns_of
from jaxdem.run.restart import origin, require_same_parameters
from jaxdem.run.samples import sample_attributes, samples_every
from jaxdem.run.signals import noted_signals
from jaxdem.run.time_loop import Progress, TimeLoop
from jaxdem.scene import Scene
from jaxdem.setup.builder import build, build_case
from jaxdem.setup.extensions import Extensions


def simulate(
    scene: Scene,
    out: str | Path,
    *,
    closure: DragClosure | None = None,
    resume: bool = False,
    progress: Progress | None = None,
    profile: bool = False,
    settling: Progress | None = None,
    **extensions: Unpack[Extensions],
) -> Run:
    """Runs a scene to its end and writes the run directory.

    Args:
        scene: from `jaxdem.load_scene`.
        out: run directory; must be new or empty unless `resume`.
        closure: drag law or learned closure in place of the scene's, see `jaxdem.build`. This and the extensions are
            not in the scene file: a resumed run must be given the same.
        resume: go on from the directory's checkpoint.
        progress: called now and then, at every output at least.
        profile: compile fluid and particles apart and measure both in every interval, for `stages_s` of the summary;
            slower.
        settling: called now and then while particles of a settled pack come to rest, with the time since they began to
            fall and the longest that they may take [s].
        extensions: further parts in place of the scene's, see `jaxdem.build`.

    Returns:
        The run, as `jaxdem.load_run` gives it.

    Raises:
        InputError: the scene or the directory cannot be used; nothing was started.
        RunError: the run could not go on; what was done is kept, with `valid: false` in the summary.
        Interrupted: SIGINT or SIGTERM; a checkpoint was written.
    """
    complete = resume and RunDirectory.is_complete(out)
    if complete:
        RunDirectory.require_same_scene(out, scene.to_toml(), scene.defaults())
    case = build_case(scene, closure, **extensions)
    if complete:
        require_same_parameters(out, origin(scene.to_toml(), case.parameters, scene.content))
        return load_run(out)
    every = samples_every(scene, case.simulation)
    begun = resume and (Path(out) / CHECKPOINT).is_file()
    state, neighbors = case.unsettled_state() if begun else case.initial_state(settling)
    attributes = sample_attributes(case) if every else None
    # From the moment that there is a directory a signal is noted only: a checkpoint is left in it.
    columns = columns_of(case.probes)
    with noted_signals() as caught, _opened(scene, out, attributes, columns, resume) as directory:
        loop = TimeLoop(case, directory, state, neighbors, every, profile)
        if directory.has_checkpoint:
            loop.restore()
        loop.run(progress, caught)
    return load_run(out)


def _opened(
    scene: Scene, out: str | Path, attributes: dict[str, Any] | None, probes: dict[str, Columns], resume: bool
) -> RunDirectory:
    if resume:
        return RunDirectory.resume(out, scene.to_toml(), attributes, scene.defaults(), probes)
    return RunDirectory.create(out, scene.to_toml(), attributes, probes)


def simulate_once(scene: Scene, out: Path, begin: Callable[[], Progress]) -> Run:
    """The run of a scene in `out`: made, gone on with from its checkpoint, or taken as it is where it is complete.

    Args:
        scene: from `jaxdem.load_scene`.
        out: run directory; one that was stopped before its first checkpoint is begun anew.
        begin: called where there is something to compute; gives `progress` of `simulate`.

    Raises:
        InputError, RunError, Interrupted: see `simulate`.
    """
    if RunDirectory.is_complete(out):
        require_same_parameters(out, origin(scene.to_toml(), build(scene)[1], scene.content))
        return load_run(out)
    return simulate(scene, out, resume=(out / SCENE).is_file(), progress=begin())
