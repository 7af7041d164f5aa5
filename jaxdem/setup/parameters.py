"""The numbers of a scene that one may differentiate by."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from jax import Array

from jaxdem.closures.base import DragClosure
from jaxdem.fluid.fluid_state import FluidProperties
from jaxdem.fluid.mixing_length import BedMixing
from jaxdem.fluid.subgrid_stress import SubgridLaw
from jaxdem.numerics.host import on_device
from jaxdem.particles.clump_shape import Clumps
from jaxdem.particles.integrate import Parcels, ParticleProperties
from jaxdem.particles.lubrication import LubricationConstants
from jaxdem.particles.materials import CohesionParameters, ContactParameters, MaterialNumbers, SeveralMaterials
from jaxdem.particles.moving_walls import Numbers
from jaxdem.scene import Contact, Scene
from jaxdem.setup.bonds import bond_parameters
from jaxdem.setup.closures import subgrid_closure
from jaxdem.setup.cohesion import largest_volume
from jaxdem.setup.drive import drive_parameters
from jaxdem.setup.materials import MaterialTable
from jaxdem.setup.parcels import share_of_sphere
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.scalars import scalar_parameters
from jaxdem.setup.wall_motion import motion_numbers, piston_numbers
from jaxdem.state import Parameters

Values = float | str | np.ndarray | Sequence[float | Sequence[float]] | None
"""What a key of a scene may hold."""


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
    number = _Numbers(dtype)
    sides = [scene.boundary[name] for name in scene.sides]
    velocity = tuple(number(side.velocities or side.velocity or (0.0,) * scene.dimension) for side in sides)
    moving = any(side.kind == "moving_wall" for side in sides)
    bodies = contact = fluid = drag_scale = None
    if particles is not None:
        ratio = particles.table.coarse_grain
        parcels = None if ratio == 1.0 else Parcels(number(ratio), number(ratio**scene.dimension))
        of_bodies = number(particles.bodies.radius), number(particles.bodies.density)
        bodies = ParticleProperties(*of_bodies, parcels=parcels, clumps=_clumps(particles, number))
        share = share_of_sphere(ratio, scene.dimension)
        contact = _contact_constants(particles.contact, particles.materials, number, share)
        contact = contact._replace(
            cohesion=_cohesion(particles, number), lubrication=_lubrication(particles.contact, number)
        )
    if scene.fluid is not None:
        table = scene.fluid
        smagorinsky = number(table.smagorinsky) if table.smagorinsky > 0.0 else None
        law = subgrid_closure(table, subgrid)
        mixing = None
        if table.bed_mixing is not None:
            mixing = BedMixing(number(table.bed_mixing.von_karman), number(table.bed_mixing.packed_solid_fraction))
        drive = drive_parameters(scene, table, number)
        of_fluid = number(table.density), number(table.viscosity)
        fluid = FluidProperties(*of_fluid, velocity, smagorinsky, law, mixing, drive)
        drag_scale = None if scene.coupling is None else number(scene.coupling.drag_factor)
    return Parameters(
        gravity=number(scene.domain.gravity),
        bodies=bodies,
        contact=contact,
        fluid=fluid,
        drag_scale=drag_scale,
        closure=closure,
        inlet_velocity=() if particles is None else tuple(number(inlet.velocity) for inlet in particles.table.inlet),
        side_velocity=velocity if fluid is None and moving else (),
        wall_motion=_wall_motion(scene, number),
        pistons=() if particles is None else piston_numbers(scene, number),
        meshes=() if particles is None else tuple(mesh.traced(dtype) for mesh in particles.meshes),
        bonds=bond_parameters(scene, number),
        scalars=scalar_parameters(scene, particles, dtype),
    )


def _clumps(particles: ParticleSetup, number: _Numbers) -> Clumps | None:
    """Members and inertia of bodies that are clumps; None where all are spheres."""
    table, bodies = particles.shapes, particles.bodies
    if table is None:
        return None
    offset, radius, part, there = table.padded(bodies.shape)
    size = np.atleast_1d(bodies.radius)[None]
    radius, offset = radius * size, offset * size[..., None]
    same = np.ndim(bodies.shape) == 0

    def of_shapes(values: list[float]) -> Array:
        return number(values[int(bodies.shape)] if same else np.asarray(values)[bodies.shape])

    templates = table.templates
    moments, axes = len(templates[0].inertia), len(templates[0].shadow)
    return Clumps(
        offset=tuple(number(offset[..., k]) for k in range(offset.shape[-1])),
        radius=number(radius.flat[0] if (radius == radius.flat[0]).all() else radius),
        inertia=tuple(of_shapes([float(one.inertia[k]) for one in templates]) for k in range(moments)),
        share=number(part),
        reach=of_shapes([one.reach for one in templates]),
        sphericity=of_shapes([one.sphericity for one in templates]),
        shadow=tuple(of_shapes([float(one.shadow[k]) for one in templates]) for k in range(axes)),
        there=None if there is None else on_device(there, bool),
    )


def _wall_motion(scene: Scene, number: _Numbers) -> tuple[Numbers, ...]:
    """Numbers of the motion of every wall; () where none moves."""
    if not any(wall.moves for wall in scene.walls):
        return ()
    return tuple(motion_numbers(wall, number) for wall in scene.walls)


class _Numbers:
    """Values of a scene as arrays."""

    def __init__(self, dtype: np.dtype[np.floating]) -> None:
        self._dtype = dtype

    def __call__(self, value: Values) -> Array:
        """One value; zero where there is none, for a constant that the scene's law does not use."""
        rigid = isinstance(value, str) and value == "rigid"
        return on_device(math.inf if rigid else (0.0 if value is None else value), self._dtype)

    def optional(self, value: Values) -> Array | None:
        """The same of a constant that follows another one where the scene gives none of its own."""
        return None if value is None else self(value)


def _contact_constants(
    contact: Contact, table: MaterialTable | None, number: _Numbers, share: float
) -> ContactParameters | SeveralMaterials:
    """The constants of contacts, with moduli and stiffnesses times `share`, see `share_of_sphere`."""

    def stiff(value: float | str | None) -> float | str | None:
        return share * value if isinstance(value, float) else value

    normal, tangential = number(stiff(contact.normal_stiffness)), number.optional(stiff(contact.tangential_stiffness))
    if table is None:
        return ContactParameters(
            young_modulus=number(stiff(contact.young_modulus)),
            poisson_ratio=number(contact.poisson_ratio),
            restitution=number(contact.restitution),
            friction=number(contact.friction),
            rolling_friction=number(contact.rolling_friction),
            rolling_damping=number(contact.rolling_damping),
            wall_young_modulus=number.optional(stiff(contact.wall_young_modulus)),
            wall_poisson_ratio=number.optional(contact.wall_poisson_ratio),
            wall_friction=number.optional(contact.wall_friction),
            normal_stiffness=normal,
            tangential_stiffness=tangential,
        )
    given = {name: values for name, (values, _) in table.given.items()}
    given["young_modulus"] = share * given["young_modulus"]
    return SeveralMaterials(
        **cast(Any, {name: number(values) for name, values in given.items() if name != "cohesion"}),
        rolling_damping=number(contact.rolling_damping),
        normal_stiffness=normal,
        tangential_stiffness=tangential,
        numbers=MaterialNumbers(**{name: mixing for name, (_, mixing) in table.given.items()}),
        cohesion=None,
    )


def _lubrication(contact: Contact, number: _Numbers) -> LubricationConstants | None:
    """The numbers of the liquid in gaps; None without."""
    table = contact.lubrication
    if table is None:
        return None
    own = number.optional(table.wet_friction), number.optional(table.sommerfeld_number)
    return LubricationConstants(number.optional(table.viscosity), number(table.roughness), number(table.cutoff), *own)


def _cohesion(particles: ParticleSetup, number: _Numbers) -> CohesionParameters | None:
    """The numbers of the cohesion; None without."""
    table, materials = particles.contact.cohesion, particles.materials
    if table is None:
        return None
    largest = None if table.liquid_content is None else number(table.liquid_content * largest_volume(particles))
    return CohesionParameters(
        strength=number(table.strength if materials is None else materials.given["cohesion"][0]),
        wall_factor=number(table.wall_factor) if materials is None else None,
        minimum_gap=number.optional(table.minimum_gap),
        cutoff=number.optional(table.cutoff),
        contact_angle=number.optional(table.contact_angle),
        liquid_viscosity=number(table.liquid_viscosity) if table.liquid_viscosity > 0.0 else None,
        bridge_share=number.optional(table.bridge_share),
        largest_film=largest,
    )
