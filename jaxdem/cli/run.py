"""The commands that compute: check, run, sweep."""

from __future__ import annotations

from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jaxdem.cli import members, options, terminal
from jaxdem.cli.inputs import overrides, read_scene, read_scenes, start_jax, this_command
from jaxdem.cli.units import units_beside_a_refusal, warn_of_units

if TYPE_CHECKING:
    from jaxdem.scene import Scene


def check(scene: options.SceneFiles, settings: options.Settings = None, devices: options.CheckedDevices = None) -> None:
    """Check a scene without running it: time-step limits, engineering numbers, wall time, memory, warnings.

    The exit code is 2 if `run` would refuse the scene. Several scenes, and the stages of one, are checked in turn. The
    devices that are asked for need not be there.
    """
    description = read_scenes(scene, settings)
    start_jax(description.precision)
    from jaxdem.check.stages import check_stages
    from jaxdem.cli.check_table import render

    with units_beside_a_refusal(description):
        for name, report in check_stages(description, devices):
            if name:
                terminal.line(f"Stage {name}")
            terminal.show(render(report))


def run(
    context: typer.Context,
    scene: options.SceneFiles,
    out: Annotated[Path, options.folder_out("Run directory; it must be new or empty.")],
    settings: options.Settings = None,
    resume: options.Resume = False,
    profile: options.Profile = False,
    quiet: options.QuietRun = False,
    closure: options.ClosureFile = None,
    subgrid: options.SubgridFile = None,
    devices: options.DeviceCount = None,
    processes: options.ProcessCount = None,
) -> None:
    """Run a scene and write a run directory.

    Several scenes run one after the other, each from the end of the one before, as the stages of one scene do: the run
    directory of each is in that of --out, under its name. With several devices the box is cut into as many parts.
    """
    group = members.group_of(devices, processes)
    with members.messages_of_first(group):
        members.join(group)
        description = read_scenes(scene, settings, closure, subgrid, out if resume else None)
        complete = group.is_first and _refuse_folder(description, out, resume)
        if not quiet:
            warn_of_units(description)
        members.launch(group, processes, description, out if resume else None, this_command(context, resume=True))
        start_jax(description.precision, group.own)
        from jaxdem.cli import progress
        from jaxdem.run.scene_run import simulate
        from jaxdem.run.time_loop import Interrupted

        quiet = quiet or not group.is_first
        beside = units_beside_a_refusal(description) if quiet else nullcontext()
        try:
            with beside, progress.simulated_time(quiet) as report:
                settling = partial(report, note=" at most: particles settle before the run begins")
                result = simulate(
                    description,
                    out,
                    resume=resume,
                    progress=report,
                    profile=profile,
                    settling=settling,
                    devices=members.chosen_devices(group),
                )
        except Interrupted as stop:
            hint = f"A checkpoint is in {stop.folder}. Continue with: {this_command(context, resume=True)}"
            terminal.fail(f"{str(stop).capitalize()} of {stop.end:g} s. {hint}", 128 + stop.number)
        if complete:
            terminal.line(f"The run in {out} is complete; there is nothing to resume.")
        terminal.print_run(result)
        if not result.summary.get("valid"):
            terminal.fail(f"The run is not valid: {result.summary.get('reason') or 'no reason given'}", 1)


def sweep(
    context: typer.Context,
    scene: options.SceneFile,
    out: Annotated[Path, options.folder_out("Folder for sweep.csv and the runs.")],
    vary: options.Vary,
    settings: options.Settings = None,
    closure: options.ClosureFile = None,
    subgrid: options.SubgridFile = None,
    quiet: options.QuietRun = False,
) -> None:
    """Run a scene with all combinations of the values of some keys. The same command continues a stopped sweep."""
    from jaxdem.io.outputs import refuse_run_folder, refuse_what_is_read
    from jaxdem.run.sweep import TABLE, check_sweep, parse_variation, run_sweep
    from jaxdem.scene import named_files

    variations = [parse_variation(text) for text in vary]
    # What is wrong without variations is said here.
    description = read_scene(scene, settings, closure, subgrid)
    refuse_run_folder("--out", out)
    refuse_what_is_read("--out", out / TABLE, (scene, *named_files(description.model_dump())))
    changed = overrides(settings, closure, subgrid)
    check_sweep(scene, changed, variations, out)
    if not quiet:
        warn_of_units(description)
    start_jax(description.precision)
    from jaxdem.cli import progress
    from jaxdem.run.time_loop import Interrupted

    try:
        with progress.study_display(quiet) as display:
            result = run_sweep(scene, changed, variations, out, display)
    except Interrupted as stop:
        hint = f"Continue with: {this_command(context)}"
        terminal.fail(f"{str(stop).capitalize()} of a run of the sweep. {hint}", 128 + stop.number)
    terminal.print_sweep(result)
    if result.problems:
        names = ", ".join(run.name for run in result.problems)
        code = 2 if all(run.refused for run in result.problems) else 1
        terminal.fail(f"{len(result.problems)} of {len(result.runs)} runs are not valid: {names}", code)


def _refuse_folder(description: Scene, out: Path, resume: bool) -> bool:
    """Refuse a folder that cannot be run in, before JAX is there; whether all in it is complete."""
    from jaxdem.io import run_folder
    from jaxdem.scene.stages import StagedScene

    if not isinstance(description, StagedScene):
        run_folder.require_usable(out, description.to_toml(), resume, description.defaults())
        return resume and run_folder.is_complete(out, description.to_toml())
    from jaxdem.io.chain import check_chain

    names = [stage.name for stage in description.stages]
    check_chain(out, names, resume)
    return resume and all(
        run_folder.is_complete(out / stage.name, stage.scene.to_toml()) for stage in description.stages
    )
