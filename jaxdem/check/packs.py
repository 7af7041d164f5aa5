"""Where the particles of the start come from, as the check tells of it: packs, or a file."""

from __future__ import annotations

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
