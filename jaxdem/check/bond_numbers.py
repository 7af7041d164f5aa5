"""Pull-off force of grains with cohesion, and its ratio to their weight. Host side."""

from __future__ import annotations

import math

from jaxdem.check.engineering import Number
from jaxdem.setup.builder import Case
from jaxdem.setup.cohesion import pair_of
from jaxdem.setup.contact_bodies import contact_bodies, effective


def bond_numbers(case: Case) -> tuple[Number, ...]:
    """Pull-off force F of two equal grains and the Bond number F / (m g), over the sizes and densities of the scene.

    All pairs have the strongest cohesion between grains. None without cohesion, and with "sjkr", which has no pull-off
    force of its own. The Bond number is left out without gravity.
    """
    particles = case.particles
    if particles is None:
        return ()
    grains = [body for body in contact_bodies(particles) if not body.is_wall]
    pairs = [(pair_of(particles, body, body), 2.0 * effective(body.mass, body.mass)) for body in grains]
    forces = [(pair.pull_off, mass) for pair, mass in pairs if pair is not None and pair.pull_off > 0.0]
    if not forces:
        return ()
    pull = [force for force, _ in forces]
    found = [Number("pull-off force", min(pull), max(pull), "N", "of two equal grains")]
    gravity = math.hypot(*particles.scene.domain.strongest_gravity)
    if gravity > 0.0:
        bond = [force / (mass * gravity) for force, mass in forces]
        found.append(Number("  Bond number", min(bond), max(bond), "-", "pull-off force over the weight of a grain"))
    return tuple(found)
