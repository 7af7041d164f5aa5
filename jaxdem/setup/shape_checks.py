"""What does not go with clumps, refused by name before work starts."""

from __future__ import annotations

from jaxdem.errors import InputError, number_of_tables
from jaxdem.scene import Particles, Scene
from jaxdem.setup.shapes import template

SMALLEST = 1e-3
"""Radius of a member over that of its body, at least: a smaller one would decide the contact step alone."""


def check_shapes(scene: Scene, particles: Particles) -> None:
    """Refuses what does not work, or means nothing, with clumps.

    Raises:
        InputError: naming it.
    """
    if not particles.has_clumps:
        return
    coupling, contact = scene.coupling if scene.fluid is not None else None, scene.contact
    of_sphere = "is a law of a sphere"
    rule = "has no rule for clumps"
    found: list[tuple[str, object, bool, str]] = [
        ("particles.coarse_grain", particles.coarse_grain, particles.coarse_grain != 1.0, "parcels are spheres"),
        ("start.from", "...", scene.start is not None, "stages go on with spheres alone"),
        ("bonds", number_of_tables(scene.bonds), bool(scene.bonds), "bonds are between spheres"),
        ("output.samples", scene.output.samples, scene.output.samples > 0.0, "samples are of laws for spheres"),
    ]
    if contact is not None and contact.cohesion is not None:
        kind = contact.cohesion.kind
        found.append(
            ("contact.cohesion.kind", kind, kind == "capillary", "the film on a sphere has no rule for a member")
        )
    for k, pack in enumerate(particles.packs):
        key, given = f"{particles.pack_key(k)}.solid_fraction", pack.solid_fraction
        found.append((key, given, given is not None, "clumps are packed as the spheres that hold them; give a count"))
    for k, probe in enumerate(scene.probes):
        found.append((f"probes.{k}.kind", probe.kind, probe.kind in ("contacts", "profile"), rule))
    if coupling is not None:
        found += [
            ("coupling.lift", coupling.lift, bool(coupling.lift), of_sphere),
            ("coupling.rotational_drag", True, coupling.rotational_drag, of_sphere),
            ("coupling.virtual_mass", coupling.virtual_mass, coupling.virtual_mass > 0.0, of_sphere),
            ("coupling.basset", coupling.basset, bool(coupling.basset), of_sphere),
            ("coupling.self_disturbance", True, coupling.self_disturbance, of_sphere),
        ]
    for key, value, given, limit in found:
        if given:
            raise InputError(key, value, f"does not go with particles.shape: {limit}", "remove one of the two keys")
    for shape in particles.shapes:
        smallest = min(template(shape, scene.dimension).radii)
        if smallest < SMALLEST:
            limit = f"its smallest sphere has {smallest:.3g} of the radius of the body; the limit is {SMALLEST:g}"
            remedy = "leave it out, or make it larger: it would decide the time step alone"
            raise InputError(f"particles.shapes.{shape.name}", "...", limit, remedy)
