"""Training of closures of neighbours on forces on spheres, with forces that are sums over pairs."""

import h5py
import jax
import numpy as np
import pytest
from typer.testing import CliRunner

from jaxdem.cli.main import app
from jaxdem.closures.file import load_neighbors
from jaxdem.train.neighbor_scores import evaluate_neighbours
from jaxdem.train.neighbor_settings import SIZES
from jaxdem.train.neighbors import fewer
from jaxdem.train.spheres import read_spheres

BOX, SPHERES, ARRAYS = 5.5, 24, 80
FLOWS = ((10, 10), (20, 20))


def forces(position):
    """Force over its mean and torque of spheres in a periodic box: sums over pairs, with their symmetry about x."""
    apart = position[None] - position[:, None]
    apart -= BOX * np.round(apart / BOX)
    r = np.linalg.norm(apart, axis=2) + 10.0 * np.eye(len(position))
    held = np.maximum(r, 0.8)  # as the functions of the distance are
    near = np.where(r < 2.5, (1 - (held / 2.5) ** 2) ** 2 / held, 0.0)
    x, y, z = np.moveaxis(apart / r[..., None], 2, 0)
    near *= 0.1
    along = (near * (3 * x**2 - 1)).sum(axis=1)
    across = np.stack([(near * x * y).sum(axis=1), (near * x * z).sum(axis=1)], axis=1)
    w = 0.2 * np.stack([(near * y).sum(axis=1), (near * z).sum(axis=1)], axis=1)
    return np.column_stack([along, across]), np.column_stack([np.zeros(len(w)), -w[:, 1], w[:, 0]])


def write(path, change=None):
    """A file of the layout; `change` may alter a group of it."""
    generator = np.random.default_rng(1)
    with h5py.File(path, "w") as file:
        for reynolds, per_cent in FLOWS:
            group = file.create_group(f"Re_{reynolds:02d}_phi_{per_cent:02d}")
            positions = generator.uniform(0, BOX, (ARRAYS, SPHERES, 3))
            found = [forces(position) for position in positions]
            force = np.concatenate([one for one, _ in found])
            mean = force[:, 0].mean()
            group["position"] = positions.reshape(-1, 3)
            group["force"] = 100.0 / reynolds * (np.array([[1.0 - mean, 0.0, 0.0]]) + force)
            group["torque"] = 100.0 / reynolds * np.concatenate([one for _, one in found])
            group["start"] = np.arange(ARRAYS + 1) * SPHERES
            group["box"] = np.tile([0.0, BOX], (ARRAYS, 3))
            group.attrs["radius"] = [0.5]
        if change is not None:
            change(file["Re_10_phi_10"])
    return path


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return write(tmp_path_factory.mktemp("spheres") / "spheres.h5")


@pytest.fixture(scope="module")
def trained(data, tmp_path_factory):
    """A closure file by the command, and what it said."""
    out = tmp_path_factory.mktemp("closure") / "neighbours.closure.h5"
    command = ["train", str(data), "--recipe", "neighbours", "--size", "small", "--epochs", "120", "--out", str(out)]
    with jax.enable_x64(False):
        return out, CliRunner().invoke(app, command)


def test_pairwise_forces_are_found_by_least_squares_and_learned(trained):
    """The forces are sums over pairs of functions that are among the moments, so that least squares explains all but
    the difference between the means of the arrays held out and of the others."""
    path, result = trained
    assert result.exit_code == 0, result.output
    closure, metadata = load_neighbors(path)
    for name in ("along", "across", "torque"):
        assert metadata["r2_linear"]["all"][name] > 0.95, name
        assert metadata["r2"]["all"][name] > 0.8, name
        assert f"{metadata['r2']['all'][name]:.3f}" in result.stdout
    assert metadata["recipe"] == "neighbours" and closure.basis == SIZES["small"].basis


def test_the_mean_law_is_kept(trained, data):
    closure, metadata = load_neighbors(trained[0])
    found = evaluate_neighbours(closure, data)
    assert set(found) == {"Re_10_phi_10", "Re_20_phi_20", "all"}
    for name in ("Re_10_phi_10", "Re_20_phi_20"):
        assert found[name]["mean_factor"] == pytest.approx(1.0, abs=0.01)
        assert found[name]["data_factor"] == 1.0 and metadata["r2"][name]["data_factor"] != 1.0
        assert metadata["r2"][name]["data_factor"] == pytest.approx(1.0, abs=0.05)
        assert found[name]["arrays"] == ARRAYS and metadata["r2"][name]["arrays"] == ARRAYS // 10


def test_evaluate_shows_all_arrays(trained, data):
    result = CliRunner().invoke(app, ["evaluate", str(trained[0]), str(data)])
    assert result.exit_code == 0, result.output
    row = next(line for line in result.stdout.splitlines() if "Re_20_phi_20" in line)
    assert f" {ARRAYS} " in row


def test_arrays_are_held_out_whole(data):
    (group, _) = read_spheres(data, 2.5)
    train, test = group.split(0.25, seed=3)
    assert (train.arrays, test.arrays) == (60, 20)
    rows = np.concatenate([train.position, test.position])
    assert len(np.unique(rows, axis=0)) == len(group.position) == SPHERES * ARRAYS
    assert all(len(part.position) == SPHERES * part.arrays for part in (train, test))


def replaced(key, value):
    def change(group):
        del group[key]
        if value is not None:
            group[key] = value

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (replaced("torque", None), ("has no torque in the group Re_10_phi_10",)),
        (replaced("force", np.zeros((3, 3))), ("force of shape (3, 3)",)),
        (replaced("start", np.zeros(ARRAYS + 1, int)), ("does not rise",)),
        (replaced("position", np.full((SPHERES * ARRAYS, 3), np.nan)), ("not finite",)),
        (replaced("box", np.tile([0.0, 4.0], (ARRAYS, 3))), ("box of 4 diameters", "twice the reach is 5")),
        (lambda group: group.attrs.pop("radius"), ("attribute radius",)),
    ],
)
def test_a_file_of_another_layout_is_refused(tmp_path, change, words):
    path = write(tmp_path / "wrong.h5", change)
    command = ["train", str(path), "--recipe", "neighbours", "--size", "small", "--out", str(tmp_path / "out.h5")]
    refused(CliRunner().invoke(app, command), "DATA", *words)


def refused(result, *words):
    assert result.exit_code == 2, result.output
    for word in words:
        assert word in result.stderr


def test_options_of_other_recipes_are_refused(data, tmp_path):
    train = ["train", str(data), "--out", str(tmp_path / "out.h5"), "--recipe"]
    for option, value in (("terms", "pressure_gradient"), ("loss", "balance"), ("ensemble", "3")):
        result = CliRunner().invoke(app, [*train, "neighbours", f"--{option}", value])
        refused(result, f"--{option}", "--recipe filtered")
    refused(CliRunner().invoke(app, [*train, "filtered", "--size", "small"]), "--size", "neighbours")
    refused(CliRunner().invoke(app, [*train, "neighbours", str(data)]), "must be one file")
    refused(CliRunner().invoke(app, [*train, "filtered"]), "dataset", "or --recipe neighbours for forces on spheres")
    text = tmp_path / "text.h5"
    text.write_text("no data")
    refused(
        CliRunner().invoke(app, ["train", str(text), "--recipe", "neighbours", *train[2:4]]), "DATA", "cannot be read"
    )


def test_fewer_spheres_are_whole_arrays(data):
    groups = read_spheres(data, 2.5)
    assert fewer(groups[0], 4 * SPHERES, groups, seed=0).arrays == 2
    assert fewer(groups[0], None, groups, seed=0) is groups[0]
