"""The process of the command line: what it loads before it refuses, its signals, its streams, and what it shows."""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
import time
import tomllib
import types
from pathlib import Path

import jax
import pytest

import jaxdem
from jaxdem.cli import progress
from jaxdem.errors import InputError, visible
from jaxdem.run.signals import Stopped, noted_signals

ROOT = Path(__file__).parents[1]
SCENE = ROOT / "scenes" / "settling.toml"
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT)}


def python(code, *arguments, **options):
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, timeout=120, check=False, **options)


def command(*arguments, **options):
    environment = ENVIRONMENT | options.pop("environment", {})
    line = [sys.executable, "-m", "jaxdem", *map(str, arguments)]
    return subprocess.run(line, env=environment, capture_output=True, text=True, timeout=120, check=False, **options)


def test_help_and_version_load_nothing_that_takes_time():
    done = python(
        "import sys\n"
        "from jaxdem.cli.main import app\n"
        "for word in ('--help', '--version'):\n"
        "    try: app([word])\n"
        "    except SystemExit as end: assert not end.code\n"
        "print({'jax', 'numpy', 'pydantic', 'rich', 'h5py', 'matplotlib'} & set(sys.modules))"
    )
    assert done.stdout.splitlines()[-1] == "set()", done.stdout + done.stderr


REFUSALS = """
import contextlib, io, sys
from pathlib import Path
from jaxdem.cli.main import app
scene, folder, long = sys.argv[1], Path(sys.argv[2]), "a" * 5000
(folder / "full").mkdir()
(folder / "full" / "letter.txt").write_text("dear")
full, text = str(folder / "full"), str(folder / "full" / "letter.txt")
new, closure = str(folder / "new"), str(Path(scene).parent / "filtered.closure.h5")
many = "coupling.drag=" + "\\u65e5" * 3000
for arguments in (
    ["check", scene, "--set", "time.ned=1"],
    ["check", scene, "--set", ".".join("a" * 2000) + "=1"],
    ["run", scene, "--out", full],
    ["run", scene, "--out", long],
    ["run", scene, "--out", new, "--resume"],
    ["run", scene, "--out", new, "--closure", text],
    ["run", scene, "--out", new, "--closure", new],
    ["run", scene, "--out", new, "--subgrid", new],
    ["dataset", full, "--out", new],
    ["dataset", full, "--out", long],
    ["train", text, "--out", new],
    ["train", text, "--out", long],
    ["distill", text, text, "--out", new],
    ["prune", closure, text, "--out", new],
    ["finetune", scene, "--reference", full, "--closure", closure, "--out", new],
    ["finetune", scene, "--reference", full, "--out", new],
    ["export", text, "--format", "c", "--out", new],
    ["compare", full, full, "--out", new],
    ["plot", full],
    ["animate", full, "--out", new],
    ["sweep", scene, "--vary", "fluid.viscosity=1e-3", "--out", full],
    ["sweep", scene, "--vary", "fluid.viscosity=1e-3", "--out", long],
    ["sweep", scene, "--vary", many + "," + many, "--out", new],
    ["study", "flying", "--out", new],
    ["scene", "contact.frction"],
    ["study", "injection", "--out", long],
):
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
        try: app(arguments)
        except SystemExit as end: code = end.code
    assert code == 2 and "jaxdem: " in said.getvalue(), (arguments, code, said.getvalue())
    assert "jax" not in sys.modules and "matplotlib" not in sys.modules, arguments
assert [path.name for path in folder.iterdir()] == ["full"], "nothing is left of what was refused"
print("refused")
"""


def test_what_can_be_refused_without_jax_is(tmp_path):
    done = python(REFUSALS, SCENE, tmp_path)
    assert done.stdout.strip() == "refused", done.stderr


def test_public_names_are_no_modules():
    """Python would set `jaxdem.simulate` to a module of that name when it is loaded."""
    for name in jaxdem.__all__:
        assert not isinstance(getattr(jaxdem, name), types.ModuleType)
        assert importlib.util.find_spec(f"jaxdem.{name}") is None
    assert set(jaxdem.__all__) <= set(dir(jaxdem))
    with pytest.raises(AttributeError, match="flying"):
        jaxdem.flying  # noqa: B018


def test_an_editable_install_has_no_import_hook():
    """Hooks are asked last: a checkout called jaxdem in the working directory would be an empty package before."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert project["tool"]["setuptools"]["package-dir"] == {"": "."}


WORD_THEN_WORK = """
import hashlib
from jaxdem.cli import process
def work():
    print("at work", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 2**31 - 1)  # minutes, outside Python
process.run(work)
"""


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_the_process_though_it_is_outside_python(number, code):
    process = subprocess.Popen(
        [sys.executable, "-c", WORD_THEN_WORK],
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "at work\n"
    process.send_signal(number)
    assert process.communicate(timeout=30)[1] == ""
    assert process.returncode == code


def test_a_signal_gives_up_what_is_compiled():
    begin = time.monotonic()
    for number in (signal.SIGINT, signal.SIGTERM):
        with noted_signals() as caught:
            with pytest.raises(Stopped), caught.raised():
                caught.wait_for(lambda number=number: (signal.raise_signal(number), time.sleep(60)))
            assert caught == [number]
            with pytest.raises(Stopped), caught.raised():
                raise AssertionError("a signal that came before counts too")
    assert time.monotonic() - begin < 30
    with pytest.raises(ZeroDivisionError), noted_signals() as caught, caught.raised():
        caught.wait_for(lambda: 1 / 0)


def test_a_reader_that_has_gone_and_streams_that_are_closed():
    """As `| head`, and `>&-`: no traceback; what a shell calls a broken pipe, and success."""
    reader, writer = os.pipe()
    os.close(reader)
    line = [sys.executable, "-m", "jaxdem", "--help"]
    done = subprocess.run(line, env=ENVIRONMENT, stdout=writer, stderr=subprocess.PIPE, text=True)
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, "")
    shell = subprocess.run(["sh", "-c", '"$@" >&-', "sh", *line], env=ENVIRONMENT, capture_output=True)
    assert (shell.returncode, shell.stderr) == (0, b"")


def test_a_device_that_is_not_there():
    there = {device.platform for device in jax.devices()}
    platform = "bogus" if "gpu" in there else "cuda"
    done = command("check", SCENE, environment={"JAX_PLATFORMS": platform})
    assert done.returncode == 2 and not done.stdout
    (message,) = done.stderr.splitlines()
    assert f"JAX_PLATFORMS = '{platform}'" in message and "Available: " in message


def test_an_address_space_that_is_too_small():
    line = ["sh", "-c", 'ulimit -v 1048576; exec "$@"', "sh", sys.executable, "-m", "jaxdem", "check", SCENE]
    done = subprocess.run(line, env=ENVIRONMENT, capture_output=True, text=True)
    assert done.returncode == 2 and not done.stdout
    (message,) = done.stderr.splitlines()
    assert "ulimit -v" in message and "1 GiB" in message


def test_what_does_not_print_is_shown_as_an_escape():
    text = "a\x1b[31m \x9b\u202e\udc80\t\n\xa0ü日"
    assert visible(text) == "a\\x1b[31m \\x9b\\u202e\\udc80\\t\n\xa0ü日"
    assert visible(visible(text)) == visible(text)
    error = InputError("a\x1b\nb", "\x1b", "limit \x1b", "remedy \x07")
    assert str(error) == "a\\x1b\\nb = '\\x1b': limit \\x1b. Remedy \\x07"


def test_a_log_has_a_line_a_minute(monkeypatch, capsys):
    """On a busy machine lines come late: it is waited for seven of them."""
    assert progress.PAUSE == 60.0
    monkeypatch.setattr(progress, "PAUSE", 0.02)
    for quiet in (False, True):
        written, until = "", time.monotonic() + (0.3 if quiet else 30.0)
        with progress.simulated_time(quiet) as report:
            time.sleep(0.1)
            report(0.5, 2.0)
            time.sleep(0.05)
            report(1.0, 2.0)
            while time.monotonic() < until and not ("t = 1 " in written and written.count("\n") > 6):
                time.sleep(0.02)
                shown = capsys.readouterr()
                assert not shown.out, "standard output is for results"
                written += shown.err
        lines = written.splitlines()
        if quiet:
            assert not lines
        else:
            assert lines[0] == "jaxdem: preparing and compiling"
            assert lines[-1].startswith("jaxdem: t = 1 of 2 s, ") and lines[-1].endswith(" left")
            assert len(lines) > 6, "the pause stays the same"


def test_the_time_left_is_that_of_the_last_minute_without_what_was_compiled_in_it(monkeypatch):
    """Ten seconds of simulated time a second; then two minutes are compiled, and then it goes half as fast."""
    now = [0.0]
    monkeypatch.setattr(progress.clock, "monotonic", lambda: now[0])
    pace = progress.Pace("s")

    def after(seconds, done, end=1000.0):
        now[0] += seconds
        pace.report(done, end)
        return pace.text()

    assert after(30.0, 10.0) == "", "what came before the first report is no part of it"
    assert after(1.0, 20.0) == "10 s/s  0:01:38 left"
    assert after(120.0, 20.0) == ""
    assert after(1.0, 25.0) == "5 s/s  0:03:15 left"
    assert after(100.0, 825.0).startswith("8") and after(61.0, 886.0).startswith("1 s/s")
    assert after(1.0, 3.0, 50.0) == "" and after(1.0, 4.0, 50.0) == "1 s/s  0:00:46 left", "another stage"
    assert after(1.0, 50.0, 50.0) == ""
