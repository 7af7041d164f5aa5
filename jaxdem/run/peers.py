"""The processes of one run: joining them, meeting, agreeing, and what each tells the first one.

`jax.distributed` has a coordination service in the first process. Meetings and messages go through it and not through
collectives; `devices.meeting` says why.
"""

from __future__ import annotations

import atexit
import contextlib
import dataclasses
import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import jax

from jaxdem.devices.meeting import LONGEST_WAIT, coordination_client
from jaxdem.errors import InputError, JaxdemError
from jaxdem.io.pieces import Share

HEARTBEAT, HEARTBEAT_NAME = 30, "JAXDEM_HEARTBEAT"
"""A process that has not been heard of for so long ends the run [s]; the variable that says another time."""

LAUNCH_WAIT, CLUSTER_WAIT = 60, 300
"""Longest time for all processes to appear, on one machine and on a cluster [s]."""

FAREWELL = 5.0
"""At the end of a run that failed: longer nobody waits for the others [s]."""

LOOK = 0.5
"""Time between two looks whether a process has failed [s]."""

FAILED = "jaxdem/failed/"
OUT_OF_MEMORY = "RESOURCE_EXHAUSTED"


class PeerLost(JaxdemError):
    """Another process of the run ended, or cannot be reached."""


@dataclasses.dataclass
class Peers:
    """The processes of this run.

    Attributes:
        index: of this one, from 0.
        number: of processes.
    """

    index: int = 0
    number: int = 1
    _barriers: int = 0

    @property
    def first(self) -> bool:
        """Whether this is the process that writes and shows what there is once."""
        return self.index == 0

    def barrier(self, longest: float = LONGEST_WAIT) -> None:
        """Waits until all processes are here; every process calls this in the same order.

        Raises:
            PeerLost: one did not come.
        """
        if self.number == 1:
            return
        self._barriers += 1
        try:
            coordination_client().wait_at_barrier(f"jaxdem/barrier/{self._barriers}", int(1000 * longest))
        except jax.errors.JaxRuntimeError as error:
            raise peer_lost(error) from None

    def highest(self, values: Sequence[int]) -> list[int]:
        """The largest of each number over all processes; all of them get the same. Every process waits for the others.

        Raises:
            PeerLost: one did not answer.
        """
        if self.number == 1:
            return [int(value) for value in values]
        before, place = (f"jaxdem/numbers/{self._barriers + k}/" for k in (0, 1))
        client = coordination_client()
        try:
            client.key_value_set(f"{place}{self.index}", " ".join(str(int(value)) for value in values))
            self.barrier()
            rows = [[int(text) for text in row.split()] for _, row in client.key_value_dir_get(place)]
            if self.first:  # all are here, so all have read what was said before
                client.key_value_delete(before)
        except jax.errors.JaxRuntimeError as error:
            raise peer_lost(error) from None
        return [max(column) for column in zip(*rows, strict=True)]

    def share(self) -> Share | None:
        """What this process has to write; None where it is alone."""
        return None if self.number == 1 else Share(self.index, self.number, self.barrier)

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """What JAX raises in the block, where there are other processes, means that one of them is lost.

        Raises:
            PeerLost: a collective operation did not come to an end.
        """
        try:
            yield
        except jax.errors.JaxRuntimeError as error:
            if self.number == 1 or OUT_OF_MEMORY in str(error):
                raise
            raise peer_lost(error) from None

    def report(self, message: str) -> None:
        """A message of this process for the first one, which shows it."""
        with contextlib.suppress(jax.errors.JaxRuntimeError, RuntimeError):
            coordination_client().key_value_set(f"{FAILED}{self.index}", message)

    def reported(self) -> str | None:
        """Message of the lowest process that has reported one; None as long as none has, or if that cannot be told."""
        try:
            told = sorted(coordination_client().key_value_dir_get(FAILED))
        except (jax.errors.JaxRuntimeError, RuntimeError):
            return None
        return str(told[0][1]) if told else None

    def watch(self, failed: Callable[[str], None]) -> None:
        """From now on a thread calls `failed` with the message when a process has reported one."""
        ended = threading.Event()

        def look() -> None:
            while (message := self.reported()) is None:
                if ended.wait(LOOK):
                    return
            failed(message)

        thread = threading.Thread(target=look, daemon=True)
        thread.start()

        def stop() -> None:
            ended.set()
            thread.join(FAREWELL)

        # A thread inside of JAX's client, which is C++, would end the process by a signal when the interpreter ends.
        atexit.register(stop)

    def part(self) -> None:
        """Before an end with an error: the first process, whose end is the end of all, goes last."""
        with contextlib.suppress(jax.errors.JaxRuntimeError, RuntimeError):
            coordination_client().wait_at_barrier("jaxdem/end", int(1000 * FAREWELL))


_joined: list[Peers] = []


def here() -> Peers:
    """This process among those of the run."""
    if not _joined:
        _joined.append(Peers(jax.process_index(), jax.process_count()))
    return _joined[0]


def join(index: int, number: int, coordinator: str | None, devices: Sequence[int] | None) -> Peers:
    """Joins the processes of a run, before anything is asked of JAX.

    Args:
        index: of this process.
        number: of processes.
        coordinator: HOST:PORT of the first one; None to let JAX find all of it.
        devices: numbers of the devices of this machine that this process uses; None for JAX's choice.

    Raises:
        PeerLost: the others did not come.
        InputError: the time of the heartbeat is no number.
    """
    seconds = heartbeat()
    jax.config.update("jax_cpu_collectives_implementation", "gloo")
    # JAX would take SIGTERM for itself, from here until the run listens to it again.
    jax.config.update("jax_enable_preemption_service", False)
    _yield_to_those_who_compute()
    given: dict[str, Any] = {}
    if coordinator is not None:
        given = {"coordinator_address": coordinator, "num_processes": number, "process_id": index}
        given |= {"local_device_ids": devices} if devices is not None else {}
    wait = CLUSTER_WAIT if devices is None else LAUNCH_WAIT
    try:
        jax.distributed.initialize(
            **given,
            initialization_timeout=wait,
            heartbeat_timeout_seconds=seconds,
            shutdown_timeout_seconds=seconds,
        )
    except jax.errors.JaxRuntimeError as error:
        raise peer_lost(error) from None
    _joined[:] = [Peers(index, number)]
    return _joined[0]


def heartbeat(environment: Mapping[str, str] = os.environ) -> int:
    """After so long without a sign of it a process is given up [s].

    Raises:
        InputError: the variable is no whole number of seconds, or below 1.
    """
    text = environment.get(HEARTBEAT_NAME, str(HEARTBEAT))
    if not text.isdecimal() or int(text) < 1:
        limit = "must be a whole number of seconds, 1 or more"
        raise InputError(HEARTBEAT_NAME, text, limit, f"Leave it out for {HEARTBEAT} s")
    return int(text)


def _yield_to_those_who_compute() -> None:
    """Threads that start from now on do not take a core from others when they wake, as far as the system can do that.

    A thread of gloo wakes as soon as a message comes, often while one that computes is still about to send and holds
    the lock of the connection. With the core that it takes away it then tries for that lock until its time slice is
    over, about 3 ms; a contact step of 10,000 grains takes 1 ms. In Linux's policy for batch work it waits for a core.
    """
    with contextlib.suppress(AttributeError, OSError):
        if os.sched_getscheduler(0) == os.SCHED_OTHER:
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


def peer_lost(error: BaseException) -> PeerLost:
    """What JAX says where another process is gone, in a sentence."""
    reason = (str(error).splitlines() or ["no reason given"])[0]
    return PeerLost(f"Another process of the run ended or cannot be reached ({reason[:200]}).")
