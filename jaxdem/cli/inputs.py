"""What the commands share: scenes to read, places to write to, lists of numbers. Only `start_jax` imports JAX."""

from __future__ import annotations

import os
import resource
import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from jaxdem.errors import InputError

if TYPE_CHECKING:
    from jaxdem.files.stored import Kind
    from jaxdem.io import Run
    from jaxdem.scene import Scene

ADDRESS_SPACE, ADDRESS_SPACE_PER_CORE = 3 * 2**29, 2**28
"""What JAX and its compiler reserve of it, with the stacks of a core's threads [B]; twice as much is normal."""

HOST_DEVICES = "xla_force_host_platform_device_count"
"""Flag by which somebody has chosen the number of devices of the processor already."""

COLLECTIVE_TIMEOUTS = {
    "xla_cpu_collective_call_warn_stuck_timeout_seconds": 300,
    "xla_cpu_collective_call_terminate_timeout_seconds": 3600,
}
"""How long devices of one processor wait for each other before XLA says so, and before it ends the process [s].

By default it ends after 40 s, which a busy machine, or one that was put to sleep, may well take.
"""


def prepare_file(path: Path, *inputs: str | Path | None, option: str = "--out") -> None:
    """Refuse a place that cannot be written, or that holds what is read, before hours of work, not after them."""
    from jaxdem.io.outputs import refuse_what_is_read

    with _refused_places(path):
        refuse_what_is_read(option, path, inputs)
        if path.is_dir():
            raise InputError(option, str(path), "is a folder", "Name a file in it.")
    prepare_folder(path.parent)


def prepare_folder(path: Path) -> None:
    """Make the folder, or refuse it."""
    with _refused_places(path):
        if path.exists() and not path.is_dir():
            raise InputError("--out", str(path), "is not a folder", "Name a folder.")
        path.mkdir(parents=True, exist_ok=True)
        if not os.access(path, os.W_OK):
            raise InputError("--out", str(path), "cannot be written", "Choose another place.")


@contextmanager
def _refused_places(path: Path) -> Iterator[None]:
    """What the file system says of a place is a wrong `--out`."""
    try:
        yield
    except OSError as error:
        limit = f"cannot be written ({error.strerror})"
        raise InputError("--out", str(path), limit, "Choose another place.") from None


def whole_numbers(option: str, text: str, separator: str) -> tuple[int, ...]:
    """Positive whole numbers out of a text such as 170-70-30; raises InputError that names the option."""
    try:
        numbers = tuple(int(part) for part in text.split(separator))
    except ValueError:
        numbers = (0,)
    if min(numbers) < 1:
        example = separator.join("421" if separator == "-" else "124")
        limit = f"must be positive whole numbers separated by {separator!r}"
        raise InputError(option, text, limit, f"For example {option} {example}.")
    return numbers


def read_scene(
    path: Path, settings: list[str] | None, closure: Path | None = None, subgrid: Path | None = None
) -> Scene:
    """The scene with the options applied, and closures that are closures as far as can be seen without JAX."""
    return read_scenes([path], settings, closure, subgrid)


def read_scenes(
    paths: Sequence[Path],
    settings: list[str] | None,
    closure: Path | None = None,
    subgrid: Path | None = None,
    resumed: Path | None = None,
) -> Scene:
    """As `read_scene`; several files are the stages of one scene.

    `resumed` is a run directory, whose own scene knows what it took from the run that it began from.
    """
    from jaxdem.scene.reading import require_files
    from jaxdem.scene.stages import scenes_of

    former = None if resumed is None else _own_former(resumed)
    try:
        scene = _loaded(paths, overrides(settings, closure, subgrid), former)
    except InputError:
        needed = {"--closure": (closure, ("fluid", "particles")), "--subgrid": (subgrid, ("fluid",))}
        given = {option: (file, tables) for option, (file, tables) in needed.items() if file is not None}
        if given:
            _refuse_unread(scenes_of(_loaded(paths, overrides(settings), former)), given)
        raise
    for one in scenes_of(scene):
        require_closure("closure.file" if closure is None else "--closure", one.closure.file)
        key = "fluid.subgrid" if subgrid is None else "--subgrid"
        require_closure(key, None if one.fluid is None else one.fluid.subgrid)
        require_files(one.tables())
    return scene


def _loaded(paths: Sequence[Path], changed: dict[str, Any], former: dict[str, Any] | None) -> Scene:
    from jaxdem.scene import load_scene
    from jaxdem.scene.reading import load_chain

    return load_chain(paths, changed) if len(paths) > 1 else load_scene(paths[0], changed, former)


def _refuse_unread(scenes: Sequence[Scene], given: dict[str, tuple[Path, tuple[str, ...]]]) -> None:
    """Refuses files of options, each with the tables that a scene needs to read it, where one of them is missing."""
    for option, (file, tables) in given.items():
        for number, scene in enumerate(scenes):
            if lacking := " and ".join(f"[{table}]" for table in tables if getattr(scene, table) is None):
                which = "the scene" if len(scenes) == 1 else f"stage {number}"
                limit = f"needs {lacking}, which {which} has not"
                raise InputError(option, str(file), limit, f"Leave out {option}, or add what is missing.")


def _own_former(folder: Path) -> dict[str, Any] | None:
    """What the scene of a run directory has kept of the scene that it began from; None without a start."""
    from jaxdem.files.reading import parse_toml, read_text
    from jaxdem.io.run_folder import SCENE
    from jaxdem.scene.former import remembered

    if not (folder / SCENE).is_file():
        return None
    try:
        own = parse_toml(read_text(folder / SCENE))
    except (OSError, ValueError):
        return None  # the run directory is refused for it
    return remembered(own) if isinstance(own.get("start"), dict) else None


def load_run(path: Path) -> Run:
    """The run of a directory; without JAX."""
    from jaxdem.io import load_run

    return load_run(path)


def require_closure(key: str, path: str | Path | None) -> None:
    """Refuse a file that is not there, or does not say of itself that it is a closure; its content is read later."""
    from jaxdem.files.stored import CLOSURE

    if path is not None:
        _require(Path(path), CLOSURE._replace(key=key))


def require_datasets(paths: Sequence[Path], other: str = "") -> None:
    """As `require_closure`, of datasets; `other` is what the command takes in their place."""
    from jaxdem.files.stored import DATASET

    kind = DATASET._replace(writer=DATASET.writer + other)
    for path in paths:
        if not path.is_dir():  # a folder is refused when it is read
            _require(path, kind)


def _require(path: Path, kind: Kind) -> None:
    from jaxdem.files.stored import reading

    with reading(path, kind._replace(again=f"Give a file written by {kind.writer}.")):
        pass


def this_command(context: typer.Context, **changes: object) -> str:
    """This command as a shell takes it: arguments, and options that differ from their defaults or are changed."""
    words = ["jaxdem", str(context.info_name)]
    for parameter in context.command.params:
        value = {**context.params, **changes}[str(parameter.name)]
        if value == parameter.get_default(context):
            continue
        for one in value if isinstance(value, (list, tuple)) else (value,):
            words += parameter.opts[:1] if parameter.param_type_name == "option" else []
            words += [] if one is True else [str(one)]
    return shlex.join(words)


def overrides(settings: list[str] | None, closure: Path | None = None, subgrid: Path | None = None) -> dict[str, Any]:
    """Keys of the scene that the options change."""
    from jaxdem.scene import parse_override

    changed = dict(parse_override(text) for text in settings or ())
    # Names in a scene are relative to it, names on the command line to the working directory.
    if closure is not None:
        changed["closure.file"] = str(closure.resolve())
    if subgrid is not None:
        changed["fluid.subgrid"] = str(subgrid.resolve())
    return changed


def set_collective_timeouts() -> None:
    """Sets `COLLECTIVE_TIMEOUTS`, unless somebody has; XLA reads it with the first device."""
    flags = os.environ.get("XLA_FLAGS", "")
    wanted = [f"--{name}={seconds}" for name, seconds in COLLECTIVE_TIMEOUTS.items() if name not in flags]
    os.environ["XLA_FLAGS"] = " ".join([flags, *wanted]).strip()


def start_jax(precision: str = "float32", devices: int = 1) -> None:
    """JAX, set to the precision of a scene, with its compiled programs kept between calls.

    Args:
        precision: of the scene.
        devices: so many, of a processor, are made of it; cards there are as many as there are.

    Raises:
        InputError: what JAX is asked for is not there, or it would end in an abort.
    """
    _require_address_space()
    from jaxdem.run.program_cache import use_program_cache

    use_program_cache()
    if devices > 1:
        set_collective_timeouts()
    import jax

    if precision == "float64":
        jax.config.update("jax_enable_x64", True)
    if devices > 1 and HOST_DEVICES not in os.environ.get("XLA_FLAGS", ""):
        jax.config.update("jax_num_cpu_devices", devices)
    asked = os.environ.get("JAX_PLATFORMS")
    try:
        jax.devices()
    except Exception as error:  # JAX raises RuntimeError, or AssertionError without a word
        if not asked:
            raise
        jax.config.update("jax_platforms", None)
        there = ", ".join(sorted({device.platform for device in jax.devices()}))
        reason = f" ({str(error).splitlines()[0]})" if str(error) else ""
        raise InputError(
            "JAX_PLATFORMS",
            asked,
            f"JAX finds no such device on this machine{reason}",
            f"Available: {there}.",
        ) from None


def _require_address_space() -> None:
    """Without room JAX and its compiler end the process, with an abort and no word of why."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    cores = os.cpu_count() or 1
    needed = ADDRESS_SPACE + cores * ADDRESS_SPACE_PER_CORE
    if limit != resource.RLIM_INFINITY and limit < needed:
        raise InputError(
            "ulimit -v",
            limit // 1024,
            f"limits the address space to {limit / 2**30:.2g} GiB; JAX and its compiler reserve about "
            f"{needed / 2**30:.2g} GiB on {cores} core{'s' if cores > 1 else ''}",
            f"Raise it to {needed // 1024} or more.",
        )
