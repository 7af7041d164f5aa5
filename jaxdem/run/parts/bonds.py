"""What a run writes of its bonds: lines of a frame, columns of the history, figures of the summary. Host side."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from jaxdem.errors import required
from jaxdem.particles.bond_state import INTACT, LEFT, SHEAR, STATUS_NAMES, TENSION
from jaxdem.particles.bonds import BondLoads, bond_loads
from jaxdem.particles.integrate import ParticleState
from jaxdem.run.instant import Instant, wrapped_position
from jaxdem.run.parts.part import Arrays, Part
from jaxdem.run.totals import Means, Totals
from jaxdem.setup.builder import Case

_loads = jax.jit(bond_loads, static_argnums=0)


class Bonds(Part):
    """The bonds between particles."""

    def arrays(self, case: Case, instant: Instant) -> dict[str, Arrays]:
        """Of the bonds (B,) each, and `ends` (B, 2, D)."""
        particles = instant.state.particles
        if particles is None or particles.bonds is None:
            return {}
        bonds, position = particles.bonds, wrapped_position(case.simulation, particles)
        first, second = (np.asarray(index)[:-1] for index in (bonds.pairs.first, bonds.pairs.second))
        apart, box = position[first] - position[second], np.asarray(case.simulation.box, position.dtype)
        apart = np.where(case.simulation.periodic, apart - box * np.round(apart / box), apart)
        loads = _carried(case, particles)._asdict()
        found = {
            "ends": np.stack([position[first], position[first] - apart], axis=1),
            "first": first,
            "second": second,
            "table": np.asarray(bonds.table)[:-1],
            "status": np.asarray(bonds.status)[:-1],
            **{f"bond_{name}" if name == "energy" else name: np.asarray(x)[:-1] for name, x in loads.items()},
        }
        return {"bonds": found}

    def columns(self, case: Case, instant: Instant, means: Means) -> dict[str, float]:
        """Bonds that hold, broke, and went with a grain."""
        particles = instant.state.particles
        if particles is None or particles.bonds is None:
            return {}
        status = np.asarray(particles.bonds.status)[:-1]
        broken = int(np.isin(status, (TENSION, SHEAR)).sum())
        return {
            "bonds_intact": float((status == INTACT).sum()),
            "bonds_broken": float(broken),
            "bonds_left": float((status == LEFT).sum()),
        }

    def summary(self, case: Case, instant: Instant, totals: Totals) -> dict[str, Any]:
        """`bodies` are groups of at least two grains that intact bonds hold together, `largest_body` has the most."""
        particles = instant.state.particles
        if particles is None or particles.bonds is None:
            return {}
        bonds = particles.bonds
        status, count = np.asarray(bonds.status)[:-1], len(particles.position)
        holds = status == INTACT
        rows = tuple(np.asarray(index)[:-1][holds] for index in (bonds.pairs.first, bonds.pairs.second))
        graph = coo_matrix((np.ones(len(rows[0])), rows), shape=(count, count))
        sizes = np.bincount(connected_components(graph, directed=False)[1])
        named = {"broken_in_tension": TENSION, "broken_in_shear": SHEAR, STATUS_NAMES[LEFT]: LEFT}
        return {
            "bonds": {
                "made": len(status),
                "intact": int(holds.sum()),
                **{name: int((status == code).sum()) for name, code in named.items()},
                "energy": float(np.sum(np.asarray(_carried(case, particles).energy, np.float64))),
                "bodies": int((sizes > 1).sum()),
                "largest_body": int(sizes.max(initial=0)),
            }
        }


def _carried(case: Case, particles: ParticleState) -> BondLoads:
    contact, parameters = required(case.simulation.contact, "contact"), case.parameters
    bonding = required(contact.model.bonds, "bonds of the contact model")
    numbers = required(parameters.bonds, "parameters.bonds"), required(parameters.bodies, "parameters.bodies")
    loads: BondLoads = _loads(bonding, *numbers, particles)
    return loads
