"""`python -m studies injection --out DIR`: the study at full size."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from jaxdem.cli import process
from jaxdem.errors import JaxdemError


def main(arguments: Sequence[str] | None = None, command: str | None = None) -> int:
    """Do what the arguments say; returns the exit code, as `jaxdem` has them.

    Args:
        arguments: those of the process by default.
        command: what continues a stopped study, if it is not `python -m studies` with these arguments.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    parser = argparse.ArgumentParser(prog="python -m studies", description=__doc__)
    parser.add_argument("name", metavar="NAME", help="name of the study: injection")
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="folder for report.html and all runs")
    parser.add_argument("--parts", metavar="A,B,...", default="", help="parts to run; all by default")
    jobs = "processes at once; one per core by default, 0 only writes the tables of finished runs"
    parser.add_argument("--jobs", metavar="N", type=int, help=jobs)
    parser.add_argument("--quiet", action="store_true", help="show no bars")
    given = parser.parse_args(arguments)
    parts = [part.strip() for part in given.parts.split(",") if part.strip()]
    from studies.driver import run_study
    from studies.pool import Stopped

    try:
        problems = run_study(given.name, given.out, parts, given.jobs, given.quiet)
    except JaxdemError as error:
        return _fail(str(error), error.exit_code)
    except Stopped as stop:
        hint = f"Continue with: {command or shlex.join(['python', '-m', 'studies', *arguments])}"
        return _fail(f"The study was stopped, all its runs with a checkpoint. {hint}", 128 + stop.number)
    if problems:
        lines = "\n".join(f"  {piece}: {why}" for piece, why in problems.items())
        return _fail(f"{len(problems)} pieces of the study are not done:\n{lines}", 1)
    return 0


def _fail(message: str, code: int) -> int:
    print(f"jaxdem: {message}", file=sys.stderr)
    return code


if __name__ == "__main__":
    process.run(lambda: sys.exit(main()))
