"""Speed against another checkout of jaxdem, in one sitting: windows of both in turn, and the ratio of each pair.

`contact.py`, `fluid.py` and `coupled.py` use it with `--against DIR`. Each checkout computes in a process of its own
(`windows.py`), started in its folder, which stays and waits while the other has its turn.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from benchmarks import harness

HERE = Path(__file__).parents[1]
WORKER = Path(__file__).with_name("windows.py").resolve()


class Work(NamedTuple):
    """What a window does.

    Attributes:
        name: of the row.
        scene: scene file.
        changes: `--set` of the scene.
        intervals: coupling intervals of a window, each window going on where the last one ended; 0 for a whole run,
            without compiling.
        warm_up: intervals before the first window.
        cores: that both processes are kept on.
    """

    name: str
    scene: Path
    changes: dict[str, Any] = {}
    intervals: int = 0
    warm_up: int = 0
    cores: int = 1


class Checkout:
    """The process of a checkout, ready for windows; ends with the `with` block."""

    def __init__(self, folder: Path, work: Work):
        described = json.dumps(work._asdict() | {"scene": str(work.scene.resolve())})
        command = harness.pinned(work.cores, [sys.executable, str(WORKER), described])
        self._process = subprocess.Popen(
            command, cwd=folder, env=os.environ | {"PYTHONPATH": str(folder.resolve())}, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip
        self._answer()

    def __enter__(self) -> Checkout:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.communicate("")

    def window(self) -> dict[str, float]:
        """Times of a window [s]."""
        assert self._process.stdin is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        return self._answer()

    def _answer(self) -> Any:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.startswith(("{", '"')):  # a run may print lines of its own
                return json.loads(line)
        raise RuntimeError(f"the process in {self._process.args} ended with {self._process.wait()}")


def commit_of(folder: Path) -> str:
    """Short name of the commit that a checkout is at, with a plus where files differ from it."""
    command = ["git", "-C", str(folder), "describe", "--always", "--dirty=+"]
    done = subprocess.run(command, capture_output=True, text=True)
    return done.stdout.strip() or "no commit"


def compare(name: str, works: Sequence[Work], other: Path, pairs: int) -> dict[str, Any]:
    """Every work in turns, here and there; writes results/NAME_against.json and .md, and prints the table."""
    commits = {"here": commit_of(HERE), "there": commit_of(other)}
    result: dict[str, Any] = {"commits": commits}
    rows = [
        f"| {name} | cores | {commits['here']} [s a window] | {commits['there']} [s a window] | "
        "speed here over there, median of pairs (range) | pairs |",
        "| --- " * 6 + "|",
    ]
    for work in works:
        with ExitStack() as stack:
            both = [stack.enter_context(Checkout(folder, work)) for folder in (HERE, other)]
            windows: list[tuple[dict[str, float], ...]] = []
            for number in range(pairs):
                # Who begins changes, so that a drift of the machine's speed falls on both alike.
                order = (0, 1) if number % 2 == 0 else (1, 0)
                done = {k: both[k].window() for k in order}
                windows.append((done[0], done[1]))
        here, there = (harness.spread([pair[k]["seconds"] for pair in windows]) for k in (0, 1))
        ratio = harness.spread([pair[1]["seconds"] / pair[0]["seconds"] for pair in windows])
        result[f"{work.name}, {work.cores}"] = {"windows": windows, "speed_ratio": ratio}
        rows.append(
            f"| {work.name} | {work.cores} | {here['median']:.3g} | {there['median']:.3g} | "
            f"{ratio['median']:.2f} ({ratio['lowest']:.2f}-{ratio['highest']:.2f}) | {pairs} |"
        )
        harness.save(f"{name}_against", result, "\n".join(rows))
    harness.write(f"{name}_against", result, "\n".join(rows))
    return result


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of a benchmark that compares with another checkout."""
    parser.add_argument(
        "--against", type=Path, metavar="DIR", help="compare with jaxdem in this checkout, and nothing else"
    )
    parser.add_argument("--pairs", type=int, default=9, help="pairs of windows of --against")
