"""Pieces of work in processes: order, failures, crashes, signals."""

import os
import signal
import sys
import threading
import time
from functools import partial

import pytest
from rich.progress import Progress

from jaxdem.errors import RunError
from studies.pool import Piece, Pool, Stopped


def finish(out, report):
    out.write_text("done")


def crash(out, report):
    os.kill(os.getpid(), signal.SIGKILL)


def break_down(out, report):
    print("a line before")
    raise ValueError("no such luck")


def refuse(out, report):
    raise RunError("not possible", "grain 3", 1.0, "Try again")


def wait_for_signal(out, report):
    def stop(number, _):
        out.write_text("checkpoint")
        sys.exit(128 + number)

    signal.signal(signal.SIGINT, stop)
    report(0.5)
    time.sleep(60)


class Interrupting(Progress):
    """A display that sends a signal once, when it is told of progress."""

    sent = threading.Event()

    def update(self, task_id, **fields):
        if fields.get("completed") and not self.sent.is_set():
            self.sent.set()
            os.kill(os.getpid(), signal.SIGINT)
        super().update(task_id, **fields)


@pytest.fixture
def piece(tmp_path):
    return lambda name, do=finish, **more: Piece(name, partial(do, tmp_path / name), 1.0, **more)


def test_a_piece_waits_for_what_it_needs_and_failures_cost_only_what_needs_them(piece, tmp_path, capsys):
    """In the order of need; a crash, an exception and a refusal are named with their reasons, the rest is done."""
    problems = Pool(2, tmp_path / "logs", Progress(disable=True)).do(
        [
            piece("old", done=True),
            piece("run", needs=("closure", "old")),
            piece("closure"),
            piece("killed", crash),
            piece("bad", break_down),
            piece("worse", refuse),
            piece("after bad", needs=("bad",)),
            piece("after that", needs=("after bad",)),
        ]
    )
    said = capsys.readouterr().out
    assert said.index("closure: begun") < said.index("run: begun") and "old" not in said
    assert (tmp_path / "run").read_text() == "done"
    assert set(problems) == {"killed", "bad", "worse", "after bad", "after that"}
    assert problems["killed"] == f"ended with code {-signal.SIGKILL}, without a message"
    assert problems["bad"] == "ValueError: no such luck"
    assert problems["worse"] == "not possible (grain 3) at t = 1 s. Try again."
    assert problems["after bad"] == "needs bad" and not (tmp_path / "after bad").exists()
    assert (tmp_path / "logs" / "bad.log").read_text().startswith("a line before")


def test_a_signal_stops_all_processes_and_lets_them_leave_checkpoints(piece, tmp_path):
    """SIGINT is passed on once, the processes end by themselves, nothing new is begun."""
    with pytest.raises(Stopped) as stop:
        Pool(1, tmp_path / "logs", Interrupting(disable=True)).do([piece("long", wait_for_signal), piece("next")])
    assert stop.value.number == signal.SIGINT
    assert (tmp_path / "long").read_text() == "checkpoint" and not (tmp_path / "next").exists()
