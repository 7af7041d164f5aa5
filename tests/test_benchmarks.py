"""Benchmarks that other programs take part in: one that fails loses nothing of what was measured."""

import argparse
import json
import subprocess
import sys

import numpy as np
import pytest

from benchmarks import against, contact, harness

WORDS = "ERROR: Unrecognized pair style 'granular' is part of the GRANULAR package"
SAYS = f"print('LAMMPS (22 Jul 2025)'); print({WORDS!r}); exit(1)"


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
            "list builds": [0.1, 0.2],
        }

    contenders = {"good": (good, "python"), "peer": (fails, "python"), "absent": (good, "no-such-program")}
    result = contact.measure(contenders, argparse.Namespace(steps=100))
    table = (tmp_path / "contact.md").read_text()
    assert table.count(f"| failed: {WORDS} |") == 2
    assert "GRANULAR package" in result["peer, 2"]["failed"] and "| absent | 1 | not installed |" in table
    assert result["good, 1"]["million_particle_steps_per_second"]["highest"] == contact.COUNT * 100 / 0.4 / 1e6
    assert "| good | 2 | 4.50 (4.00-5.00) | 3 | 22% (20%-25%) | 15% (10%-20%) |" in table


def test_the_reason_of_a_program_without_words():
    assert harness.reason_of(OSError("no memory")) == "OSError: no memory"
    silent = subprocess.CalledProcessError(3, ["lmp"], output="", stderr="")
    assert "exit status 3" in harness.reason_of(silent)
    assert harness.reason_of(subprocess.CalledProcessError(1, ["lmp"], output="a\nb | c\n", stderr=None)) == "b / c"


def test_a_study_saves_each_row_when_it_is_there(tmp_path, monkeypatch):
    """Every value with every pack, in a folder of its own; the table is written by the format strings."""
    monkeypatch.setattr(harness, "RESULTS", tmp_path / "results")

    def run_of(value, seed, folder):
        if value == 2.0 and seed == 1:
            kept = json.loads((tmp_path / "results" / "toy.json").read_text())
            assert [row["seed"] for row in kept["rows"]] == [0, 1, 0] and kept["mean"] == pytest.approx(0.5 / 3.0)
        assert folder == tmp_path / f"{value:g}_{seed}"
        return {"flux": value * seed}

    columns = {"value": "{value:.1f}", "pack": "{seed}", "flux": "{flux:.2f}"}

    def mean(rows):
        return {"mean": sum(row["flux"] for row in rows) / len(rows)}

    study = harness.Study("toy", "value", (0.5, 2.0), run_of, columns, mean)
    rows = study.run(study.arguments("").parse_args(["--runs", str(tmp_path)]))
    assert [row["flux"] for row in rows] == [0.0, 0.5, 0.0, 2.0]
    assert (tmp_path / "results" / "toy.md").read_text().startswith(study.table(rows))
    assert study.table(rows).splitlines()[-1] == "| 2.0 | 1 | 2.00 |"


def test_standard_error_is_that_of_the_means_of_equal_parts():
    """Parts with means 1, 2, 3, 4, 5: standard deviation sqrt(2.5), over sqrt(5); what is within a part is not seen."""
    values = np.repeat([1.0, 2.0, 3.0, 4.0, 5.0], 4) + np.tile([-1.0, 1.0], 10)
    assert harness.standard_error(values) == pytest.approx(np.sqrt(0.5))


WORKER = """
import json, pathlib, sys
log, half = pathlib.Path({log!r}), pathlib.Path.cwd().name == "other"
print("a line of the program's own")
print(json.dumps("ready"), flush=True)
for _ in sys.stdin:
    with log.open("a") as file:
        file.write("there " if half else "here ")
    print(json.dumps({{"seconds": 1.0 if half else 0.5}}), flush=True)
"""


def test_two_checkouts_take_turns(tmp_path, monkeypatch):
    """Windows of each in its own folder, who begins in turn; the ratio of a pair is the speed here over that there."""
    log, other = tmp_path / "log", tmp_path / "other"
    other.mkdir()
    (tmp_path / "worker.py").write_text(WORKER.format(log=str(log)))
    monkeypatch.setattr(harness, "RESULTS", tmp_path)
    monkeypatch.setattr(against, "WORKER", tmp_path / "worker.py")
    result = against.compare("contact", [against.Work("pile", tmp_path / "pile.toml", intervals=3)], other, pairs=3)
    assert log.read_text().split() == ["here", "there", "there", "here", "here", "there"]
    assert result["pile, 1"]["speed_ratio"] == {"median": 2.0, "lowest": 2.0, "highest": 2.0, "repetitions": 3}
    assert "| pile | 1 | 0.5 | 1 | 2.00 (2.00-2.00) | 3 |" in (tmp_path / "contact_against.md").read_text()
