"""What acts on grains over a gap at a mesh: how far a contact is looked for, what it keeps, and liquid bridges."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.vectors import Vector
from jaxdem.particles import liquid
from jaxdem.particles.adhesion import AT_TOUCH
from jaxdem.particles.cohesion import CohesionConstants, Gap
from jaxdem.particles.contact import ContactMaterial
from jaxdem.particles.contact_load import attraction_of
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.contact_pair import ContactLoad, ContactPair, row, sum_slots
from jaxdem.particles.contact_step import ContactStep
from jaxdem.particles.mesh_contact import SAME, MeshMemory, MeshTouch, same_contacts
from jaxdem.particles.mesh_list import MeshList
from jaxdem.particles.normal_energy import normal_energy


def gap_of_laws(step: ContactStep, material: ContactMaterial, radius: Array) -> Array | None:
    """() or (M,) gap at which cohesion or a liquid acts on the grains of M rows; None where nothing does [m].

    Args:
        step: laws.
        material: of the contacts, () or (1, M).
        radius: () or (M,) [m].
    """
    model, found = step.model, None
    if model.cohesion is not None and not isinstance(model.cohesion, AT_TOUCH):
        size = row(radius)
        gap = Gap(jnp.zeros_like(size), size, None, size, material.effective_young_modulus)
        reach = model.cohesion.reach(gap, required(material.cohesion, "cohesion"))
        found = reach[0] if reach.ndim else reach
    if model.lubrication is not None:
        cutoff = required(material.lubrication, "lubrication").cutoff
        found = cutoff if found is None else jnp.maximum(found, cutoff)
    return found


def going_on(model: ContactModel, touch: MeshTouch, spring: Vector) -> Array:
    """(C, M) bool, contacts that are remembered: those that the next step goes on with, and all where the balance of
    energy has to tell those apart that come and go at once.

    Args:
        model: laws.
        touch: contacts of the step.
        spring: what they keep.
    """
    return touch.found if model.tracks_meshes else touch.found & _holding(model, touch.overlap, spring)


def with_springs(model: ContactModel, memory: MeshMemory) -> Array | None:
    """(C, M) bool, contacts of the step before whose springs go on; None for all that are remembered. So what a contact
    goes on with does not depend on whether the balance of energy is kept."""
    return _holding(model, memory.overlap[0], memory.spring) if model.tracks_meshes else None


def _holding(model: ContactModel, overlap: Array, spring: Vector) -> Array:
    """bool, bodies touch, or cohesion remembers something."""
    found = overlap > 0
    for kept in spring[len(spring) - model.memory :]:
        found = found | (kept != 0)
    return found


def lost_at_once(
    step: ContactStep,
    memory: MeshMemory,
    touch: MeshTouch,
    pair: ContactPair,
    springs: Vector,
    material: ContactMaterial,
) -> Array:
    """(C, M) energy along the normal of contacts of the step before that are gone, less that of contacts that have come
    with some [J].

    A contact begins and ends at once where the nearest point of a face gets to its border, as over a concave
    edge, and where two contacts become one. The forces on the grain jump there, and its speed does not. A contact
    that goes on at another face, with another gap, counts as one that ends and one that begins.

    Args:
        step: laws.
        memory: of the step before, turned with the mesh.
        touch, pair: contacts of this step.
        springs: what these have kept.
        material: of the mesh.
    """
    model, half = step.model, 0.5 * step.time_step
    first = len(springs) - model.memory
    own, kept = memory.spring[first:], springs[first:]
    apart = tuple(x[:, None] - y[None] for x, y in zip(pair.normal, memory.normal, strict=True))
    steady = same_contacts(memory, touch, pair.normal) & (vectors.dot(apart, apart) < SAME**2)
    for was, now in zip(own, kept, strict=True):
        steady = steady & (was[None] == now[:, None])

    def stored(overlap: Array, kept: Vector) -> Array:
        at = pair._replace(overlap=overlap)
        attraction = attraction_of(step, material, at, kept)
        touching = overlap > 0 if attraction is None else attraction.touching
        deep = overlap if attraction is None else attraction.overlap
        along, surface = normal_energy(model, at, material, kept, jnp.where(touching, deep, 0.0))
        return along + surface

    there = vectors.dot(memory.normal, memory.normal) > 0.5
    before = memory.overlap[0] - half * vectors.dot(pair.velocity, memory.normal)
    after = pair.overlap + half * vectors.dot(pair.velocity, pair.normal)
    known = jnp.any(memory.overlap[0] != 0, axis=0)[None]
    goes, comes = there & ~jnp.any(steady, axis=0), touch.found & ~jnp.any(steady, axis=1) & known
    return jnp.where(goes, stored(before, own), 0.0) - jnp.where(comes, stored(after, kept), 0.0)


def with_bridges(
    listed: MeshList, pair: ContactPair, load: ContactLoad, before: Vector, film: Array, constants: CohesionConstants
) -> tuple[ContactLoad, Array]:
    """The load with the bridges, and the films (N,), after those that form and rupture now, see `liquid` [m3].

    Where two contacts become one, as in a bend that a grain rolls into, the liquid of the other goes back to the grain.

    Args:
        listed: grains near the mesh.
        pair: their contacts with it, (C, M).
        load: what these do, with the bridges as they were.
        before: what the contacts of the step before have kept, (C, M) each.
        film: (N,) [m3].
        constants: of the liquid.
    """
    own, bridges = listed.of_rows((film,))[0], load.spring[-1]
    left = own + (sum_slots(before[-1]) - sum_slots(bridges))
    volume, left = liquid.with_walls(pair.overlap, bridges, left, constants)
    return load._replace(spring=(*load.spring[:-1], volume)), listed.added((film,), (left - own,))[0]
