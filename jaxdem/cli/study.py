"""The command `jaxdem study`: the demonstration, and the full size where the source code is at hand."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from jaxdem.cli import options, terminal
from jaxdem.cli.inputs import prepare_folder, start_jax, this_command
from jaxdem.errors import InputError

STUDIES = ("clusters", "injection")
FULL_SIZE = ("injection",)
"""Studies that `--scale paper` is for."""
SOURCE = Path(__file__).parents[2]
"""The checkout, where the package is in one."""


def study(
    context: typer.Context,
    name: options.StudyName,
    out: Annotated[Path, options.folder_out("Folder for report.html and all runs.")],
    scale: options.StudyScale = options.Scale.demo,
    parts: options.Parts = "",
    jobs: options.Jobs = None,
    quiet: options.Quiet = False,
) -> None:
    """Do a whole study: run, make a dataset, train, run with the closure, compare.

    The same command continues a stopped study.
    """
    if name not in STUDIES:
        raise InputError("NAME", name, "is not known", f"known: {', '.join(STUDIES)}")
    if scale is options.Scale.paper and name not in FULL_SIZE:
        remedy = "`python benchmarks/clusters.py` in the source code has the larger runs."
        raise InputError("--scale", scale.value, f"is for {', '.join(FULL_SIZE)} only", remedy)
    if scale is options.Scale.paper:
        given = [name, "--out", str(out), *(["--parts", parts] if parts else []), *(["--quiet"] if quiet else [])]
        _full_size([*given, *(["--jobs", str(jobs)] if jobs is not None else [])], this_command(context))
    if parts or jobs is not None:
        key, value = ("--parts", parts) if parts else ("--jobs", str(jobs))
        raise InputError(key, value, "is only used at full size", "Give --scale paper as well.")
    prepare_folder(out)
    start_jax()
    from jaxdem.cli import progress
    from jaxdem.run.time_loop import Interrupted
    from jaxdem.study import run_study

    try:
        with progress.study_display(quiet) as display:
            comparison = run_study(name, out, display)
    except Interrupted as stop:
        hint = f"Continue with: {this_command(context)}"
        message = f"The study was stopped, a run at t = {stop.time:.6g} s with a checkpoint. {hint}"
        terminal.fail(message, 128 + stop.number)
    terminal.print_comparison(comparison)


def _full_size(arguments: list[str], command: str) -> None:
    """`python -m studies` of the checkout that this package is in; `command` is what continues it.

    Raises:
        InputError: the package is not in a checkout.
        typer.Exit: with the study's exit code.
    """
    if not (SOURCE / "studies" / "__main__.py").is_file():
        limit = "needs the folder `studies` of the source code, which the package does not contain"
        remedy = "Get the source code and install it with `pip install --editable .`, or use --scale demo."
        raise InputError("--scale", options.Scale.paper.value, limit, remedy)
    start_jax()
    sys.path.insert(0, str(SOURCE))  # not another program's `studies`
    raise typer.Exit(import_module("studies.__main__").main(arguments, command))
