"""`jaxdem new`: what it writes is the scene of its name, with every key explained, and passes `jaxdem check`."""

import errno
import io
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import jaxdem
from jaxdem.check.check import check_scene
from jaxdem.cli.main import app
from jaxdem.scene.commented import NAMES, SCENES


def new(*arguments):
    return CliRunner().invoke(app, ["new", *map(str, arguments)])


@pytest.mark.parametrize("name", NAMES)
def test_a_commented_scene(name, tmp_path):
    out = tmp_path / "scene.toml"
    assert new(name, "--out", out).exit_code == 0
    scene = jaxdem.load_scene(out)
    assert scene == jaxdem.load_scene(SCENES / f"{name}.toml")
    lines = out.read_text(encoding="utf-8").splitlines()
    keys = [n for n, line in enumerate(lines) if re.match(r"\w+ *=", line)]
    assert keys and all(lines[n - 1].startswith("# ") for n in keys)
    assert max(map(len, lines)) <= 130
    assert check_scene(scene)


def test_what_is_refused(tmp_path):
    out = tmp_path / "scene.toml"
    out.write_text("mine", encoding="utf-8")
    refused = new("bed", "--out", out)
    assert refused.exit_code == 2 and "exists already" in refused.stderr and out.read_text() == "mine"
    wrong = new("hoper")
    assert wrong.exit_code == 2 and "Did you mean hopper?" in wrong.stderr


def test_a_full_disk_leaves_no_half_of_a_scene(tmp_path, monkeypatch):
    """The next try would be told that the file exists."""
    out = tmp_path / "scene.toml"

    class Full(io.StringIO):
        def write(self, text):
            raise OSError(errno.ENOSPC, "No space left on device")

    def opened(path, *_, **__):
        path.touch()
        return Full()

    monkeypatch.setattr(Path, "open", opened)
    failed = new("bed", "--out", out)
    assert failed.exit_code == 1 and f"{out}: No space left" in failed.stderr and not out.exists()


def test_jax_is_not_imported():
    code = "import sys; from jaxdem.scene.commented import beginning; beginning('bed'); sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
