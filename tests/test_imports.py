"""The import law of the design, read from the source: who may know whom; and that public things are described."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import jaxdem

PACKAGE = Path(jaxdem.__file__).parent
MODULES = {
    ".".join(("jaxdem", *path.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__"): path
    for path in sorted(PACKAGE.rglob("*.py"))
}

HOST = {
    "build",
    "arrivals",
    "bodies",
    "boundaries",
    "initial",
    "magnitudes",
    "time_steps",
    "simulate",
    "records",
    "check",
    "cautions",
    "engineering",
    "unit_warnings",
    "study",
    "studies",
    "sweep",
    "cli",
    "cli_networks",
    "cli_options",
    "train",
    "report",
    "io",
}
"""Modules and packages of the host side, at or above `build`: they may know the description of a scene.

Everything else is below `build` and gets arrays and instances. Of these, `io` and `report` know the scene as
TOML text only and do not import it today; `restart`, `rollout`, `profile`, `failures`, `step` and `state`
work on what `build` made.
"""

BELOW_BUILD = {
    "particles",
    "fluid",
    "coupling",
    "closures",
    "state",
    "stability",
    "errors",
    "files",
    "hdf5",
    "hdf5_contents",
    "metrics",
    "products",
}
"""What `build` puts together: none of it may import `build` or anything above it."""

LEAVES = {"errors", "files", "hdf5_contents", "products"}
"""Of these, what all may import and what imports nothing of the package itself."""

COMMANDS = {"cli", "cli_networks", "cli_options"}
"""The command line."""

SHOWN = {"terminal", "check_table", "console", "progress", "process"}
"""What only the command line uses: what it shows, and how its process ends."""

TERMINAL = {"typer", "rich"}
PUBLIC = {
    "jaxdem",
    "errors",
    "scene",
    "build",
    "simulation",
    "io",
    "simulate",
    "rollout",
    "metrics",
    "closures",
}
"""What `report` may use: public names, files, and metrics."""


def part(module):
    """The first name below jaxdem: `jaxdem.fluid.grid` -> `fluid`."""
    names = module.split(".")
    return names[1] if len(names) > 1 else "jaxdem"


def imported(path, module):
    """(module, only for the type checker) of every import of jaxdem in a file, functions included."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    typing_only = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            # `from jaxdem import step` names a module where there is one.
            names = [
                deeper if (deeper := f"{node.module}.{alias.name}") in MODULES else str(node.module)
                for alias in node.names
            ]
        else:
            continue
        for name in names:
            yield name, id(node) in typing_only


IMPORTS = {
    module: [found for found in imported(path, module) if found[0].split(".")[0] == "jaxdem"]
    for module, path in MODULES.items()
}


def parts_imported(module, with_typing=True):
    return {part(name) for name, typing_only in IMPORTS[module] if with_typing or not typing_only}


@pytest.mark.parametrize("package", ["particles", "fluid", "closures"])
def test_particles_fluid_and_closures_know_nothing_of_each_other(package):
    allowed = {package, *LEAVES} | ({"hdf5"} if package == "closures" else set())  # its files
    for module in MODULES:
        if part(module) == package:
            strange = parts_imported(module) - allowed
            assert not strange, f"{module} imports {strange}"


def test_coupling_knows_these_three_and_nothing_else():
    allowed = {"coupling", "particles", "fluid", "closures", *LEAVES}
    for module in MODULES:
        if part(module) == "coupling":
            assert parts_imported(module) <= allowed, module


def test_leaves_know_nothing_of_the_package():
    for leaf in LEAVES:
        assert not parts_imported(f"jaxdem.{leaf}")


def test_nothing_below_build_imports_build_or_above():
    for module in MODULES:
        if part(module) in BELOW_BUILD:
            assert parts_imported(module) <= BELOW_BUILD, module


def test_only_the_host_side_imports_scene():
    for module in MODULES:
        if "scene" in parts_imported(module):
            assert part(module) in HOST | {"jaxdem"}, module


def test_nothing_imports_the_command_line():
    for module in MODULES:
        if part(module) not in COMMANDS | {"__main__"}:
            assert not parts_imported(module) & COMMANDS, module


def test_only_the_command_line_imports_what_it_shows():
    for module in MODULES:
        if part(module) not in COMMANDS | SHOWN | {"__main__"}:
            assert not parts_imported(module) & SHOWN, module


def test_report_uses_the_public_names_and_files_only():
    for module in MODULES:
        if part(module) == "report":
            assert parts_imported(module) <= PUBLIC | {"report"}, module


def test_training_does_not_reach_into_the_time_loop():
    """`train` takes files and `build`; of the solver it uses the fields and weights that a coarse run would."""
    above = {"report", "study", "studies", "cli", "terminal", "check", "records", "restart", "profile"}
    for module in MODULES:
        if part(module) == "train":
            assert not parts_imported(module) & above, module
        if part(module) in BELOW_BUILD | {"build", "simulate", "io", "report"}:
            assert "train" not in parts_imported(module), module


def test_the_terminals_libraries_stay_with_the_command_line():
    """A solver that is imported into another program draws nothing."""
    free = COMMANDS | SHOWN | {"report", "study", "studies"}
    for module, path in MODULES.items():
        if part(module) not in free:
            roots = {name.split(".")[0] for name, _ in imported(path, module)}
            assert not roots & TERMINAL, module


def test_there_is_no_circle_of_imports_at_run_time():
    graph = {
        module: {name for name, typing_only in IMPORTS[module] if not typing_only and name in MODULES}
        for module in MODULES
        if module != "jaxdem"
    }
    at_top = {module: {n for n in names if n in top_level(module)} for module, names in graph.items()}
    done, path = set(), []

    def visit(module):
        assert module not in path, " -> ".join([*path, module])
        if module in done or module not in at_top:
            return
        path.append(module)
        for name in at_top[module]:
            if not module.startswith(name + "."):  # a package runs its __init__ before its modules
                visit(name)
        path.pop()
        done.add(module)

    for module in at_top:
        visit(module)


def top_level(module):
    """Modules imported while a module is loaded, not inside its functions."""
    tree = ast.parse(MODULES[module].read_text(encoding="utf-8"))
    names = set()
    for node in tree.body:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


@pytest.mark.parametrize("module", MODULES)
def test_public_functions_and_classes_say_what_they_are(module):
    tree = ast.parse(MODULES[module].read_text(encoding="utf-8"))
    if tree.body:
        assert ast.get_docstring(tree), f"{module} has no docstring"
    public = [
        node
        for node in tree.body
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")
    ]
    lacking = [node.name for node in public if not ast.get_docstring(node)]
    assert not lacking, f"{module}: {lacking}"


@pytest.mark.parametrize("name", jaxdem.__all__)
def test_the_public_names_exist(name):
    assert getattr(jaxdem, name).__doc__
