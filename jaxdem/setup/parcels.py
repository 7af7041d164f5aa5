"""Parcels: particles that stand for l^D grains in D dimensions; which models have a rule for them.

A parcel is a sphere of radius l r, r that of its grains, with the mass and the volume of l^D grains. In 3-D that is the
mass of the sphere; in 2-D, where the layer is as deep as before, it is 1/l of that.

- Contact: overlap over diameter, contact time over diameter and restitution at a given speed are those of the grains.
  Hertz's law has that with the modulus as it is; the linear law with l times the stiffness. In 2-D forces are, as the
  masses, 1/l of these. Friction and rolling friction are ratios and stay. Stresses are those of the grains.
- Fluid: drag, lift in a shear and Basset force are those of a grain times l^D; pressure gradient, viscous force,
  virtual mass and void fraction go with the volume of the grains. Kernels follow the diameter of the parcel.

Collisions of a parcel are l times as rare as those of a grain at the same speeds and solid fraction, so agitated
parcels lose energy l times as slowly. With `contact.parcel_loss` = "rate" an impact loses l times as much in turn:
1 - e_p^2 = l (1 - e^2). Impacts on walls stay: as much mass meets a wall, at the same speeds.

Source: M. Sakai & S. Koshizuka, Chem. Eng. Sci. 64 (2009) 533-539; C. Bierwisch, T. Kraft, H. Riedel & M. Moseler, J.
Mech. Phys. Solids 57 (2009) 10-31. The rate of loss by kinetic theory, proportional to (1 - e^2) T^(3/2) / d at a given
solid fraction: C. K. K. Lun, S. B. Savage, D. J. Jeffrey & N. Chepurniy, J. Fluid Mech. 140 (1984) 223-256.
"""

from __future__ import annotations

import math

from jaxdem.errors import InputError, required
from jaxdem.scene import Contact, Particles, Scene


def parcel_contact(contact: Contact, ratio: float) -> Contact:
    """The constants of contacts between spheres of `ratio` times the radius, for the same overlap over diameter."""
    if ratio == 1.0:
        return contact
    names = ("normal_stiffness", "tangential_stiffness")
    given = {name: ratio * value for name in names if (value := getattr(contact, name)) is not None}
    return contact.model_copy(update=given)


def impact_loss(scene: Scene) -> float | None:
    """Factor on 1 - e^2 of impacts between particles, l with `contact.parcel_loss` = "rate"; None for 1 [-]."""
    contact, particles = scene.contact, scene.particles
    if contact is None or particles is None or contact.parcel_loss == "impact" or particles.coarse_grain == 1.0:
        return None
    return particles.coarse_grain


def pair_restitution(scene: Scene) -> float:
    """Restitution of impacts between particles of one material [-]."""
    restitution = required(scene.contact, "contact").restitution
    return math.sqrt(1.0 - (impact_loss(scene) or 1.0) * (1.0 - restitution**2))


def share_of_sphere(ratio: float, dimension: int) -> float:
    """Mass of a parcel over that of a sphere of its size, l^(D-3); contact forces have the same factor [-]."""
    return ratio ** (dimension - 3)


def check_parcels(scene: Scene, particles: Particles) -> None:
    """Refuses models of which nobody knows what they are for a parcel.

    Raises:
        InputError: lift of a turning grain, torque of the fluid, the correction for the particle's own wake, or its own
            volume where it is spread by points; or a restitution that the rate of loss cannot be kept with.
    """
    _check_loss(scene)
    ratio, coupling = particles.coarse_grain, scene.coupling
    if ratio == 1.0 or coupling is None or scene.fluid is None:
        return
    spin = "needs the rotation of a grain, which a parcel has not: its own is that of a larger sphere"
    wake = "removes the wake of one grain; a parcel has that of its grains together, for which there is no rule"
    for key, on, limit in (
        ("lift", "magnus" in coupling.lift, spin),
        ("rotational_drag", coupling.rotational_drag, spin),
        ("self_disturbance", coupling.self_disturbance, wake),
    ):
        if on:
            remedy = "leave it out, or set particles.coarse_grain = 1"
            raise InputError(f"coupling.{key}", getattr(coupling, key), f"{limit} (coarse_grain = {ratio:g})", remedy)
    if coupling.own_volume == "grain" and coupling.void_fraction in ("divided", "diffusion"):
        limit = f'is not known with coupling.void_fraction = "{coupling.void_fraction}": points stand for a parcel'
        remedy = 'set coupling.void_fraction = "kernel" or "centre", or coupling.own_volume = "parcel"'
        raise InputError("coupling.own_volume", "grain", limit, remedy)


def _check_loss(scene: Scene) -> None:
    """Refuses several materials, and impacts that would lose all of their energy or more."""
    loss, contact = impact_loss(scene), scene.contact
    if loss is None or contact is None:
        return
    if scene.materials:
        limit = "has a rule for one restitution, and the scene has [[materials]]"
        remedy = "give each pair the e_p of 1 - e_p^2 = l (1 - e^2), and set it to impact"
        raise InputError("contact.parcel_loss", contact.parcel_loss, limit, remedy)
    least = math.sqrt(1.0 - 1.0 / loss)
    if contact.restitution <= least:
        limit = f"parcels of l = {loss:g} would lose all energy of an impact, or more; must be above {least:.4g}"
        remedy = "raise it, lower particles.coarse_grain, or set contact.parcel_loss = impact"
        raise InputError("contact.restitution", contact.restitution, limit, remedy)
