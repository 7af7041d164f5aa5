"""What libraries write to the standard streams of a process that a launcher such as srun or mpirun has started.

JAX ends a process whose peers are gone by a stack trace: twenty lines in every process that is left. A helper reads
what libraries write, hands it on, and puts one sentence in place of those traces. It is a process of its own, because
this one is ended at once. Run as a script, with Python's own library alone.
"""

from __future__ import annotations

import os
import re
import select
import signal
import subprocess
import sys
import time

ABORTED = "Terminating process because the JAX distributed service"
"""What JAX writes when it ends a process because another one is gone."""

OF_COORDINATION = ("coordination_service", "preemption_sync_manager", ABORTED)
"""Parts of the lines that go before its end; lines after one of them are held back for `HELD`."""

CHATTER = "[Gloo] Rank "
"""Every process says so once that it has found the others."""

HELD = 5.0
"""So long lines are held back until it is known whether the process ends [s]."""

LOOK = 2.0
"""How often the process is looked after [s]."""

SILENT = re.compile(r"stopped sending heartbeats\):\s*([\d,\s]+)")
"""The processes that JAX has not heard of."""


def reader_of_libraries(rank: int, number: int) -> int:
    """Starts the helper of one of so many processes; the file descriptor that libraries are to write to."""
    reader, writer = os.pipe()
    command = [sys.executable, "-I", "-S", __file__, str(rank), str(number)]
    with open(reader, "rb") as given:
        subprocess.Popen(command, stdin=given, stdout=subprocess.DEVNULL)
    return writer


def told(text: str, rank: int, number: int) -> str:
    """What is shown of lines that were held back when a process ended.

    Args:
        text: the lines.
        rank: of the process that wrote them.
        number: of processes.

    Returns:
        The lines themselves; where JAX has ended the process one sentence, from the first of those that are left, and
        nothing from the others.
    """
    if ABORTED not in text:
        return text
    found = SILENT.search(text)
    lost = {int(one) for one in re.findall(r"\d+", found[1])} if found else {0}  # the first has the service
    if rank != min(set(range(number)) - lost, default=rank):
        return ""
    names = ", ".join(map(str, sorted(lost)))
    which = f"Process {names} of {number} was ended or does" if len(lost) == 1 else f"Processes {names} of {number} do"
    return f"jaxdem: {which} not answer any more. The run has stopped. Go on with --resume\n"


def hand_on(rank: int, number: int) -> None:
    """Standard input to standard error until it ends, see `told`.

    A process that was stopped for long finds, when it goes on, that the others have ended; they are not the cause.
    """
    held, since, line, stopped, process = "", 0.0, b"", False, os.getppid()
    while True:
        comes = select.select([0], [], [], LOOK)[0]
        if held and ABORTED not in held and time.monotonic() - since > HELD:  # also where lines go on to come
            _write(held)
            held = ""
        if not comes:
            stopped = stopped or is_stopped(process)
            continue
        given = os.read(0, 65536)
        *lines, line = (line + given).splitlines(keepends=True) or [b""]
        if not given or line.endswith(b"\n"):
            lines, line = [*lines, line], b""
        for one in (part.decode(errors="replace") for part in lines):
            if held or any(name in one for name in OF_COORDINATION):
                since = since if held else time.monotonic()
                held += one
            elif not one.startswith(CHATTER):
                _write(one)
        if not given:
            _write("" if stopped and ABORTED in held else told(held, rank, number))
            return


def is_stopped(process: int) -> bool:
    """Whether SIGSTOP or the like holds a process, as far as the system tells."""
    try:
        with open(f"/proc/{process}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] == "T"
    except (OSError, IndexError):
        return False


def _write(text: str) -> None:
    os.write(2, text.encode())


if __name__ == "__main__":
    for number in (signal.SIGINT, signal.SIGTERM):  # these are for the process; the helper ends with it
        signal.signal(number, signal.SIG_IGN)
    hand_on(int(sys.argv[1]), int(sys.argv[2]))
