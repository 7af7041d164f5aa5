"""Where the particles of the start come from, as the check tells of it: packs, or a file; and who is bonded."""

from __future__ import annotations

import numpy as np

from jaxdem.setup.particles import ParticleSetup


def pack_rows(particles: ParticleSetup | None) -> tuple[tuple[str, str], ...]:
    """Kind, number of particles and solid fraction of every pack; and the columns of a file that are not read, as
    (name, text)."""
    rows = []
    for pack in () if particles is None else particles.packs:
        kind = pack.pack.kind
        text = f"{kind}, {pack.count} particles, solid fraction {pack.solid_fraction:.4g} of its region"
        if kind == "settled":
            text += "; the run lets all particles fall and come to rest before time 0"
        rows.append((pack.key.removeprefix("particles."), text))
    file = None if particles is None or particles.is_started else particles.table.file
    if file is not None and file.columns.unused:
        rows.append(("columns of the file not read", ", ".join(repr(name) for name in file.columns.unused)))
    return tuple(rows)


def bond_rows(particles: ParticleSetup | None) -> tuple[tuple[str, str], ...]:
    """Number of bonds, of bonded particles, and the most of one particle, as (name, text)."""
    bonds = None if particles is None else particles.bonds
    if bonds is None or len(bonds.first) == 0:
        return ()
    each = np.bincount(np.concatenate([bonds.first, bonds.second]))
    text = f"{len(bonds.first)} between {np.count_nonzero(each)} particles, up to {each.max()} of one"
    return (("bonds", f"{text}; {np.mean(bonds.length):.4g} m long in the mean"),)
