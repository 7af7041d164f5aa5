"""A run that starts from a frame of another: positions, velocities and overlaps as they are in the files."""

from __future__ import annotations

import numpy as np
import pytest

from jaxdem import InputError, build, initial_state, load_run, load_scene, simulate
from jaxdem.particles.packing import deepest_overlap
from jaxdem.scene.rows import rows_of
from jaxdem.setup.overlaps import INSERTION_OVERLAP

RADIUS, SIZE, FRAMES = 0.01, (0.05, 0.2), 12
TABLES = {
    "precision": "float64",
    "domain": {"size": list(SIZE)},
    "particles": {
        "radius": RADIUS,
        "density": 2500.0,
        "position": [
            [0.0105, 0.0105],
            [0.0385, 0.0105],
            [0.0245, 0.0251],
            [0.0105, 0.0401],
            [0.0385, 0.0401],
        ],
        "angular_velocity": [1.0, 2.0, 3.0, 4.0, 5.0],
    },
    # No friction and no damping: contacts keep nothing, so that a frame is the whole state.
    "contact": {"young_modulus": 2e5, "friction": 0.0, "restitution": 1.0, "speed": 0.8},
    "time": {"end": 0.12, "output_interval": 0.01},
}


@pytest.fixture(scope="module")
def bed(tmp_path_factory):
    """Five discs that fall onto each other, soft enough to overlap by more than a hundredth of their diameter."""
    return load_run(simulate(load_scene(TABLES), tmp_path_factory.mktemp("bed") / "run").path)


def from_frame(run, index, **contact):
    """The scene from a frame on, its arrays put in as they are read."""
    frame = run.particles(index)
    given = {name: frame[name] for name in ("position", "velocity", "angular_velocity")}
    end = float(run.times[-1] - run.times[index])
    return TABLES | {
        "particles": {"radius": RADIUS, "density": 2500.0, **given},
        "contact": TABLES["contact"] | contact,
        "time": {"end": round(end, 12), "output_interval": 0.01},
    }


def overlap_of(run, index):
    position = run.particles(index)["position"][:, :2]
    return deepest_overlap(position, np.full(len(position), RADIUS), SIZE, (False, False))[0]


def test_a_run_goes_on_from_a_frame_of_another(bed, tmp_path):
    """From a frame whose overlaps are beyond one per cent of a diameter: what follows is what followed, to rounding."""
    index = max(range(1, FRAMES - 3), key=lambda frame: overlap_of(bed, frame))
    assert overlap_of(bed, index) > INSERTION_OVERLAP
    later = load_run(simulate(load_scene(from_frame(bed, index)), tmp_path / "later").path)
    assert np.abs(later.particles(0)["velocity"]).max() > 0.0
    for frame in range(later.number_of_frames):
        for name in ("position", "velocity", "angular_velocity"):
            there, here = bed.particles(index + frame)[name], later.particles(frame)[name]
            np.testing.assert_allclose(here, there, rtol=1e-9, atol=1e-9, err_msg=name)


def test_overlaps_of_a_run_are_a_state_and_deeper_ones_are_none(bed):
    """Whatever contact.speed says; the limit is contact.maximum_overlap, at which a run stops too."""
    index = max(range(1, FRAMES), key=lambda frame: overlap_of(bed, frame))
    slow = load_scene(from_frame(bed, index, speed=0.003))
    simulation, parameters = build(slow)
    assert simulation.steps.expected_overlap < INSERTION_OVERLAP < overlap_of(bed, index)
    assert initial_state(slow, simulation, parameters)[0].particles.position.shape == (5, 2)
    least = load_scene(from_frame(bed, index, speed=0.003, maximum_overlap=0.9 * overlap_of(bed, index)))
    with pytest.raises(InputError, match=r"contact\.maximum_overlap.*[Mm]ove the particles apart"):
        initial_state(least, *build(least))
    rows = {"particles.position": [[0.02, 0.02], [0.03, 0.02]], "particles.angular_velocity": [0.0, 0.0]}
    gross = load_scene(TABLES, rows)
    with pytest.raises(InputError, match=r"overlap by 50 %.*limit is 20 %, contact\.maximum_overlap"):
        initial_state(gross, *build(gross))


def test_three_components_in_a_plane_are_those_of_a_frame():
    """(x, z, 0) and (0, 0, scalar); anything else in the empty components is refused, and a radius has none."""
    rows = np.array([[1.0, 2.0, 0.0], [3.0, 4.0, 0.0]])
    np.testing.assert_array_equal(rows_of("key", rows, 2, of_frame=True), rows[:, :2])
    spin = np.array([[0.0, 0.0, 5.0]])
    np.testing.assert_array_equal(rows_of("key", spin, 1, of_frame=True), [[5.0]])
    np.testing.assert_array_equal(rows_of("key", rows, 3, of_frame=True), rows)
    for given, width in ((rows + 1e-9, 2), (rows, 1)):
        with pytest.raises(InputError, match="row 0.*in 2-D"):
            rows_of("key", given, width, of_frame=True)
    with pytest.raises(InputError, match="1 number"):
        rows_of("particles.radius", spin, 1)
