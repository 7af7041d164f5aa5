"""A scene run with all combinations of some keys: one run directory each, and a table of what came out.

Example:
    >>> variation = parse_variation("fluid.viscosity=1e-6,1e-3")  # doctest: +SKIP
    >>> run_sweep("scenes/settling.toml", {}, [variation], Path("runs/sweep"), listener)  # doctest: +SKIP
"""

from __future__ import annotations

import csv
import dataclasses
import io
import itertools
import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from jaxdem.errors import InputError, RunError
from jaxdem.files.durable import write_bytes
from jaxdem.io import Run, load_run, run_folder
from jaxdem.io.access import LOCK, locked
from jaxdem.io.run_folder import SCENE
from jaxdem.metrics import METRICS, compile_time, run_time
from jaxdem.run.sweep_figures import figures
from jaxdem.scene import Scene, load_scene, parse_override
from jaxdem.scene.stages import StagedScene, scenes_of

if TYPE_CHECKING:
    from jaxdem.run.time_loop import Progress

TABLE = "sweep.csv"
LONGEST_NAME = 120
"""Bytes of a run's name: file systems allow 255, and `~2` may be added."""

OPENING, CLOSING, QUOTES = "[{", "]}", "\"'"


class Listener(Protocol):
    """Who hears how the sweep goes on; the command line draws bars."""

    def stage(self, name: str, total: float) -> Callable[[float], None]:
        """A run of the given length starts; the result is called with how much of it is done."""
        ...

    def say(self, message: str) -> None:
        """A line for the reader."""
        ...


class Variation(NamedTuple):
    """A dotted key of the scene, and the values that it takes."""

    key: str
    values: tuple[object, ...]


@dataclasses.dataclass
class SweepRun:
    """One combination.

    Attributes:
        name: of its folder.
        texts: varied key -> its value as text.
        valid: what the run's summary says; None before the run.
        refused: it was not started, its input is wrong.
        reason: why it is not valid.
        run_time_s: `metrics.run_time`, without compiling; NaN where not recorded [s].
        compile_time_s: `metrics.compile_time`; NaN where not recorded [s].
        final: the nine metrics at the last output, SI; NaN where missing.
        further: what else it has, see `figures`.
    """

    name: str
    texts: dict[str, str]
    valid: bool | None = None
    refused: bool = False
    reason: str = ""
    run_time_s: float = math.nan
    compile_time_s: float = math.nan
    final: dict[str, float] = dataclasses.field(default_factory=lambda: {metric.name: math.nan for metric in METRICS})
    further: dict[str, float] = dataclasses.field(default_factory=dict)

    def take(self, run: Run) -> None:
        """What came of the run."""
        self.valid = run.summary.get("valid") is True
        self.reason = str(run.summary.get("reason") or "") if not self.valid else ""
        self.run_time_s, self.compile_time_s = run_time(run.summary), compile_time(run.summary)
        if run.number_of_frames:
            self.final = {metric.name: float(run.history[metric.name][-1]) for metric in METRICS}
        self.further = figures(run)


@dataclasses.dataclass
class Sweep:
    """All combinations, in the order of the grid: the last key varies fastest."""

    keys: tuple[str, ...]
    runs: list[SweepRun]
    table: Path

    @property
    def problems(self) -> list[SweepRun]:
        """Runs that failed or were refused."""
        return [run for run in self.runs if not run.valid]

    def write(self) -> None:
        """sweep.csv: one line a run; missing numbers are `nan`, `valid` is empty before the run."""
        text = io.StringIO()
        lines = csv.writer(text, lineterminator="\n")
        names = [metric.name for metric in METRICS]
        further = list(dict.fromkeys(name for run in self.runs for name in run.further))
        lines.writerow(["run", *self.keys, "valid", "run_time_s", "compile_time_s", *names, *further, "reason"])
        for run in self.runs:
            valid = "" if run.valid is None else str(run.valid).lower()
            numbers = [run.run_time_s, run.compile_time_s, *(run.final[name] for name in names)]
            numbers += [run.further.get(name, math.nan) for name in further]
            lines.writerow([run.name, *run.texts.values(), valid, *map(repr, numbers), run.reason])
        write_bytes(self.table, text.getvalue().encode())


def parse_variation(text: str) -> Variation:
    """`key=a,b,c` of the command line; values are TOML, commas inside brackets and quotes belong to a value.

    Raises:
        InputError: no key, no value, a value given twice, or one that is not TOML.
    """
    key, separator, given = text.partition("=")
    example = "For example --vary fluid.viscosity=1e-6,1e-3."
    if not separator or not key.strip():
        raise InputError("--vary", text, "must be key=value,value,...", example)
    parts = _split(given)
    if not all(part.strip() for part in parts):
        raise InputError(f"--vary {key}", given, "has an empty value", example)
    values = tuple(parse_override(f"{key}={part}", "--vary")[1] for part in parts)
    texts = [_text(value) for value in values]
    if len(set(texts)) < len(texts):
        raise InputError(f"--vary {key}", given, "has a value twice", "Name every value once.")
    return Variation(key.strip(), values)


def _split(text: str) -> list[str]:
    """Parts between the commas outside of brackets and quotes."""
    parts, depth, quote = [""], 0, ""
    for character in text:
        if quote:
            quote = "" if character == quote else quote
        elif character in QUOTES:
            quote = character
        depth += 0 if quote else (character in OPENING) - (character in CLOSING)
        if character == "," and depth == 0 and not quote:
            parts.append("")
        else:
            parts[-1] += character
    return parts


def _text(value: object) -> str:
    return value if isinstance(value, str) else repr(value)


def run_sweep(
    scene: str | Path | dict[str, Any],
    overrides: Mapping[str, object],
    variations: Sequence[Variation],
    out: Path,
    listener: Listener,
) -> Sweep:
    """Run all combinations, each in a folder of its own in `out`; sweep.csv is kept up to date.

    All scenes are read before the first run starts. Runs that are complete are not done again, those that were stopped
    go on; a run that fails or is refused is noted, and the others are done.

    Args:
        scene: file, or tables as a dict.
        overrides: dotted key -> value, the same in all runs.
        variations: keys and values; another key each.
        out: new or empty, or of an earlier sweep.
        listener: hears of each run that has something to compute.

    Raises:
        InputError: a key twice or with overrides, a scene that cannot be read, a folder that holds something else or
            to which another process writes.
        Interrupted: SIGINT or SIGTERM; a checkpoint was written.
    """
    sweep, scenes = _planned(scene, overrides, variations, out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _unwritable(out, error) from None
    with locked(out):
        sweep.write()
        for number, run in enumerate(sweep.runs, start=1):
            title = f"run {number} of {len(sweep.runs)}, {run.name}"
            _perform(run, scenes[run.name], out / run.name, title, listener)
            sweep.write()
    return sweep


def check_sweep(
    scene: str | Path | dict[str, Any],
    overrides: Mapping[str, object],
    variations: Sequence[Variation],
    out: Path,
) -> None:
    """Refuse what `run_sweep` would refuse before its first run; without JAX, and nothing is made or changed.

    Raises:
        InputError: as `run_sweep`.
    """
    _planned(scene, overrides, variations, out)


def _planned(
    scene: str | Path | dict[str, Any],
    overrides: Mapping[str, object],
    variations: Sequence[Variation],
    out: Path,
) -> tuple[Sweep, dict[str, Scene]]:
    """All combinations, and their scenes by name."""
    keys = [variation.key for variation in variations]
    for key in keys:
        if keys.count(key) > 1 or key in overrides:
            raise InputError("--vary", key, "is given twice", "Give every key once, by --set or --vary.")
    if "precision" in keys:
        remedy = "Make a sweep for each, with --set precision=..."
        raise InputError("--vary", "precision", "is the same in all runs of a process", remedy)
    scenes: dict[str, Scene] = {}
    sweep = Sweep(tuple(keys), [], out / TABLE)
    for values in itertools.product(*(variation.values for variation in variations)):
        chosen = dict(zip(keys, values, strict=True))
        run = SweepRun(_name(chosen, scenes), {key: _text(value) for key, value in chosen.items()})
        scenes[run.name] = load_scene(scene, {**overrides, **chosen})
        sweep.runs.append(run)
    _check_folder(out, scenes)
    return sweep, scenes


def _perform(run: SweepRun, scene: Scene, path: Path, title: str, listener: Listener) -> None:
    from jaxdem.run.scene_run import simulate_once  # with JAX, which what is refused does without

    def begin() -> Progress:
        advance = listener.stage(title, scenes_of(scene)[-1].time.end)
        return lambda time, _: advance(time)

    try:
        run.take(simulate_once(scene, path, begin))
    except RunError as error:
        run.take(load_run(_begun(scene, path)))
        run.valid, run.reason = False, str(error)
        listener.say(f"{title}: failed")
    except InputError as error:
        run.valid, run.refused, run.reason = False, True, str(error)
        listener.say(f"{title}: refused")


def _begun(scene: Scene, path: Path) -> Path:
    """The folder of a run that failed; of stages that of the last one that has begun."""
    if not isinstance(scene, StagedScene):
        return path
    return [path, *(path / stage.name for stage in scene.stages if (path / stage.name / SCENE).is_file())][-1]


def _name(chosen: Mapping[str, object], taken: Mapping[str, Scene]) -> str:
    """A readable folder name such as "viscosity=0.001,cells=10x10"; other characters become underscores."""
    last = [key.rpartition(".")[2] for key in chosen]
    parts = []
    for key, short in zip(chosen, last, strict=True):
        text = re.sub(r"\s*,\s*", "x", _text(chosen[key])).strip("[] ")
        parts.append(f"{short if last.count(short) == 1 else key}={text}")
    plain = re.sub(r"[^\w.+=,-]", "_", ",".join(parts))
    name = plain = plain.encode()[:LONGEST_NAME].decode(errors="ignore")
    others = itertools.count(2)
    while name in taken:
        name = f"{plain}~{next(others)}"
    return name


def _check_folder(out: Path, scenes: Mapping[str, Scene]) -> None:
    """Refuse a folder that holds something else, and runs of other scenes under the names of these."""
    try:
        entries = {entry.name for entry in out.iterdir()} - {LOCK} if out.exists() else set()
        if entries and not (out / TABLE).is_file():
            raise InputError("--out", str(out), f"is not empty and has no {TABLE}", "Choose another folder.")
        found = [name for name in scenes if (out / name / SCENE).is_file()]
    except OSError as error:
        raise _unwritable(out, error) from None
    for name in found:
        run_folder.require_same_scene(out / name, scenes[name].to_toml(), scenes[name].defaults())


def _unwritable(out: Path, error: OSError) -> InputError:
    return InputError("--out", str(out), f"cannot be written ({error.strerror})", "Choose another folder.")
