"""The numbers of a scene that one may differentiate by: the list of the parts, each made in the module of its part."""

from __future__ import annotations

import numpy as np
from jax import Array

from jaxdem.closures.base import DragClosure
from jaxdem.errors import InputError
from jaxdem.fluid.fluid_state import FluidProperties
from jaxdem.fluid.mixing_length import BedMixing
from jaxdem.fluid.subgrid_stress import SubgridLaw
from jaxdem.particles.integrate import Parcels, ParticleProperties
from jaxdem.scene import Scene
from jaxdem.scene.fluid_walls import seen_by_fluid
from jaxdem.setup.as_arrays import AsArrays
from jaxdem.setup.bonds import bond_parameters
from jaxdem.setup.closures import subgrid_closure
from jaxdem.setup.clump_numbers import clump_numbers
from jaxdem.setup.contact_numbers import contact_numbers
from jaxdem.setup.drive import drive_parameters
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.scalars import scalar_parameters
from jaxdem.setup.surface import second_fluid
from jaxdem.setup.wall_motion import all_motion_numbers, piston_numbers
from jaxdem.state import Parameters


def scene_parameters(
    scene: Scene,
    particles: ParticleSetup | None,
    closure: DragClosure | None,
    subgrid: SubgridLaw | None,
    dtype: np.dtype[np.floating],
) -> Parameters:
    """Every number of the scene that is traced.

    Args:
        scene: the scene.
        particles: of it.
        closure: the drag law.
        subgrid: closure of the subgrid stress in place of the scene's.
        dtype: of all arrays.

    Raises:
        InputError: the file of a closure cannot be read.
    """
    number = AsArrays(dtype)
    coupling = None if scene.fluid is None else scene.coupling
    return Parameters(
        gravity=number(scene.domain.gravity),
        bodies=None if particles is None else _bodies(particles, number),
        contact=None if particles is None else contact_numbers(particles, number),
        fluid=_fluid(scene, subgrid, number),
        drag_scale=None if coupling is None else number(coupling.drag_factor),
        closure=closure,
        inlet_velocity=() if particles is None else tuple(number(inlet.velocity) for inlet in particles.table.inlet),
        side_velocity=_sides(scene, number) if scene.fluid is None and _has_moving_side(scene) else (),
        wall_motion=all_motion_numbers(scene, number),
        pistons=() if particles is None else piston_numbers(scene, number),
        meshes=() if particles is None else tuple(mesh.traced(dtype) for mesh in particles.meshes),
        bonds=bond_parameters(scene, number),
        scalars=scalar_parameters(scene, particles, dtype),
    )


def _bodies(particles: ParticleSetup, number: AsArrays) -> ParticleProperties:
    ratio = particles.table.coarse_grain
    parcels = None if ratio == 1.0 else Parcels(number(ratio), number(ratio**particles.scene.dimension))
    of_bodies = number(particles.bodies.radius), number(particles.bodies.density)
    return ParticleProperties(*of_bodies, parcels=parcels, clumps=clump_numbers(particles, number))


def _fluid(scene: Scene, subgrid: SubgridLaw | None, number: AsArrays) -> FluidProperties | None:
    table = scene.fluid
    if table is None:
        return None
    if scene.surface is not None and subgrid is not None:
        limit = "models eddies in one fluid and has no rule for two"
        raise InputError("subgrid", "given", limit, "leave it out, or remove [surface]")
    mixing = None
    if table.bed_mixing is not None:
        mixing = BedMixing(number(table.bed_mixing.von_karman), number(table.bed_mixing.packed_solid_fraction))
    return FluidProperties(
        number(table.density),
        number(table.viscosity),
        _sides(scene, number),
        number(table.smagorinsky) if table.smagorinsky > 0.0 else None,
        subgrid_closure(table, subgrid),
        mixing,
        drive_parameters(scene, table, number),
        second=second_fluid(scene, number),
        openings=tuple(
            number(one.amounts if one.times is not None else one.amounts[0])
            for _, wall in seen_by_fluid(scene.walls)
            for one in wall.opening or ()
        ),
    )


def _sides(scene: Scene, number: AsArrays) -> tuple[Array, ...]:
    """(D,) or (T, D) velocity of every side [m/s]."""
    sides = [scene.boundary[name] for name in scene.sides]
    return tuple(number(side.velocities or side.velocity or (0.0,) * scene.dimension) for side in sides)


def _has_moving_side(scene: Scene) -> bool:
    return any(scene.boundary[name].kind == "moving_wall" for name in scene.sides)
