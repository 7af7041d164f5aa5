"""Wear of meshes: what contacts take from the triangles that they lie on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import jax.numpy as jnp
from jax import Array
from jax.typing import DTypeLike

from jaxdem.errors import required
from jaxdem.numerics import compensated, vectors
from jaxdem.numerics.compensated import Low
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector


class WearContact(NamedTuple):
    """Contacts of a step with a mesh, arrays (C, M).

    Attributes:
        touches: bool, whether there is one.
        begins: bool, whether it begins in this step.
        force: along the normal, positive away from the wall [N].
        slip: speed of sliding [m/s].
        velocity: D arrays, of the centre against the wall at the start of the step [m/s].
        normal: D arrays, unit vectors towards the grain.
        mass: () or (1, M) of the grain [kg].
    """

    touches: Array
    begins: Array
    force: Array
    slip: Array
    velocity: Vector
    normal: Vector
    mass: Array


class WearLaw(Protocol):
    """The volume that contacts take from a wall; static."""

    def __call__(self, contact: WearContact, time_step: Array) -> Array:
        """(C, M) volume of every contact in a step [m3]."""
        ...


@static
class Archard:
    """V = k N s / H, of the normal force N over the distance s of sliding.

    Source: J. F. Archard, J. Appl. Phys. 24 (1953) 981.

    Attributes:
        coefficient: k [-].
        hardness: H [Pa].
    """

    coefficient: float
    hardness: float

    def __call__(self, contact: WearContact, time_step: Array) -> Array:
        """See `WearLaw`."""
        pressed = jnp.where(contact.touches, jnp.maximum(contact.force, 0.0), 0.0)
        return (self.coefficient / self.hardness) * pressed * contact.slip * time_step


@static
class Finnie:
    """V = c m v^2 / (p psi K) f(a) of a grain of mass m that arrives at a speed v and an angle a to the surface.

    f = sin 2a - (6/K) sin^2 a where tan a <= K/6, and (K/6) cos^2 a beyond. A contact counts once, as it begins.
    Source: I. Finnie, Wear 3 (1960) 87, eqs. (7) and (8).

    Attributes:
        coefficient: c, the part of the grains that cut [-].
        flow_stress: p [Pa].
        force_ratio: K, vertical over horizontal force [-].
        depth_ratio: psi, length of contact over depth of cut [-].
    """

    coefficient: float
    flow_stress: float
    force_ratio: float
    depth_ratio: float

    def __call__(self, contact: WearContact, time_step: Array) -> Array:
        """See `WearLaw`. With v sin a and v cos a the parts of the velocity into the wall and along it."""
        into = jnp.maximum(-vectors.dot(contact.velocity, contact.normal), 0.0)
        squared = vectors.dot(contact.velocity, contact.velocity)
        along = jnp.maximum(squared - into**2, 0.0)
        ratio = self.force_ratio
        swept = 2.0 * into * vectors.safe_sqrt(along) - (6.0 / ratio) * into**2
        cut = jnp.where(into**2 <= (ratio / 6.0) ** 2 * along, swept, (ratio / 6.0) * along)
        factor = self.coefficient / (self.flow_stress * self.depth_ratio * ratio)
        return jnp.where(contact.begins & (into > 0.0), factor * contact.mass * cut, 0.0)


class WornMesh(NamedTuple):
    """What has been taken from the F triangles of a mesh.

    Attributes:
        volume: (F,) leading part [m3].
        volume_low: (F,) trailing part, without which what a step takes would be lost; None in float64 [m3].
    """

    volume: Array
    volume_low: Low

    def with_more(self, volume: Array) -> WornMesh:
        """After so much more (F,) [m3]."""
        return WornMesh(*compensated.advance(self.volume, self.volume_low, volume))


def no_wear(cells: Sequence[int | None], dtype: DTypeLike) -> tuple[Array | None, ...]:
    """Nothing taken from meshes of so many triangles (None: a mesh does not wear), (F,) each [m3]."""
    return tuple(None if number is None else jnp.zeros(number, dtype) for number in cells)


def with_wear(
    before: tuple[WornMesh | None, ...], numbers: Sequence[int], more: tuple[Array | None, ...]
) -> tuple[WornMesh | None, ...]:
    """All meshes after contacts have taken more.

    Args:
        before: of every mesh of the scene.
        numbers: of the meshes that are there.
        more: of each of these, (F,) or None [m3].
    """
    found = list(before)
    for number, volume in zip(numbers, more, strict=True):
        if volume is not None:
            found[number] = required(found[number], "wear of a mesh").with_more(volume)
    return tuple(found)


def worn(contact: WearContact, law: WearLaw, cell: Array, cells: int, time_step: Array) -> Array:
    """(F,) volume that the contacts of a step take from each triangle [m3].

    Args:
        contact: of all grains near the mesh.
        law: of the wear.
        cell: (C, M) int32, triangle of each contact.
        cells: F.
        time_step: [s].
    """
    volume = law(contact, time_step)
    return jnp.zeros(cells, volume.dtype).at[cell.reshape(-1)].add(volume.reshape(-1), mode="drop")
