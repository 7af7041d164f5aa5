"""Cases for OpenFOAM (`apt-get install openfoam`), and how its programs are started."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks import harness

SETTINGS = Path("/usr/share/openfoam/etc/bashrc")
"""Where the Debian package keeps the environment that the programs need."""
HEAD = "FoamFile {{ version 2.0; format ascii; class {kind}; object {name}; }}\n"


def installed(program: str) -> bool:
    """Whether the solver and the mesher are there."""
    return all(map(shutil.which, (program, "blockMesh")))


def command(program: str) -> list[str]:
    """A program in the environment that it needs, on one core."""
    return harness.pinned(1, ["bash", "-c", f". {SETTINGS} >/dev/null 2>&1; exec {program}"])


def lines_of(program: str, folder: str) -> Iterator[str]:
    """What a solver prints while it runs the case in a folder, line by line, after its mesh is made."""
    subprocess.run(command("blockMesh"), check=True, stdout=subprocess.DEVNULL, cwd=folder)
    with subprocess.Popen(command(program), stdout=subprocess.PIPE, text=True, cwd=folder) as running:
        assert running.stdout is not None
        yield from running.stdout
    assert running.returncode == 0, f"{program} ended with {running.returncode}"


def write_case(folder: Path, files: dict[str, str], values: dict[str, Any], kinds: dict[str, str]) -> None:
    """Writes the files of a case, templates by their place, with the values filled in.

    Args:
        folder: of the case.
        files: text of each file without its head, braces doubled.
        values: what is filled in.
        kinds: class of a file, where it is not "dictionary".
    """
    for place, text in files.items():
        path = folder / place
        path.parent.mkdir(exist_ok=True)
        head = HEAD.format(kind=kinds.get(place, "dictionary"), name=path.name)
        path.write_text(head + text.format(**values))
