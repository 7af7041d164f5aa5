"""Strict settings for all tests: float64 unless a test asks for less, no silent rank promotion; programs kept on
disk."""

import ctypes
import gc
import os
import sys
from importlib.metadata import version
from pathlib import Path

# Most of a test is compiling: with XLA's older emitters it takes half as long, and what it gives is a fifth slower.
# Two passes over loops and the division of a program for several compiling threads are a quarter of what is left, and
# XLA's own check of what its passes leave is a tenth.
# Programs as users have them: XLA_FLAGS= make test; tests/physics/test_shipped_program.py, of the second tier, compares
# the two.
# jaxlib 0.11 has no older emitters, and ends a process that asks for them.
if tuple(map(int, version("jaxlib").split(".")[:2])) < (0, 11):
    os.environ.setdefault(
        "XLA_FLAGS",
        "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1 "
        "--xla_disable_hlo_passes=while-loop-invariant-code-motion,simplify-while-loops,hlo-verifier",
    )
# Four devices of the host, for scenes that are cut into blocks; all else runs on the first.
if "device_count" not in os.environ.get("XLA_FLAGS", ""):
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=4".strip()
# They may have to wait for each other: a busy machine gives a thread no core for longer than the 40 s after which XLA
# would end the process.
if "terminate_timeout" not in os.environ["XLA_FLAGS"]:
    os.environ["XLA_FLAGS"] += " --xla_cpu_collective_call_terminate_timeout_seconds=600"
# LLVM's optimisations are a third to a half of what is left; without them most runs of tests are too short to lose it
# again. Tests with longer runs have the mark `long_runs`.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
# Without the lines of source in a program, which only messages of compilers show, tracing to running it takes a twelfth
# less.
os.environ.setdefault("JAX_TRACEBACK_IN_LOCATIONS_LIMIT", "0")
# What one test has compiled others, other processes and later runs take from here: set
# before JAX is imported, and in the environment, for the tests that start the command line.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path(__file__).parents[1] / "build" / "xla"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")

import jax
import pytest

# Tracing makes objects by the million, nearly all of which are kept: looking through them is a third of the time that
# it takes.
gc.set_threshold(100_000, 50, 50)
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")

sys.path.insert(0, str(Path(__file__).parent))

from figure_texts import watched  # noqa: E402

from jaxdem.particles.neighbor_search import listing  # noqa: E402
from jaxdem.run import exported  # noqa: E402
from tests.cases.steps import compiled_step  # noqa: E402
from tests.cases.worlds import runner  # noqa: E402

DEAREST_FIRST = (
    "devices",
    "train",
    "test_start_of_parcels",
    "test_study",
    "gradients",
    "test_shipped_program",
    "test_kill",
)
"""Parts of names of files with few tests that take long: with them at the end one process would work alone."""


def pytest_collection_modifyitems(items):
    """Files are handed to the processes in this order (`--no-loadscope-reorder`)."""
    items.sort(key=lambda item: not any(name in item.nodeid.split("::")[0] for name in DEAREST_FIRST))


MOST_MEMORY = 1.5e9
"""Of a process, at the end of a file, above which it drops its compiled programs [B]."""


def resident_memory():
    """Memory that this process holds [B]; 0 where the system does not tell."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


@pytest.fixture(scope="module", autouse=True)
def memory_given_back():
    """A program holds a megabyte or more, and a process compiles thousands; most are of use to one file alone.

    What is dropped lies on disk. The C library keeps what is freed until it is told to give it back.
    """
    yield
    if resident_memory() > MOST_MEMORY:
        jax.clear_caches()
        gc.collect()
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)


@pytest.fixture(autouse=True)
def figure_names():
    """Every figure that a test saves is read as drawn. Names of runs and files that look like markup go into this
    list."""
    names = []
    with watched(names) as found:
        yield names
    assert not found, "\n".join(dict.fromkeys(found))


@pytest.fixture
def host_patch():
    """`monkeypatch` for what no compiled program has in it, such as steps of the time loop: the programs are kept."""
    with pytest.MonkeyPatch.context() as patch:
        yield patch


@pytest.fixture(autouse=True)
def own_programs(request):
    """A test that replaces code compiles its own programs of small worlds and runs, and leaves none to others.

    What it replaces may be in them, unless it takes `host_patch`.
    """
    if "monkeypatch" not in request.fixturenames:
        yield
        return
    programs = (runner, compiled_step, exported.in_memory, listing)
    for kept in programs:
        kept.cache_clear()
    yield
    for kept in programs:
        kept.cache_clear()


@pytest.fixture(autouse=True)
def no_traced_programs_kept():
    """The command line keeps what it traces; a test that replaces code must not find what another has traced."""
    yield
    exported.keep_in(None)


@pytest.fixture(autouse=True)
def optimized_where_runs_are_long(request):
    """Programs of a test that is marked `long_runs` are optimized as users have them."""
    before = jax.config.read("jax_disable_most_optimizations")
    if request.node.get_closest_marker("long_runs"):
        jax.config.update("jax_disable_most_optimizations", False)
    yield
    jax.config.update("jax_disable_most_optimizations", before)
