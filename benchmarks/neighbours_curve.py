"""How R2 of a closure of neighbours grows with the number of spheres: is more data worth having?

    python benchmarks/neighbours_curve.py DATA [--reynolds 40]

One level of the size `large`, trained on an eighth to all of the arrays of one Reynolds number that are not held out;
R2 on those that are, and on the ones of the training.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

from jaxdem.closures import NeighborClosure
from jaxdem.train.level_fit import fitted
from jaxdem.train.neighbor_scores import scores
from jaxdem.train.neighbor_settings import SIZES, NeighborSettings
from jaxdem.train.neighbor_statistics import with_scale
from jaxdem.train.sphere_moments import group_moments, predicted
from jaxdem.train.spheres import Floats, SphereGroup, read_spheres

SHARES = ((0.125, 50), (0.25, 40), (0.5, 30), (1.0, 22))
"""Parts of the arrays, and passes through them."""


def part_of(group: SphereGroup, values: tuple[Floats, ...], share: float) -> tuple[SphereGroup, tuple[Floats, ...]]:
    """Some whole arrays of a group, with their moments."""
    chosen = np.sort(np.random.default_rng(1).permutation(group.arrays)[: round(share * group.arrays)])
    rows = np.concatenate([np.arange(group.start[a], group.start[a + 1]) for a in chosen])
    return group.select(chosen), tuple(part[rows] for part in values)


def main() -> None:
    """Print R2 of force along, force across and torque across by group and number of spheres."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data")
    parser.add_argument("--reynolds", type=float, default=40.0)
    options = parser.parse_args()
    size, settings = SIZES["large"], NeighborSettings(size="large")
    fresh = NeighborClosure.initial(size.basis, None, size.widths[:1], 0, wake=size.wake)
    groups = [one for one in read_spheres(options.data, fresh.half_box) if one.reynolds == options.reynolds]
    split = [group.split(settings.held_out_fraction, settings.seed) for group in groups]
    values, judged = ([group_moments(size.basis, one[k], size.wake) for one in split] for k in (0, 1))
    for share, epochs in SHARES:
        begin = time.process_time()
        some = [part_of(one, moments, share) for (one, _), moments in zip(split, values, strict=True)]
        train, moments = [one for one, _ in some], [one for _, one in some]
        plan = dataclasses.replace(settings, epochs=epochs)
        closure, _ = fitted(with_scale(fresh, train), 0, train, moments, plan)
        test = [other for _, other in split]
        pairs = (test, judged, groups), (train, moments, None)
        held, seen = (
            scores(own, [predicted(closure, *one) for one in zip(own, of_own, strict=True)], whole)
            for own, of_own, whole in pairs
        )
        count = sum(len(one.position) for one in train)
        print(f"{count} spheres, {time.process_time() - begin:.0f} s: along, across, torque (torque in training)")
        for name, row in held.items():
            found = ", ".join(f"{row[quantity]:.3f}" for quantity in ("along", "across", "torque"))
            print(f"  {name}: {found} ({seen[name]['torque']:.3f})", flush=True)


if __name__ == "__main__":
    main()
