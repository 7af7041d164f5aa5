"""Conduction of heat between grains that touch, and between grains and walls.

    Q = H (T_j - T_i),   H = 4 a / (1/k_i + 1/k_j)

of two smooth bodies that touch over a circle of radius a. Softened grains overlap too much and would conduct too well:
a is that of grains with the true Young's modulus E under the same elastic force. With Hertz's law, whose contact has
a^2 = R* overlap, this is

    a = sqrt(R* overlap) (E_scene / E)^(1/3),

with a linear spring of stiffness k it is Hertz's a = (3 k overlap R* / (4 E*))^(1/3), 1/E* = 2 (1 - nu^2) / E.

Source: G. K. Batchelor, R. W. O'Brien, Proc. R. Soc. Lond. A 355 (1977) 313-333. The correction follows from Hertz's
law at equal force.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax

from jaxdem.numerics import vectors
from jaxdem.numerics.blocks import Blocks
from jaxdem.numerics.compensated import Low
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.powers import power
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.clump_forces import on_bodies
from jaxdem.particles.clump_shape import Clumps
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.contact_pair import row, sum_slots
from jaxdem.particles.ghosts import with_ghosts
from jaxdem.particles.integrate import ParticleState, split_low
from jaxdem.particles.materials import ContactParameters
from jaxdem.particles.mesh_contact import touching as touching_mesh
from jaxdem.particles.neighbors import Neighbors, displacement_since_build, with_radius
from jaxdem.particles.pair_forces import pair_geometry
from jaxdem.particles.pairs import at, sum_over_pairs
from jaxdem.particles.wall_forces import wall_geometry


@static
class Conduction:
    """Which contacts conduct; static.

    Attributes:
        walls: whether each wall has a temperature, sides of the box first; the others conduct nothing.
        meshes: the same of each mesh.
        linear: whether contacts have linear springs, else Hertz's law.
        steps: of the conduction within an interval, explicit ones.
    """

    walls: tuple[bool, ...]
    linear: bool
    steps: int = 1
    meshes: tuple[bool, ...] = ()


class ConductionNumbers(NamedTuple):
    """Numbers of the conduction; traced.

    Attributes:
        conductivity: () of the grains [W/(m K)].
        wall_conductivity: () of the walls [W/(m K)].
        young_modulus: () true one of the grains [Pa].
        wall_temperature: (W,) of every wall; anything of one that does not conduct [K].
        mesh_temperature: (M,) of every mesh, the same [K].
    """

    conductivity: Array
    wall_conductivity: Array
    young_modulus: Array
    wall_temperature: Array
    mesh_temperature: Array


class Conductances(NamedTuple):
    """Of all contacts at one moment [W/K].

    Attributes:
        pairs: (P,) between grains; None where none are listed.
        walls: (S, N) of every grain with the walls that conduct; None without any.
        meshes: (C, M) of the rows of each mesh that conducts with C contacts each.
    """

    pairs: Array | None
    walls: Array | None
    meshes: tuple[Array, ...] = ()


class Touching(NamedTuple):
    """Grains at one moment, and what they may touch.

    Attributes:
        model: of the contacts; static.
        materials: of the contacts.
        particles: where they are; of clumps all members; in a slab with the ghosts behind its own.
        radius: () or (N,) of these [m].
        neighbors: list that holds there.
        present: (W,) bool, surfaces beside the box that are there; None for all.
        placed: of every surface that moves.
    """

    model: ContactModel
    materials: ContactParameters
    particles: ParticleState
    radius: Array
    neighbors: Neighbors
    present: Array | None
    placed: tuple[Placement | None, ...]


def conductances(conduction: Conduction, numbers: ConductionNumbers, touching: Touching) -> Conductances:
    """Of the contacts of a state [W/K]; see the equation at the top."""
    pairs = walls = None
    in_series = 4.0 / (1.0 / numbers.conductivity + 1.0 / numbers.wall_conductivity)
    if touching.neighbors.index.shape[0]:
        pairs = 2.0 * numbers.conductivity * _radius_of_contact(conduction, numbers, touching, *_pairs(touching))
    if any(conduction.walls):
        walls = in_series * _radius_of_contact(conduction, numbers, touching, *_walls(conduction, touching))
    meshes = tuple(
        in_series * _radius_of_contact(conduction, numbers, touching, *_mesh(touching, number))
        for number in _conducting_meshes(conduction)
    )
    return Conductances(pairs, walls, meshes)


def _conducting_meshes(conduction: Conduction) -> tuple[int, ...]:
    return tuple(number for number, conducts in enumerate(conduction.meshes) if conducts)


def _places(particles: ParticleState) -> tuple[Vector, tuple[Low, ...]]:
    """Leading and trailing parts of the centres by component [m]."""
    return vectors.components(particles.position), split_low(particles.position_low, particles.position.shape[1])


def _pairs(touching: Touching) -> tuple[Array, Array]:
    """Effective radius () or (P,) and overlap (P,) of the pairs [m]."""
    radius, listed = touching.radius, with_radius(touching.neighbors, touching.radius)
    displacement = displacement_since_build(*_places(touching.particles), listed)
    first, second = listed.pairs.first, listed.pairs.second
    change = vectors.subtract(at(displacement, first), at(displacement, second))
    one, other = (radius, radius) if radius.ndim == 0 else (at((radius,), first)[0], at((radius,), second)[0])
    return one * other / (one + other), pair_geometry(listed, change, one + other)[0]


def _walls(conduction: Conduction, touching: Touching) -> tuple[Array, Array]:
    """Effective radius () or (1, N) and overlap (S, N) at the walls that conduct [m]."""
    model, radius, particles = touching.model, touching.radius, touching.particles
    chosen = tuple(k for k, conducts in enumerate(conduction.walls) if conducts)
    overlap = wall_geometry(model, *_places(particles), radius, touching.placed)[0]
    overlap = jnp.stack([overlap[k] for k in chosen])
    if touching.present is not None:
        sides = len(model.sides)
        there = jnp.stack([jnp.asarray(True) if k < sides else touching.present[k - sides] for k in chosen])
        overlap = jnp.where(there[:, None], overlap, -1.0)
    if particles.active is not None:
        overlap = jnp.where(particles.active[None], overlap, -1.0)
    return row(radius), overlap


def _mesh(touching: Touching, number: int) -> tuple[Array, Array]:
    """Effective radius () or (1, M) and overlap (C, M) of the contacts of each row with a mesh [m]."""
    model, particles, listed = touching.model, touching.particles, with_radius(touching.neighbors, touching.radius)
    mesh, places = listed.meshes[model.meshes[number].number], _places(touching.particles)
    placed = touching.placed[len(model.surfaces) + number] if touching.placed else None
    moved = mesh.of_rows(displacement_since_build(*places, listed))
    if placed is not None:
        moved = mesh.moved(placed, *places)
    radius = mesh.radius_of_rows(touching.radius)
    overlap = touching_mesh(mesh, moved, radius, jnp.zeros_like(moved[0])).overlap
    there = mesh.row < particles.position.shape[0]
    if touching.present is not None:
        there = there & touching.present[len(model.surfaces) + number]
    return row(radius), jnp.where(there[None], overlap, -1.0)


def conducted(
    conduction: Conduction,
    numbers: ConductionNumbers,
    found: Conductances,
    neighbors: Neighbors,
    temperature: Array,
    bodies: tuple[Array, Clumps | None],
    duration: Array,
    blocks: Blocks | None = None,
) -> tuple[Array, Array]:
    """Temperatures (N,) after a time [K], and the heat that the walls have given [J]; heat is kept to rounding.

    Args:
        conduction, numbers: of the scene.
        found: of the contacts, which stay as they are.
        neighbors: list of them.
        temperature: (N,) [K].
        bodies: () or (N,) heat capacity of a grain [J/K]; and the members of clumps, whose contacts are those of their
            body, None without.
        duration: [s].
        blocks: of a box that is cut into slabs. A contact across a border conducts in both, from the temperature that
            a ghost has at the time.
    """
    chosen = [k for k, conducts in enumerate(conduction.walls) if conducts]
    step, (capacity, clumps) = duration / conduction.steps, bodies

    def advanced(k: int | Array, both: tuple[Array, Array]) -> tuple[Array, Array]:
        own, given = both
        seen = own
        if blocks is not None and neighbors.ghosts is not None:
            seen = with_ghosts(blocks, neighbors.ghosts, (own,))[0]
        grains = seen if clumps is None else clumps.rows(seen, len(seen))
        gained = jnp.zeros_like(grains)
        if found.pairs is not None:
            first, second = at((grains,), neighbors.pairs.first)[0], at((grains,), neighbors.pairs.second)[0]
            flow = found.pairs * (second - first)
            gained = gained + sum_over_pairs(flow, -flow, neighbors.pairs)
        if found.walls is not None:
            walls = numbers.wall_temperature[jnp.asarray(chosen)]
            flow = found.walls * (walls[:, None] - grains[None])
            gained, given = gained + sum_slots(flow), given + step * jnp.sum(flow)
        for number, conductance in zip(_conducting_meshes(conduction), found.meshes, strict=True):
            listed = neighbors.meshes[number]
            apart = numbers.mesh_temperature[number] - listed.of_rows((grains,))[0]
            flow = sum_slots(conductance * apart[None])
            gained, given = listed.added((gained,), (flow,))[0], given + step * jnp.sum(flow)
        gained = on_bodies(clumps, gained)
        if len(gained) > len(own):
            gained = gained[: len(own)]
        return own + step * gained / capacity, given

    return lax.fori_loop(0, conduction.steps, advanced, (temperature, jnp.zeros((), temperature.dtype)))


def _radius_of_contact(
    conduction: Conduction, numbers: ConductionNumbers, touching: Touching, radius: Array, overlap: Array
) -> Array:
    """Radius of the circle that true grains would touch over [m]; zero where they do not."""
    materials = touching.materials
    if conduction.linear:
        modulus = 0.5 * numbers.young_modulus / (1.0 - materials.poisson_ratio**2)
        return power(0.75 * materials.normal_stiffness * overlap * radius / modulus, 1.0 / 3.0)
    softened = power(materials.young_modulus / numbers.young_modulus, 1.0 / 3.0)
    return softened * power(radius * overlap, 0.5)
