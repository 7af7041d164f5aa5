"""A run by several processes or on several devices, as the command line sees it: who this process is, which devices it
has, and how the processes speak with one voice."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, NoReturn

import typer

from jaxdem.cli import process, terminal
from jaxdem.cli.cluster import Member, member
from jaxdem.cli.inputs import start_jax
from jaxdem.cli.launch import LOST_PEER, run_processes
from jaxdem.cli.library_output import reader_of_libraries
from jaxdem.errors import InputError, JaxdemError

if TYPE_CHECKING:
    import jax

    from jaxdem.scene import Scene

FAILED = 1
"""Exit code of a run that failed."""

WAIT_FOR_FAILURE = 3.0
"""After another process has failed this one has so long to end for the same reason by itself [s]."""


class ProcessGroup(NamedTuple):
    """What a run goes over.

    Attributes:
        member: this process among several; None where it is alone.
        devices: of all processes together; None for all that a cluster gives, one without a cluster.
    """

    member: Member | None
    devices: int | None

    @property
    def own(self) -> int:
        """Devices that this process needs, of those of its machine; 1 where a cluster decides."""
        if self.member is None:
            return self.devices or 1
        return 1 if self.devices is None else max(1, self.devices // self.member.number)

    @property
    def is_first(self) -> bool:
        """Whether this process shows what there is."""
        return self.member is None or self.member.first

    def places(self) -> list[int] | None:
        """Numbers of the devices of this process on its machine, where `--processes` has started it."""
        if self.member is None or not self.member.launched:
            return None
        return list(range(self.member.rank * self.own, (self.member.rank + 1) * self.own))


def group_of(devices: int | None, processes: int | None) -> ProcessGroup:
    """What the options and the environment ask for.

    Raises:
        InputError: they do not fit together.
    """
    found = member()
    if found is not None and processes not in (None, found.number):
        limit = f"this process is one of {found.number} that are started already"
        raise InputError("--processes", processes, limit, "Leave the option out")
    number = processes or 1 if found is None else found.number
    if devices is not None and devices % number:
        limit = f"must be a multiple of the number of processes, {number}: each has as many devices"
        raise InputError("--devices", devices, limit, f"Give {number * max(1, round(devices / number))}.")
    if devices is None and processes is not None:
        devices = processes
    return ProcessGroup(found, devices)


def launch(group: ProcessGroup, processes: int | None, scene: Scene, resumed: Path | None, resume: str) -> None:
    """Where `--processes` asks for more than this process: starts them, and ends with their exit code.

    What is wrong with the scene, and a box that cannot be cut so, is told before any is started: a hundred processes
    that build the scene to refuse it fill the memory of a small machine.

    Args:
        group: what the run goes over.
        processes: the option.
        scene: that they run.
        resumed: run directory that they go on in; None for a new one.
        resume: the command by which the run goes on.

    Raises:
        InputError: the scene cannot be run, its box not be cut into so many slabs, or `JAXDEM_HEARTBEAT` is no time.
    """
    if group.member is not None or processes is None or processes == 1:
        return
    from jaxdem.run.peers import heartbeat

    heartbeat()
    _require_slabs(scene, resumed, group.devices or processes)
    cores = len(os.sched_getaffinity(0))
    if processes > cores:
        shared, remedy = f"{cores} cores", f"give --processes {cores}"
        if cores == 1:
            shared, remedy = "one core", "leave --processes out"
        terminal.warn(f"{processes} processes share {shared} and wait for each other; {remedy}")
    process.be_silent()
    outcome = run_processes(processes, sys.argv[1:])
    if outcome.message is not None:
        terminal.fail(f"{outcome.message} The run has stopped. Continue with: {resume}", outcome.code)
    raise typer.Exit(outcome.code)


def _require_slabs(scene: Scene, resumed: Path | None, number: int) -> None:
    """Refuses a box that cannot be cut into so many slabs, in any stage. No card is touched."""
    import jax

    jax.config.update("jax_platforms", "cpu")
    start_jax(scene.precision)
    from jaxdem.devices.cut import slabs_of
    from jaxdem.run.chain import foreseen_cases, named_stage
    from jaxdem.run.single_run import own_start
    from jaxdem.scene.stages import StagedScene
    from jaxdem.setup.builder import build_case

    if not isinstance(scene, StagedScene):
        case = build_case(scene, start=None if resumed is None else own_start(scene, resumed))
        slabs_of(case.simulation, number, None)
        return
    for k, (stage, _, case) in enumerate(foreseen_cases(scene.stages)):
        with named_stage(k, stage):
            slabs_of(case.simulation, number, None)


def chosen_devices(group: ProcessGroup) -> list[jax.Device] | None:
    """The devices of the run, in the order of processes; None for one, which runs the program without blocks.

    Raises:
        InputError: there are not so many.
    """
    import jax

    found = jax.devices()
    wanted = group.devices
    if group.member is None:
        if wanted is None or wanted == 1:
            return None
        if len(found) < wanted:
            there = f"this machine has {len(found)} of kind {found[0].device_kind}"
            raise InputError("--devices", wanted, there, f"Give {len(found)} at most")
        return found[:wanted]
    if wanted is not None and wanted != len(found):
        there = f"the {group.member.number} processes have {len(found)} devices together"
        raise InputError("--devices", wanted, there, "Leave the option out, or start as many processes as devices")
    return found


@contextmanager
def messages_of_first(group: ProcessGroup) -> Iterator[None]:
    """Errors of a run by several processes are told once, by the first process; all then end, none waits for ever."""
    if group.member is None:
        yield
        return
    if not group.is_first:
        process.be_silent()
    try:
        yield
    except typer.Exit as end:
        if end.exit_code:
            _end(group.member, f"exit code {end.exit_code}", end.exit_code, shown=True)
        raise
    except JaxdemError as error:
        _end(group.member, str(error), error.exit_code)
    except (OSError, MemoryError, RuntimeError) as error:
        _end(group.member, (str(error).splitlines() or [type(error).__name__])[0], FAILED)


def join(group: ProcessGroup) -> None:
    """Joins the other processes, before anything is asked of JAX; from now on only the first one shows anything."""
    if group.member is None:
        return
    one = group.member
    if not one.launched:
        process.divert_libraries(reader_of_libraries(one.rank, one.number), of_launcher=True)
    from jaxdem.run import peers

    joined = peers.join(one.rank, one.number, one.coordinator, group.places())
    if not one.first:
        terminal.tell_through(lambda message: None)
    joined.watch(partial(_followed, one))


_ending = threading.Event()
"""This process has begun to end with an error."""


def _followed(one: Member, message: str) -> None:
    """Another process has failed: ends this one, unless it is about to do so for the same reason."""
    if _ending.wait(WAIT_FOR_FAILURE):
        return
    with suppress(typer.Exit):
        terminal.fail(message, FAILED)
    _part()
    process.end(FAILED)


def _end(one: Member, message: str, code: int, shown: bool = False) -> NoReturn:
    """Ends with a message, that of the process where the cause lies if another one has reported it.

    Args:
        one: this process.
        message: why.
        code: exit code.
        shown: whether the message is shown already.
    """
    from jaxdem.run.peers import PeerLost, here

    _ending.set()
    lost, peers = isinstance(sys.exception(), PeerLost), here()
    told = peers.reported() if lost else None
    if not lost:
        peers.report(message)
    elif told is None and one.launched:
        shown, code = True, LOST_PEER  # the launcher has seen who ended, and why
    try:
        if not shown:
            terminal.fail(message if told is None else told, code)
        raise typer.Exit(code)
    finally:
        _part()


def _part() -> None:
    from jaxdem.run.peers import here

    process.leave_at_once()
    here().part()
