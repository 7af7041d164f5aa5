"""What `jaxdem check --devices` says."""

import jax
import numpy as np
import pytest
from jax.sharding import AbstractMesh, PartitionSpec

import jaxdem
from jaxdem.check import over_devices
from jaxdem.check.check import check_scene
from jaxdem.check.walls_in_fluid import sent_by
from jaxdem.cli.check_table import _devices as render_devices
from jaxdem.cli.check_table import render
from jaxdem.errors import InputError
from jaxdem.fluid.boundary import Boundary, Side
from jaxdem.fluid.mesh import Grid
from jaxdem.fluid.multigrid import STEPS, multigrid
from jaxdem.numerics.blocks import Blocks
from tests.cases.fluid_slabs import fluid_scene
from tests.cases.slabs_beside_walls import CYLINDER, SLIDING


def scene_of(**changes):
    """Layers of a cubic lattice, periodic along x."""
    tables = {
        "precision": "float64",
        "domain": {"size": [1.6, 0.1, 0.1]},
        "particles": {
            "count": 80 * 25,
            "radius": 0.0099,
            "density": 2500.0,
            "pack": {"kind": "lattice", "start": [0, 0, 0], "stop": [1.6, 0.1, 0.1], "spacing": 0.02 / 0.0198},
        },
        "contact": {"young_modulus": 1e6},
        "boundary": {"left": {"kind": "periodic"}, "right": {"kind": "periodic"}},
        "time": {"end": 0.1, "output_interval": 0.05},
    }
    return jaxdem.load_scene(tables | changes)


def test_particles_and_ghosts_of_a_lattice():
    report = check_scene(scene_of(), devices=4).devices
    assert report.axis == 0 and sum(report.particles) == 2000 and report.particles == (500,) * 4
    # The list reaches over two centres' distance, 0.02, and not over two of them: a layer of 25 on either side.
    assert report.ghosts == (50,) * 4
    assert report.sent[0] > 2 * 25 * 12 * 8, "position, velocity, expected velocity and spin of a layer on both sides"
    assert report.sent[1] == 0 and report.cells == 0


def test_small_scenes_are_not_helped_and_large_ones_are():
    grains = {"particles": {**scene_of().tables()["particles"], "count": 300}}
    small, large = check_scene(scene_of(**grains), devices=2), check_scene(scene_of(), devices=2)
    assert small.devices.useful == 1 and small.devices.shorter < 1.0 < large.devices.shorter < 2.0
    assert large.devices.useful > 1
    from rich.console import Console

    console = Console(width=200)
    with console.capture() as said:
        console.print(render(small))
    assert "Several devices do not help" in said.get()


def test_cores_that_stand_idle_are_told_of(monkeypatch):
    """As many processes as the cores that are worth it; nothing for a short run, on one core, and where it is asked."""
    monkeypatch.setattr(over_devices, "LONG", 0.0)
    told = {}
    for cores in (1, 2, 6):
        monkeypatch.setattr(over_devices.os, "sched_getaffinity", lambda _, cores=cores: set(range(cores)))
        told[cores] = check_scene(scene_of()).processes
    assert told[1] is None and told[2].number == 2 and told[2].shorter > 1.0
    assert 2 <= told[6].number <= 6 and told[6].shorter >= told[2].shorter
    assert check_scene(scene_of(), devices=2).processes is None
    monkeypatch.setattr(over_devices, "LONG", np.inf)
    assert check_scene(scene_of()).processes is None


def test_grains_at_one_end_of_a_fluid_are_the_work_of_one_device():
    """All in the first of four slabs of equal width: four times the mean, and nothing gained."""
    pack = {"kind": "lattice", "start": [0, 0, 0], "stop": [0.4, 0.1, 0.1], "spacing": 0.02 / 0.0198}
    grains = {**scene_of().tables()["particles"], "count": 500, "pack": pack}
    fluid = {"cells": [16, 5, 5], "density": 1.2, "viscosity": 1e-5, "time_step": 1e-3}
    report = check_scene(scene_of(particles=grains, fluid=fluid), devices=4)
    assert report.devices.particles == (500, 0, 0, 0) and report.devices.imbalance == 4.0
    assert report.devices.shorter < 1.0 and report.devices.useful == 1
    shown = [text for name, text in render_devices(report.devices) if name == "uneven"]
    assert len(shown) == 1 and "4 times the mean number" in shown[0]


def test_messages_of_a_program_are_added_up():
    """A layer of 5 numbers of 8 bytes three times in a loop, and 2 in a branch."""

    def program(x):
        x = jax.lax.fori_loop(0, 3, lambda _, x: jax.lax.ppermute(x, "blocks", [(0, 1)]), x)
        return jax.lax.cond(
            x[0] > 0.0, lambda x: x.at[:2].set(jax.lax.ppermute(x[:2], "blocks", [(1, 0)])), lambda x: x, x
        )

    mesh = AbstractMesh((2,), ("blocks",))
    program = jax.shard_map(program, mesh=mesh, in_specs=PartitionSpec(), out_specs=PartitionSpec(), check_vma=False)
    assert sent_by(jax.make_jaxpr(program)(np.zeros(5)).jaxpr) == 8 * (3 * 5 + 2)


def test_a_multigrid_cycle_sends_four_layers_a_level():
    """Each way, of the two levels that are in slabs: 32 and 16 cells across."""
    grid, slabs = Grid((64, 32), (6.4, 3.2), 1.0, (True, False)), Blocks(4, 0, True)
    sides = Boundary(tuple(Side(n // 2, n % 2 == 1, k) for n, k in enumerate(["periodic"] * 2 + ["no_slip", "outlet"])))
    own = grid.in_blocks(slabs)
    given = [np.ones(own.face_shape(axis)) for axis in range(2)], np.ones(own.cells)
    mesh = AbstractMesh((4,), ("blocks",))
    program = jax.shard_map(
        lambda c, r: multigrid(own, sides, tuple(c))(r),
        mesh=mesh, in_specs=PartitionSpec(), out_specs=PartitionSpec(), check_vma=False,
    )  # fmt: skip
    assert sent_by(jax.make_jaxpr(program)(*given).jaxpr) == 2 * STEPS * 2 * (32 + 16) * 8


def test_a_large_grain_among_small_ones_makes_devices_no_worse():
    """Lists are by levels of size, and ghosts are who is near the surfaces of grains: at the periodic side nobody
    stands in the slab above, so that the first layer of the slab below is no ghost there."""

    def checked(radius):
        lattice = {"kind": "lattice", "start": [0, 0, 0], "stop": [1.4, 0.1, 0.1], "spacing": 0.02 / 0.0198}
        one = {"kind": "lattice", "start": [1.4, 0, 0], "stop": [1.5, 0.1, 0.1], "count": 1, "radius": radius}
        packs = [lattice | {"count": 70 * 25, "radius": 0.0099}, one]
        return check_scene(scene_of(particles={"density": 2500.0, "pack": packs}), devices=2).devices

    equal, with_large = checked(0.0099), checked(0.045)
    assert with_large.shorter > 0.9 * equal.shorter and with_large.useful == equal.useful
    assert with_large.memory < 1.5 * equal.memory
    assert equal.ghosts == (25, 50) and with_large.ghosts == (25, 25)


def test_walls_in_the_fluid_count():
    """A box of 24 x m cells, cut along x: every device has its part of the mesh that is cut by a wall, and sends layers
    of m or m + 1 numbers in an interval in which a wall moves, nothing where it is at rest."""

    def checked(across, *walls, devices=2):
        tables = fluid_scene([24, across], {"right": {"kind": "outlet"}}) | {"walls": list(walls)}
        return check_scene(jaxdem.load_scene(tables), devices=devices)

    moving = CYLINDER | {"motion": SLIDING}
    sent = [checked(m, moving).devices.sent[2] for m in (6, 8, 10)]
    assert sent[2] - sent[1] == sent[1] - sent[0] > 20 * 2 * 8 and sent[0] > 3 * (sent[1] - sent[0])
    bare, still = checked(6), checked(6, CYLINDER)
    assert still.devices.sent[2] == 0 and still.devices.sent[1] == bare.devices.sent[1]
    more = {name: still.memory[name] - bare.memory.get(name, 0) for name in ("mesh cut by walls", "fluid")}
    assert still.devices.memory - bare.devices.memory == 3 * sum(more.values()) // 2
    assert checked(6, CYLINDER, devices=4).devices.memory == still.devices.memory // 2
    assert more["mesh cut by walls"] > 24 * 6 * 8 * 10, "open parts, links, friction and velocity of faces and cells"


def test_what_cannot_be_divided_is_refused_by_name():
    with pytest.raises(InputError, match="devices = 100: the box cannot be cut into 100 slabs") as refused:
        check_scene(scene_of(), devices=100)
    reach = "contacts of the largest reach 0.0198 m, contact.skin adds 0.00792 m"
    least = "slabs of 0.016 m would be narrower than 0.05544 m, twice as far as particles are looked for"
    assert f"along x {least}: {reach};" in str(refused.value)
    assert str(refused.value).endswith("Use 28 devices."), "1.6 m over 0.05544 m is 28.9"
    fluid = {"fluid": {"cells": [15, 5, 5], "density": 1.2, "viscosity": 1e-5, "time_step": 1e-3}}
    with pytest.raises(InputError, match="15"):
        check_scene(scene_of(particles=None, contact=None, **fluid), devices=4)
    assert np.isfinite(check_scene(scene_of(), devices=1).cost.total) and check_scene(scene_of()).devices is None
