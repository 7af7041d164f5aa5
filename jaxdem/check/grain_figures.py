"""How exact the contacts of a scene will be, and how soon its grains follow the fluid."""

from __future__ import annotations

import math

import numpy as np

from jaxdem.setup import stability
from jaxdem.setup.builder import Case

FLOAT32_ROUNDING = 2.0**-24


def restitution_error(contact_steps: float) -> float:
    """Error of the restitution to expect with so many steps in a contact: 0.02 at 20, 0.005 at 100 [-].

    A power law through these two measured points; about 1/n^0.86.
    """
    return 0.02 * (20.0 / contact_steps) ** (math.log(4.0) / math.log(5.0))


def slip_error(contact_steps: float) -> float:
    """Error of the slip that an oblique impact leaves, over the slip before, with so many steps in a contact [-].

    0.09 at 20, 0.02 at 100: the largest of impacts at 5 to 75 degrees with friction 0.1 to 1 and restitution 0.2 to 1,
    against steps a hundred times shorter; in the mean of these less than half. It is of first order, for the tangential
    dashpot knows the spin at the start of a step (`jaxdem.particles.loop`).
    """
    return 0.09 * (20.0 / contact_steps) ** 0.92


def particle_figures(case: Case) -> dict[str, float | None]:
    """Errors of restitution and slip, resting overlap and its resolution, relaxation time; None without particles."""
    names = ("restitution_error", "slip_error", "resting_overlap", "overlap_resolution", "relaxation_time")
    figures: dict[str, float | None] = dict.fromkeys(names)
    scene, particles, steps = case.scene, case.particles, case.simulation.steps
    if particles is None or steps.contact is None:
        return figures
    contact, bodies, table = particles.contact, particles.bodies, particles.materials
    radius, density = bodies.smallest_radius, float(np.min(bodies.density))
    mass = 4.0 / 3.0 * math.pi * radius**3 * density
    moduli = contact.young_modulus / (1.0 - contact.poisson_ratio**2)
    if table is not None:  # the stiffest has the smallest overlap to resolve
        used = np.unique(bodies.material)
        moduli = float(np.max(table.young_modulus[used] / (1.0 - table.poisson_ratio[used] ** 2)))
    contact_steps = steps.limits["contact_duration"] / steps.contact
    figures["restitution_error"] = restitution_error(contact_steps)
    rough = contact.friction > 0.0 if table is None else bool(table.friction.max() > 0.0)
    figures["slip_error"] = slip_error(contact_steps) if rough else None
    weight = mass * math.hypot(*scene.domain.strongest_gravity)
    if contact.law == "hertz_mindlin":
        modulus = 0.5 * moduli
        overlap = stability.hertz_resting_overlap(weight, 0.5 * radius, modulus)
    else:
        overlap = weight / (contact.normal_stiffness or math.inf)
    if overlap > 0.0:
        figures["resting_overlap"] = overlap / (2.0 * radius)
        if scene.precision == "float32":
            # Between two builds of the list a particle moves half a skin at most.
            moved = 0.5 * case.simulation.search.geometry.skin
            figures["overlap_resolution"] = FLOAT32_ROUNDING * moved / overlap
    if scene.fluid is not None and scene.fluid.viscosity > 0.0:
        viscosity = scene.fluid.density * scene.fluid.viscosity
        ratio = particles.table.coarse_grain
        figures["relaxation_time"] = stability.stokes_relaxation_time(mass / ratio**3, radius / ratio, viscosity)
    return figures
