"""Figures of a distributed run. Host, numpy."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxdem.devices.mesh import on_host
from jaxdem.errors import required
from jaxdem.particles.neighbors import Neighbors


@dataclasses.dataclass(frozen=True)
class Counts:
    """How the particles are spread over the slabs.

    Attributes:
        particles: (B,) of every slab.
        ghosts: (B,) of its neighbours, that it has copies of.
        planes: (B - 1,) where the box is cut [m].
        migrations: times that particles went to other slabs, with a build of the lists each.
        cuts: times that the cut planes moved.
        builds: of the lists.
        narrow: a slab was too narrow for the ghosts of its neighbours.
    """

    particles: np.ndarray
    ghosts: np.ndarray
    planes: np.ndarray
    migrations: int
    cuts: int
    builds: int
    narrow: bool

    @property
    def imbalance(self) -> float:
        """Particles of the fullest slab over their mean number; 1 is even, also for none at all."""
        mean = self.particles.mean()
        return float(self.particles.max() / mean) if mean else 1.0


def counts(neighbors: Neighbors) -> Counts:
    """The counts of a distributed list; every process must call it."""
    ghosts, builds = on_host((required(neighbors.ghosts, "ghosts of a list"), neighbors.builds))
    there = np.asarray(ghosts.identity) >= 0
    rows = there.shape[1] - 2 * ghosts.lower.shape[1]
    return Counts(
        particles=there[:, :rows].sum(axis=1),
        ghosts=there[:, rows:].sum(axis=1),
        planes=ghosts.planes[0],
        migrations=int(ghosts.migrations[0]),
        cuts=int(ghosts.cuts[0]),
        builds=int(builds[0]),
        narrow=bool(ghosts.narrow.any()),
    )
