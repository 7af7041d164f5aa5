"""Datasets of random states whose drag is known: Koch-Hill times a given factor."""

from __future__ import annotations

import jax
import numpy as np

from jaxdem.closures import KochHill
from jaxdem.train.dataset_file import LATER, SCALARS, VECTORS, Group, read_dataset, write_dataset

CELL, DIAMETER, DENSITY, VISCOSITY = 0.04, 0.02, 1000.0, 1e-3


@jax.jit
def koch_hill(inputs):
    return KochHill()(inputs).coefficient


def koch_hill_force(group):
    slip = group.fluid_velocity - group.particle_velocity
    return np.asarray(koch_hill(group.drag_inputs()))[:, None] * slip


def make_group(coarsening, rows, seed, truth, dimension=2):
    """Random states; `truth` maps a group to the factor (M,) that multiplies Koch-Hill in its target
    force."""
    generator = np.random.default_rng([seed, coarsening])
    vector = (rows, dimension)
    group = Group(
        coarsening=coarsening,
        filter_size=CELL * coarsening,
        kernel_width=CELL * coarsening,
        fluid_density=DENSITY,
        dynamic_viscosity=VISCOSITY,
        time=np.sort(generator.uniform(0.0, 2.0, rows)),
        particle_velocity=generator.uniform(-0.5, 0.5, vector),
        fluid_velocity=generator.uniform(-1.5, 1.5, vector),
        solid_fraction=generator.uniform(0.05, 0.38, rows),
        void_fraction_gradient=generator.normal(0.0, 1.0, vector),
        pressure_gradient=generator.normal(0.0, 1e3, vector),
        diameter=np.full(rows, DIAMETER),
        drag_force=np.zeros(vector),
        target_force=np.zeros(vector),
    )
    drag = koch_hill_force(group)
    object.__setattr__(group, "drag_force", drag)
    object.__setattr__(group, "target_force", drag * truth(group)[:, None])
    return group


def write(path, run, groups, dimension=2):
    attributes = {
        "drag": "koch_hill",
        "fluid_density": DENSITY,
        "dynamic_viscosity": VISCOSITY,
        "dimension": dimension,
        "run": run,
        "scene_toml": "seed = 1\n",
    }
    names = ("filter_size", "kernel_width", *SCALARS, *VECTORS, *LATER)
    content = {group.coarsening: {name: getattr(group, name) for name in names} for group in groups}
    content = {n: {name: value for name, value in own.items() if value is not None} for n, own in content.items()}
    write_dataset(path, attributes, content)
    return path


def make_dataset(tmp_path, run="one", seed=0, rows=1500, truth=None, coarsenings=(2, 4)):
    truth = truth or known_factor
    groups = [make_group(n, rows, seed, truth) for n in coarsenings]
    return read_dataset(write(tmp_path / f"{run}_{seed}.h5", run, groups))


def known_factor(group):
    """A smooth factor of the closure's features that goes to one with the filter."""
    gate = 1 - np.exp(-group.filter_size / DIAMETER / 4)
    along = np.sum(group.void_fraction_gradient * group.drag_force, axis=1)
    along /= np.linalg.norm(group.drag_force, axis=1) * np.linalg.norm(group.void_fraction_gradient, axis=1)
    return np.exp(gate * (0.4 - 2.0 * group.solid_fraction + 0.2 * along))
