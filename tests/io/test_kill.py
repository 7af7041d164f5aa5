"""Real deaths: SIGKILL between and inside writes, and a disk that takes no more."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from deaths import check
from made_frames import SCENE_2D

from jaxdem.io import RunDirectory

DEATHS = Path(__file__).parent / "deaths.py"
PLACES = ("frame", "history", "checkpoint", "join")


def deaths(*arguments):
    command = [sys.executable, str(DEATHS), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def test_twenty_kills_at_random_moments_and_inside_writes_lose_nothing(tmp_path):
    done = deaths("kills", tmp_path / "run", 5, 20)
    assert done.returncode == 0, done.stdout + done.stderr
    survived, reached = map(int, done.stdout.split()[-2:])
    assert survived == 20
    assert reached >= 10, "the run went on in spite of them"


@pytest.fixture(scope="module")
def full_disks(tmp_path_factory):
    folder = tmp_path_factory.mktemp("full")
    return folder, deaths("full", folder, *PLACES)


@pytest.mark.parametrize("where", PLACES)
def test_a_full_disk_is_a_message_and_earlier_frames_stay(full_disks, where):
    folder, done = full_disks
    path = folder / where
    assert done.stderr == ""
    assert f"{where} 11\n" in done.stdout, "a run that failed, exit code 1"
    (message,) = [line for line in done.stdout.splitlines() if str(path) in line]
    assert "cannot write" in message and "--resume" in message
    assert not list(path.glob(".*.tmp")) and not list(path.glob(".frames/.*.tmp"))
    assert check(path) == 5
    history = (path / "history.csv").read_text()
    assert history.count("\n") == 6 and history.endswith("\n")
    with RunDirectory.resume(path, SCENE_2D) as run:
        run.cut_back(5, 5)
        run.finish({"valid": True})
    assert check(path) == 5
