"""The import law of the design, read from the source: who may know whom; and that public things are described."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import jaxdem

PACKAGE = Path(jaxdem.__file__).parent
MODULES = {
    ".".join(("jaxdem", *path.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__"): path
    for path in sorted(PACKAGE.rglob("*.py"))
}

FLOORS = (
    {"errors", "version", "numerics"},
    {"files", "metrics", "mixing"},
    {"particles", "fluid", "closures", "solids", "io"},
    {"coupling", "particle_files"},
    {"scalars"},
    {"state"},
    {"structure"},
    {"scalar_step", "particle_step"},
    {"step", "failures", "observables"},
    {"simulation", "probes"},
    {"devices", "ensemble", "external", "scene"},
    {"setup"},
    {"run"},
    {"check", "foreign", "train", "report"},
    {"study"},
    {"cli"},
    {"jaxdem", "__main__"},
)
"""The house, from the ground up: a room imports rooms of lower floors and none of its own or of higher ones, also
inside functions and for the type checker."""

WITHOUT_SCENE = {
    "particles",
    "fluid",
    "closures",
    "solids",
    "coupling",
    "scalars",
    "scalar_step",
    "particle_step",
    "state",
    "structure",
    "step",
    "failures",
    "simulation",
    "observables",
    "probes",
    "external",
    "devices",
    "io",
    "report",
}
"""Rooms that work on arrays, objects and files, and never see the description of a scene."""

TERMINAL = {"typer", "rich"}
PUBLIC = {"errors", "files", "io", "metrics", "solids"}
"""What `report` may use: files, metrics, and where moving walls are."""


def part(module):
    """The first name below jaxdem: `jaxdem.fluid.grid` -> `fluid`."""
    names = module.split(".")
    return names[1] if len(names) > 1 else "jaxdem"


def imported(path):
    """Every module of an import in a file, functions and what is for the type checker included."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            # `from jaxdem import step` names a module where there is one.
            for alias in node.names:
                deeper = f"{node.module}.{alias.name}"
                yield deeper if deeper in MODULES else str(node.module)


@cache
def imports():
    """Of every module those of jaxdem that it imports; once, and not where tests are only collected."""
    return {
        module: {name for name in imported(path) if name.split(".")[0] == "jaxdem"} for module, path in MODULES.items()
    }


FLOOR = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}


def rooms_imported(module):
    return {part(name) for name in imports()[module]} - {part(module)}


def test_every_room_has_a_floor():
    assert {part(module) for module in MODULES} == set(FLOOR)


def test_imports_go_down():
    """So there is no circle among rooms; within a room see below."""
    climbing = {
        module: rooms
        for module in MODULES
        if part(module) != "jaxdem"
        and (rooms := {room for room in rooms_imported(module) if FLOOR[room] >= FLOOR[part(module)]})
    }
    assert not climbing


def test_rooms_without_the_description_of_a_scene():
    for module in MODULES:
        if part(module) in WITHOUT_SCENE:
            assert "scene" not in rooms_imported(module), module


def test_coupling_knows_particles_fluid_and_closures_and_nothing_else_of_physics():
    for module in MODULES:
        if part(module) == "coupling":
            assert rooms_imported(module) <= {"particles", "fluid", "closures", "solids", "numerics", "errors"}, module


def test_report_uses_files_metrics_and_motions_only():
    for module in MODULES:
        if part(module) == "report":
            assert rooms_imported(module) <= PUBLIC, module


def test_the_terminals_libraries_stay_with_the_command_line():
    """A solver that is imported into another program draws nothing."""
    free = {"cli", "report", "study"}
    for module, path in MODULES.items():
        if part(module) not in free:
            roots = {name.split(".")[0] for name in imported(path)}
            assert not roots & TERMINAL, module


def test_there_is_no_circle_of_modules():
    """Also none behind an import inside a function or for the type checker."""
    done, path = set(), []

    def visit(module):
        assert module not in path, " -> ".join([*path, module])
        if module in done:
            return
        path.append(module)
        for name in sorted(imports()[module] & set(MODULES) - {"jaxdem"}):
            if not module.startswith(name + "."):  # a package runs its __init__ before its modules
                visit(name)
        path.pop()
        done.add(module)

    for module in sorted(set(MODULES) - {"jaxdem"}):
        visit(module)


def test_every_module_of_setup_is_in_the_table_of_the_architecture():
    page = (PACKAGE.parent / "docs" / "architecture.md").read_text()
    table = page.partition("## From a scene to its parts")[2].partition("\n## ")[0]
    there = {path.stem for name, path in MODULES.items() if name.startswith("jaxdem.setup.")}
    named = set(re.findall(r"`([a-z_]+)`", table))
    assert there - named == set(), "name it beside the modules of its subject"
    assert {name for name in named - there if not hasattr(jaxdem, name)} <= {"build_case"}


def test_public_functions_and_classes_say_what_they_are():
    for module, path in MODULES.items():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        public = [
            node
            for node in tree.body
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")
        ]
        if tree.body:
            assert ast.get_docstring(tree), f"{module} has no docstring"
        lacking = [node.name for node in public if not ast.get_docstring(node)]
        assert not lacking, f"{module}: {lacking}"


def test_the_public_names_exist():
    lacking = [name for name in jaxdem.__all__ if not getattr(jaxdem, name).__doc__]
    assert not lacking
