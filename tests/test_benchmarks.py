"""Benchmarks that other programs take part in: one that fails loses nothing of what was measured."""

import argparse
import json
import subprocess
import sys

from benchmarks import contact, harness

SAYS = "print('LAMMPS (22 Jul 2025)'); print(\"ERROR: Unrecognized pair style 'granular' is part of the GRANULAR package\"); exit(1)"


def test_a_peer_that_fails_has_a_row_with_the_reason(tmp_path, monkeypatch):
    """What was measured before it and after it is in the files, and at the time of the failure already."""
    monkeypatch.setattr(harness, "RESULTS", tmp_path)
    written = []

    def fails(cores, arguments):
        if written:
            assert "good, 1" in json.loads((tmp_path / "contact.json").read_text())
        return contact.timed_runs([sys.executable, "-c", SAYS], cores, str(tmp_path))

    def good(cores, arguments):
        written.append(cores)
        return {
            "seconds": [0.5, 0.4],
            "builds": [3, 4],
            "without_search": {"seconds": [0.4, 0.3]},
            "lists": [0.2, 0.25],
        }

    contenders = {"good": (good, "python"), "peer": (fails, "python"), "absent": (good, "no-such-program")}
    result = contact.measure(contenders, argparse.Namespace(steps=100))
    table = (tmp_path / "contact.md").read_text()
    assert table.count("| failed: ERROR: Unrecognized pair style 'granular' is part of the GRANULAR package |") == 2
    assert "GRANULAR package" in result["peer, 2"]["failed"] and "| absent | 1 | not installed |" in table
    assert result["good, 1"]["million_particle_steps_per_second"]["highest"] == contact.COUNT * 100 / 0.4 / 1e6
    assert "| good | 2 | 4.50 (4.00-5.00) | 3 | 22% (20%-25%) |" in table


def test_the_reason_of_a_program_without_words():
    assert harness.reason_of(OSError("no memory")) == "OSError: no memory"
    silent = subprocess.CalledProcessError(3, ["lmp"], output="", stderr="")
    assert "exit status 3" in harness.reason_of(silent)
    assert harness.reason_of(subprocess.CalledProcessError(1, ["lmp"], output="a\nb | c\n", stderr=None)) == "b / c"
