"""What a closure of neighbours could tell and cost if it saw the pairs of the contact list only.

    python benchmarks/neighbours_contacts.py DATA

The contact list reaches 1.4 diameters, its skin included. A closure of that reach is trained on some spheres; R2 is of
arrays that are held out. Its time is that of the sums and the network, as if the list were there in the form that they
ask for.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import jax
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks.neighbours import DIAMETER, contact_pass, scene, seconds
from jaxdem.closures import NeighborClosure
from jaxdem.closures.moments import MomentBasis
from jaxdem.closures.neighbor_level import Width
from jaxdem.closures.neighbor_places import Places, axes_along, fluctuation
from jaxdem.coupling.surroundings import AT_ONCE
from jaxdem.train.neighbor_settings import SIZES, NeighborSettings, Size
from jaxdem.train.neighbors import fit_neighbors

GRAINS, SOLID_FRACTION, REACH = 1500, 0.3, 1.4
SAMPLES, EPOCHS = 60_000, 15


def contact_neighbors(centres: np.ndarray, box: np.ndarray) -> np.ndarray:
    """(N, K) int32 who is within the reach of the contact list, itself in empty slots."""
    apart = centres[None] - centres[:, None]
    apart -= box * np.round(apart / box)
    near = np.linalg.norm(apart, axis=2) < REACH * DIAMETER
    np.fill_diagonal(near, False)
    rows = [np.flatnonzero(row) for row in near]
    others = np.repeat(np.arange(len(centres))[:, None], max(map(len, rows)), axis=1)
    for own, row in enumerate(rows):
        others[own, : len(row)] = row
    return others.astype(np.int32)


def cost(closure: NeighborClosure) -> tuple[float, float]:
    """Times of a contact pass, and of an evaluation with a list that is there [s a grain]."""
    described = scene(GRAINS, SOLID_FRACTION)
    simulation, parameters = jaxdem.build(described)
    state, _ = jaxdem.initial_state(described, simulation, parameters)
    box = np.asarray(described.domain.size, np.float32)
    centres = np.asarray(state.particles.position)
    places = Places(centres, contact_neighbors(centres, box), np.float32(DIAMETER), box)
    slip = np.broadcast_to(np.float32([1.0, 0.0, 0.0]), centres.shape)
    reynolds, solid_fraction = (np.full(GRAINS, value, np.float32) for value in (10.0, SOLID_FRACTION))

    @jax.jit
    def evaluated(closure: NeighborClosure, places: Places, slip: Any) -> Any:
        return fluctuation(closure, places, axes_along(slip), reynolds, solid_fraction, AT_ONCE)

    took = seconds(lambda: evaluated(closure, places, slip))
    return contact_pass(described) / GRAINS, took / GRAINS


def main() -> None:
    """Print R2 by group and the cost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data")
    options = parser.parse_args()
    SIZES["contacts"] = Size(MomentBasis(REACH, 5, 4, 3), None, (Width(24, 8, (32, 32)),))
    settings = NeighborSettings(size="contacts", samples=SAMPLES, epochs=EPOCHS)
    closure, metadata = fit_neighbors(options.data, settings)
    found = {name: row for name, row in metadata["r2"].items() if name != "all"}
    for quantity in ("along", "across", "torque"):
        values = [row[quantity] for row in found.values()]
        print(f"{quantity}: mean {np.mean(values):.2f}, {min(values):.2f} to {max(values):.2f}", flush=True)
    one_pass, took = cost(closure)
    print(f"sums and network {1e6 * took:.2g} us a grain, {took / one_pass:.2g} contact passes")


if __name__ == "__main__":
    main()
