"""Several scenes run one after the other, each from the end of the one before: the stages of a scene."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Unpack, cast

from jaxdem.closures.base import DragClosure
from jaxdem.errors import InputError
from jaxdem.io import Run, load_run, run_folder
from jaxdem.io.access import locked
from jaxdem.io.chain import check_chain, write_chain
from jaxdem.io.run_folder import SCENE
from jaxdem.run.foreseen import foreseen_end
from jaxdem.run.peers import here
from jaxdem.run.single_run import RunOptions, simulate_alone
from jaxdem.scene import Scene
from jaxdem.scene.stages import Stage, StagedScene
from jaxdem.setup.builder import Case, build_case
from jaxdem.setup.extensions import Extensions
from jaxdem.setup.given import lacking
from jaxdem.setup.start_point import StartPoint


def simulate_stages(scene: StagedScene, out: Path, options: RunOptions, **extensions: Unpack[Extensions]) -> Run:
    """Runs the stages of a scene, each in the folder of its name in `out`, and gives the last run.

    All are checked before the first one starts. Under `resume` stages that are complete are left as they are, the one
    that was stopped goes on, and the others follow.

    Args, Raises:
        see `jaxdem.simulate`.
    """
    stages = scene.stages
    names = [stage.name for stage in stages]
    require_stages(stages, out, options.resume)
    parts = _parts_of_stages(stages, options.closure, extensions)
    for _ in foreseen_cases(stages, options.closure, **extensions):
        pass
    peers = here()
    peers.barrier()  # all have looked into the folder before one writes there
    with locked(out) if peers.first else nullcontext():
        if peers.first:
            write_chain(out, names)
        for stage, before, (closure, own) in zip(stages, [None, *stages], parts, strict=False):
            path = out / stage.name
            begins = stage.scene if before is None else begun_from(stage.scene, out / before.name)
            complete = run_folder.is_complete(path, begins.to_toml())
            of_stage = dataclasses.replace(options, closure=closure, resume=(path / SCENE).is_file())
            peers.barrier()
            if not complete:
                simulate_alone(begins, path, of_stage, **own)
    return load_run(out / names[-1])


def require_stages(stages: Sequence[Stage], out: Path, resume: bool) -> None:
    """Refuse what `simulate_stages` would refuse for what is in the folder; nothing is made or changed.

    Raises:
        InputError: see `check_chain`, or the run of a stage is of another scene.
    """
    check_chain(out, [stage.name for stage in stages], resume)
    for k, (stage, before) in enumerate(zip(stages, [None, *stages], strict=False)):
        path = out / stage.name
        if resume and (path / SCENE).is_file():
            scene = stage.scene if before is None else begun_from(stage.scene, out / before.name)
            with named_stage(k, stage):
                run_folder.require_same_scene(path, scene.to_toml(), scene.defaults())
                if k + 1 < len(stages) and (out / stages[k + 1].name).is_dir():
                    _require_same_end(scene, path, stages[k + 1])


def _require_same_end(scene: Scene, path: Path, following: Stage) -> None:
    """Refuses a later end of a stage from whose end another has begun."""
    if run_folder.is_longer(path, scene.to_toml()):
        limit = f"the stage {following.name} has begun from the end that the run in {path} has"
        raise InputError("time.end", scene.time.end, limit, "raise time.end of the last stage alone")


def foreseen_cases(
    stages: Sequence[Stage], closure: DragClosure | None = None, **extensions: Unpack[Extensions]
) -> Iterator[tuple[Stage, StartPoint | None, Case]]:
    """Every stage with its start and its case, as far as they are known before anything has run.

    Raises:
        InputError: of the first stage that cannot work, naming it.
    """
    start = None
    parts = _parts_of_stages(stages, closure, extensions)
    for k, (stage, (law, own)) in enumerate(zip(stages, parts, strict=True)):
        with named_stage(k, stage):
            case = build_case(stage.scene, law, start, **own)
            begun = start
            start = foreseen_end(case)
        yield stage, begun, case


def _parts_of_stages(
    stages: Sequence[Stage], closure: DragClosure | None, extensions: Extensions
) -> list[tuple[DragClosure | None, Extensions]]:
    """Of every stage the closure and the extensions that it reads: a bed may be filled dry and fluidised by a law of
    the user's.

    Raises:
        InputError: no stage reads one of them.
    """
    given = {"closure": closure, **extensions}
    unread = [lacking(stage.scene, given) for stage in stages]
    for name in unread[0]:
        if all(name in of_stage for of_stage in unread):
            limit = f"needs {unread[0][name]}, which no stage has"
            raise InputError(name, "given", limit, "leave it out, or add what is missing")
    return [
        (
            None if "closure" in of_stage else closure,
            cast(Extensions, {name: part for name, part in extensions.items() if name not in of_stage}),
        )
        for of_stage in unread
    ]


def begun_from(scene: Scene, folder: Path) -> Scene:
    """The scene of a stage with the run directory that it begins from."""
    start = scene.start
    if start is None:
        return scene
    return scene.model_copy(update={"start": start.model_copy(update={"from_": str(folder.resolve())})})


@contextmanager
def named_stage(number: int, stage: Stage) -> Iterator[None]:
    """What is wrong with a stage names it."""
    try:
        yield
    except InputError as error:
        limit = f"in stage {number} ({stage.name}): {error.limit}"
        raise InputError(error.key, error.value, limit, error.remedy) from None
