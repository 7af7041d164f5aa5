"""A scene with larger parcels than the run that it begins from: the particles of the run are merged at the start.

A parcel of the scene takes the place of (l'/l)^D particles of the run, near ones of one density, material and size
class. That need not be a whole number: a particle on the border of two clusters goes in parts to both.

- Mass and momentum are those of its particles. It begins in their centre of mass, and is then moved so that parcels do
  not overlap: clusters of a dense pack do not lie as spheres do.
- It takes their angular momentum about the centre, orbital and of their spins, where that costs no more energy than
  they have beside the motion of the centre. Else, as where particles lie far apart, it turns as they would as one rigid
  body, and the rest of the angular momentum is lost.
- What they have of energy beside is lost: their granular temperature. Springs of contacts begin at rest.
- What does not make a whole parcel, of every density and material, is left out: the highest ones.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from jaxdem.errors import InputError
from jaxdem.particles.clusters import Membership, equal_clusters
from jaxdem.particles.growth import moved_apart_nearby
from jaxdem.particles.packing import deepest_overlap
from jaxdem.particles.regions import into_period
from jaxdem.scene import Scene
from jaxdem.setup.bodies import Bodies, collapsed
from jaxdem.setup.free_space import free_space
from jaxdem.setup.parcels import share_of_sphere
from jaxdem.setup.start_point import StartPoint

CLASS_WIDTH = 1.1
"""Largest over smallest radius in a size class. What is left of a class goes to the next larger one."""

WHOLE = 1e-9
"""Part of a parcel by which rounding may miss one."""

GONE = ("state.particles.", "neighbors.", "room", "rows/", "inlet/", "extra/")
"""Arrays of a checkpoint that are of the particles."""


@dataclasses.dataclass(frozen=True)
class Grains:
    """The present particles of a run, N of them in D dimensions; A angular components.

    Attributes:
        position: (N, D), in the box along periodic axes [m].
        velocity, spin: (N, D) [m/s] and (N, A) [rad/s].
        forces: (N, D) mean forces over the last interval, by the name of their array [N].
        bodies: (N,) of each; radius [m].
        mass: (N,) [kg].
    """

    position: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    forces: dict[str, np.ndarray]
    bodies: Bodies
    mass: np.ndarray

    @property
    def inertia(self) -> np.ndarray:
        """(N,) moments of inertia 2/5 m r^2 [kg m2]."""
        return 0.4 * self.mass * self.bodies.radius**2

    @property
    def energy(self) -> float:
        """Kinetic energy of translation and rotation [J]."""
        moving = self.mass @ np.sum(self.velocity**2, axis=1)
        return float(0.5 * (moving + self.inertia @ np.sum(self.spin**2, axis=1)))

    @property
    def centre(self) -> np.ndarray:
        """(D,) centre of mass [m]."""
        return self.mass @ self.position / self.mass.sum()

    @property
    def angular_momentum(self) -> np.ndarray:
        """(A,) about the centre of mass [kg m2/s]."""
        away = self.position - self.centre
        return self.mass @ _cross(away, self.velocity) + self.inertia @ self.spin

    def those(self, rows: np.ndarray) -> Grains:
        """Some of them."""
        forces = {name: force[rows] for name, force in self.forces.items()}
        bodies = Bodies(*(column[rows] for column in self.bodies))
        return Grains(self.position[rows], self.velocity[rows], self.spin[rows], forces, bodies, self.mass[rows])


def merged(scene: Scene, start: StartPoint) -> tuple[StartPoint, dict[str, object]]:
    """The start of a scene with its particles merged into parcels, and what that took; as it is where l is the same.

    Args:
        scene: that begins.
        start: state of the run that it begins from.

    Raises:
        InputError: particles of one density and material do not make a single parcel, or parcels cannot be moved apart.
    """
    ratio = (1.0 if scene.particles is None else scene.particles.coarse_grain) / start.coarse_grain
    if ratio == 1.0 or not start.has_particles:
        return start, {}
    grains, size = _present(start, scene.dimension), ratio**scene.dimension
    members = _clusters(grains, size, start, scene)
    taken = _taken(grains, members)
    parcels = _parcels(grains, members, ratio)
    centre = parcels.centre
    figures: dict[str, object] = {"particles": len(grains.mass), "parcels": len(parcels.mass), "to_one": size}
    figures |= {
        "left_out_particles": round(len(grains.mass) - len(parcels.mass) * size, 6),
        "left_out_mass": float(np.sum(grains.mass - taken.mass)),
        "energy_before": taken.energy,
        "energy_after": parcels.energy,
    }
    before = taken.angular_momentum
    if not start.foreseen:
        parcels, moved = _apart(scene, parcels, float(start.time))
        figures |= moved | {"centre_moved": (parcels.centre - centre).tolist()}
    figures |= {
        "angular_momentum_before": before.tolist(),
        "angular_momentum_after": parcels.angular_momentum.tolist(),
    }
    waiting = sum(len(queue.rows) - queue.inserted for queue in start.queues)
    return _stored(start, parcels), figures | ({"never_inserted": waiting} if waiting else {})


def _present(start: StartPoint, dimension: int) -> Grains:
    """The particles that are there. Of an end that is foreseen, those that are due have come in."""
    arrays, many = start.arrays, len(start.arrays["state.particles.position"])
    there = np.asarray(arrays.get("state.particles.active", np.ones(many, bool))).copy()
    for queue in start.queues if start.foreseen else ():
        there[queue.rows[: queue.inserted]] = True
    rows = np.flatnonzero(there)

    def of(name: str) -> np.ndarray:
        return arrays[f"state.particles.{name}"][rows].astype(np.float64)

    position = of("position")
    if "state.particles.position_low" in arrays:
        position = position + of("position_low")
    size, periodic = start.box
    position = np.where(periodic, into_period(position, size), position)
    bodies = Bodies(*(np.broadcast_to(column, many)[rows] for column in start.bodies))
    mass = share_of_sphere(start.coarse_grain, dimension) * 4.0 / 3.0 * np.pi * bodies.radius**3 * bodies.density
    names = [name for name in ("contact_force", "fluid_force") if f"state.particles.{name}" in arrays]
    forces = {name: of(name) for name in names}
    return Grains(position, of("velocity"), of("angular_velocity"), forces, bodies, mass)


def _clusters(grains: Grains, size: float, start: StartPoint, scene: Scene) -> Membership:
    """Which particles make which parcel: `size` of one density, material and size class."""
    kinds, kind = np.unique(np.stack([grains.bodies.density, grains.bodies.material]), axis=1, return_inverse=True)
    found, parcels = [], 0
    for number in range(kinds.shape[1]):
        left, share, made = np.zeros(0, int), np.zeros(0), 0
        for rows in _size_classes(grains.bodies.radius, np.flatnonzero(kind == number)):
            left, share = np.concatenate([left, rows]), np.concatenate([share, np.ones(len(rows))])
            count = int(np.floor(share.sum() / size + WHOLE))
            order = np.argsort(grains.position[left, -1], kind="stable")
            left, share = left[order], share[order]
            below = np.clip(count * size - (np.cumsum(share) - share), 0.0, share)
            if count > 0:
                taken = np.flatnonzero(below > 0.0)
                one = equal_clusters(grains.position[left[taken]], below[taken], count)
                found.append(Membership(left[taken][one.particle], one.cluster + parcels, one.part))
                parcels, made = parcels + count, made + count
            rest = np.flatnonzero(share - below > WHOLE)
            left, share = left[rest], (share - below)[rest]
        if made == 0:
            density, material = kinds[:, number]
            names = [table["name"] for table in start.tables.get("materials", ())]
            of = f"{density:g} kg/m3" + (f" and {names[int(material)]!r}" if names else "")
            limit = f"a parcel takes the place of {size:g} particles; the run {start.source} has {len(left)} of {of}"
            value = scene.particles and scene.particles.coarse_grain
            raise InputError("particles.coarse_grain", value, limit, "lower it")
    return Membership(*(np.concatenate(columns) for columns in zip(*found, strict=True)))


def _size_classes(radius: np.ndarray, rows: np.ndarray) -> list[np.ndarray]:
    """Rows of particles by their size class, the smallest first."""
    number = np.floor(np.log(radius[rows] / radius[rows].min()) / np.log(CLASS_WIDTH) + 1e-6)
    return [rows[number == one] for one in np.unique(number)]


def _taken(grains: Grains, members: Membership) -> Grains:
    """What of the particles is merged: the same with the mass that is shared out."""
    part = np.bincount(members.particle, members.part, len(grains.mass))
    return dataclasses.replace(grains, mass=part * grains.mass)


def _parcels(grains: Grains, members: Membership, ratio: float) -> Grains:
    """The parcels, in the centres of mass of their particles."""
    particle, cluster, part = members
    first = np.flatnonzero(np.diff(cluster, prepend=-1))

    def total(values: np.ndarray) -> np.ndarray:
        """Sum over the particles of every parcel."""
        return np.add.reduceat(values, first)

    some, mass = grains.those(particle), part * grains.mass[particle]
    whole = total(mass)
    position, velocity = (total(mass[:, None] * x) / whole[:, None] for x in (some.position, some.velocity))
    away, beside = some.position - position[cluster], some.velocity - velocity[cluster]
    inertia = 0.4 * mass * some.bodies.radius**2
    momentum = total(mass[:, None] * _cross(away, beside) + inertia[:, None] * some.spin)
    energy = 0.5 * total(mass * np.sum(beside**2, axis=1) + inertia * np.sum(some.spin**2, axis=1))
    size, least = np.sum(part) / len(first), np.minimum.reduceat(some.bodies.radius, first)
    mean = np.cbrt(total(part * some.bodies.radius**3) / size)
    # Equal ones to the last bit, so that there is one radius for all.
    radius = ratio * np.where(least == np.maximum.reduceat(some.bodies.radius, first), least, mean)
    bodies = Bodies(radius, *(column[first] for column in some.bodies[1:]))
    own = (0.4 * whole * radius**2)[:, None]
    costs = np.sum(momentum**2, axis=1, keepdims=True) / (2.0 * own)
    rigid = momentum / _largest_inertia(total, mass, away, inertia)[:, None]
    spin = np.where(costs <= energy[:, None], momentum / own, rigid)
    forces = {name: total(part[:, None] * force) for name, force in some.forces.items()}
    return Grains(position, velocity, spin, forces, bodies, whole)


def _largest_inertia(
    total: Callable[[np.ndarray], np.ndarray], mass: np.ndarray, away: np.ndarray, inertia: np.ndarray
) -> np.ndarray:
    """(n,) largest moment of inertia of the particles of every parcel about their centre of mass [kg m2]."""
    square = np.sum(away**2, axis=1)
    if away.shape[1] == 2:
        return total(mass * square + inertia)
    products = mass[:, None, None] * away[:, :, None] * away[:, None]
    tensors = total((mass * square + inertia)[:, None, None] * np.eye(3) - products)
    return np.linalg.eigvalsh(tensors)[:, -1]


def _apart(scene: Scene, parcels: Grains, time: float) -> tuple[Grains, dict[str, object]]:
    """The parcels moved until they overlap neither each other nor a side of the box, as far as there is room."""
    size, radius = scene.domain.size, parcels.bodies.radius
    position, clear = moved_apart_nearby(free_space(scene, time), parcels.position, radius)
    way = position - parcels.position
    way = np.where(scene.periodic, way - np.asarray(size) * np.round(way / np.asarray(size)), way)
    length = np.linalg.norm(way, axis=1)
    overlap = 0.0 if clear else deepest_overlap(position, radius, size, scene.periodic)[0]
    figures: dict[str, object] = {"largest_move": float(length.max()), "mean_move": float(length.mean())}
    return dataclasses.replace(parcels, position=position), figures | {"largest_overlap": overlap}


def _stored(start: StartPoint, parcels: Grains) -> StartPoint:
    """The start with the parcels in place of its particles."""
    arrays = {name: value for name, value in start.arrays.items() if not name.startswith(GONE)}
    dtype = start.arrays["state.particles.position"].dtype
    leading = parcels.position.astype(dtype)
    rows = {"position": leading, "velocity": parcels.velocity, "angular_velocity": parcels.spin} | parcels.forces
    if dtype != np.float64:
        rows["position_low"] = parcels.position - leading
    arrays |= {f"state.particles.{name}": values.astype(dtype) for name, values in rows.items()}
    arrays |= {f"rows/{name}": column for name, column in collapsed(parcels.bodies)._asdict().items()}
    return dataclasses.replace(start, arrays=arrays, merged=True)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(N, A) cross products of rows (N, D)."""
    return np.cross(a, b) if a.shape[1] == 3 else (a[:, :1] * b[:, 1:] - a[:, 1:] * b[:, :1])
