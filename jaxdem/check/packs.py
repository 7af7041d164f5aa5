"""The packs of a scene, as the check tells of them."""

from __future__ import annotations

from jaxdem.setup.particles import ParticleSetup


def pack_rows(particles: ParticleSetup | None) -> tuple[tuple[str, str], ...]:
    """Kind, number of particles and solid fraction of every pack, as (name, text)."""
    rows = []
    for pack in () if particles is None else particles.packs:
        kind = pack.pack.kind
        text = f"{kind}, {pack.count} particles, solid fraction {pack.solid_fraction:.4g} of its region"
        if kind == "settled":
            text += "; the run lets all particles fall and come to rest before time 0"
        rows.append((pack.key.removeprefix("particles."), text))
    return tuple(rows)
