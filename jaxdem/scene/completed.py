"""A scene with every default that depends on other tables, and what does not go together in it."""

from __future__ import annotations

from jaxdem.errors import InputError, number_of_tables
from jaxdem.scene.bed_mixing import check_bed_mixing
from jaxdem.scene.bonds import check_bonds
from jaxdem.scene.boundary import completed_boundary
from jaxdem.scene.cohesion import check_strengths, check_together
from jaxdem.scene.contact import Contact
from jaxdem.scene.coupling import Coupling, check_on_mesh, coupling_without_fluid
from jaxdem.scene.domain import Domain, check_output
from jaxdem.scene.drive import check_drive, check_own_gravity
from jaxdem.scene.fluid_walls import check_fluid_walls, check_openings
from jaxdem.scene.heat import check_heat, check_reference
from jaxdem.scene.lubrication import check_lubrication
from jaxdem.scene.packs import check_settling
from jaxdem.scene.particles import largest_radius
from jaxdem.scene.population import check_exits, completed_inlets
from jaxdem.scene.probe_places import ProbePlace, completed_probes
from jaxdem.scene.scene import Scene
from jaxdem.scene.surface import check_surface, check_surface_heat, of_one_fluid
from jaxdem.scene.surface_beside_walls import check_surface_beside_walls
from jaxdem.scene.walls import check_walls


def completed(scene: Scene) -> Scene:
    """The scene with every default that depends on other tables written in, and checked as a whole."""
    _check_tables(scene)
    boundary, box = completed_boundary(scene.boundary, scene.domain.size, scene.particles is not None)
    update: dict[str, object] = {"domain": _completed_domain(scene), "boundary": boundary}
    check_walls(scene.walls, box)
    if scene.particles is not None:
        inlets = completed_inlets(scene.particles, box, scene.time.end)
        update["particles"] = scene.particles.model_copy(update={"inlet": inlets})
        update["contact"] = scene.contact or Contact()
        update["coupling"] = scene.coupling if scene.fluid is not None else coupling_without_fluid(scene.coupling)
    if scene.fluid is not None:
        velocity = scene.fluid.velocity or (0.0,) * scene.dimension
        update["fluid"] = scene.fluid.model_copy(update={"velocity": velocity})
    if scene.fluid is not None and scene.particles is not None:
        update["coupling"] = coupling = scene.coupling or Coupling()
        check_on_mesh(coupling, scene.fluid.cells, scene.output.samples)
        if scene.fluid.viscosity == 0.0:
            remedy = "set fluid.viscosity to a value above 0"
            raise InputError("fluid.viscosity", 0.0, "drag needs a positive viscosity", remedy)
    found = scene.model_copy(update=update)
    for name, side in scene.boundary.items():
        if side.kind == "inlet" and scene.fluid is None:
            limit = "is an inlet of fluid, and the scene has no fluid"
            raise InputError(f"boundary.{name}.kind", "inlet", limit, 'add [fluid], or set kind = "no_slip"')
    check_output(found.output, found.particles is not None, bool(found.walls))
    _check_gaps(found)
    _check_bonds(found)
    if found.particles is not None and found.start is None:
        check_settling(found.particles.packs, found.domain, found.periodic)
    check_exits(found.boundary, found.particles is not None, found.fluid is not None)
    if found.fluid is not None:
        check_own_gravity(scene.domain.gravity, found.periodic)
        check_drive(found.fluid, found.domain, found.periodic)
        if found.fluid.bed_mixing is not None:
            check_bed_mixing(found.boundary)
    check_fluid_walls(found.walls, found.fluid, found.coupling if found.fluid is not None else None)
    carries = "heat" if scene.heat is not None else "[scalars]" if scene.scalars else ""
    check_openings(found.walls, scene.surface is not None, carries)
    has_fluid, several = found.fluid is not None, bool(found.materials)
    check_heat(found.heat, found.scalars, found.boundary, found.walls, found.particles, has_fluid, several)
    check_reference(found.heat, found.surface.expansion if found.surface else 0.0)
    has = found.particles is not None, found.fluid is not None
    _check_surface(found)
    time = found.time
    place = ProbePlace(found.box, time.end, time.output_interval, *has, found.walls, found.boundary, found.output.walls)
    found = found.model_copy(update={"probes": completed_probes(found.probes, place)})
    if found.coupling is not None and found.coupling.basset and found.comes_and_goes:
        limit = "its history is kept only for particles that are present from the start to the end"
        remedy = "set it to 0, or use a scene in which no particle enters or leaves"
        raise InputError("coupling.basset", found.coupling.basset, limit, remedy)
    return found


def _check_surface(scene: Scene) -> None:
    """Refuses a second fluid that does not fit the rest of the scene."""
    others: dict[str, tuple[bool, object, str]] = {}
    if scene.particles is not None:
        others |= of_one_fluid(scene.coupling or Coupling(), scene.contact, scene.output.samples)
    goes_on = scene.start is not None and scene.start.fluid == "keep"
    check_surface(scene.surface, scene.fluid, scene.domain, scene.boundary, others, goes_on)
    check_surface_heat(scene.surface, scene.heat is not None)
    check_surface_beside_walls(scene.surface, scene.walls, scene.heat is not None, bool(scene.scalars))


def _check_gaps(scene: Scene) -> None:
    """Refuses a cohesion, or a lubrication, that does not fit the rest of the scene."""
    table = None if scene.contact is None else scene.contact.cohesion
    check_strengths(table, {"materials": scene.materials, "material_pairs": scene.material_pairs})
    if table is not None and scene.particles is not None:
        others = {
            "particles that enter or leave": scene.comes_and_goes,
            "walls that have begin or end": any(wall.begin or wall.end for wall in scene.walls),
            "[start]": scene.start is not None,
        }
        check_together(table, bool(scene.materials), scene.particles.coarse_grain, others)
    if scene.contact is not None and scene.contact.lubrication is not None and scene.particles is not None:
        liquid = {
            f"parcels (particles.coarse_grain = {scene.particles.coarse_grain:g}), for which it has no rule": (
                scene.particles.coarse_grain != 1.0
            ),
            "liquid bridges (contact.cohesion.kind = capillary): particles are within liquid, or hold some": (
                scene.contact.cohesion_kind == "capillary"
            ),
        }
        check_lubrication(scene.contact.lubrication, scene.fluid is not None, liquid)


def _check_bonds(scene: Scene) -> None:
    """Refuses what does not go together with bonds."""
    particles = scene.particles
    if particles is None or not scene.bonds:
        return
    settled = scene.start is None and any(pack.kind == "settled" for pack in particles.packs)
    before = "bonds are made before it has settled; settle it in a stage of its own, and bond in the next"
    parcels = "there is no rule for the strength of a parcel"
    others: dict[str, tuple[bool, object, str]] = {
        "particles.coarse_grain": (particles.coarse_grain != 1.0, particles.coarse_grain, parcels),
        "particles.pack.kind": (settled, "settled", before),
    }
    check_bonds(scene.bonds, others)


def _check_tables(scene: Scene) -> None:
    """Refuses tables that need another one."""
    if scene.particles is None:
        for name in ("walls", "materials", "material_pairs", "bonds"):
            if name == "walls" and all(wall.seen_by_fluid for wall in scene.walls):
                continue
            if getattr(scene, name):
                remedy = f"remove [[{name}]], or add [particles]"
                raise InputError(name, number_of_tables(getattr(scene, name)), "need [particles]", remedy)
        for name in ("contact", "coupling"):
            if getattr(scene, name) is not None:
                raise InputError(name, "...", "needs [particles]", f"add [particles] or remove [{name}]")
        if scene.fluid is None:
            raise InputError(
                "particles", None, "a scene needs particles, a fluid or both", "add [particles] or [fluid]"
            )
    start = scene.start
    if start is not None and scene.particles is None and (start.remove or start.add or start.relax):
        name = next(name for name in ("remove", "add", "relax") if getattr(start, name))
        limit = "the run that the scene begins from has no particles"
        raise InputError(f"start.{name}", "...", limit, f"remove start.{name}; [particles] places the first ones")
    if start is not None and start.add is not None and scene.particles is not None:
        ratio = scene.particles.coarse_grain
        if start.add.coarse_grain != ratio:
            limit = f"all particles stand for as many grains, and particles.coarse_grain is {ratio:g}"
            raise InputError("start.add.coarse_grain", start.add.coarse_grain, limit, f"set it to {ratio:g}")
    if scene.particles is None or scene.fluid is None:
        for name in scene.closure.given():
            value = getattr(scene.closure, name)
            raise InputError(f"closure.{name}", value, "needs both [fluid] and [particles]", "remove [closure]")


def _completed_domain(scene: Scene) -> Domain:
    gravity, depth = scene.domain.gravity, scene.domain.depth
    if gravity is None:
        gravity = (0.0,) * (scene.dimension - 1) + (-9.81,)
    if scene.dimension == 2 and depth is None:
        depth = 2.0 * largest_radius(scene.particles) / scene.particles.coarse_grain if scene.particles else 1.0
    return scene.domain.model_copy(update={"gravity": gravity, "depth": depth})
