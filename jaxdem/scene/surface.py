"""The table `[surface]`: a second, lighter fluid, and where the surface between both is at the start."""

from __future__ import annotations

from collections.abc import Mapping

from jaxdem.errors import InputError
from jaxdem.scene.base import Finite, NonNegative, Positive, Section, Tables, at_all_times
from jaxdem.scene.boundary import BoundarySide
from jaxdem.scene.contact import Contact
from jaxdem.scene.coupling import Coupling
from jaxdem.scene.domain import Domain
from jaxdem.scene.fluid import Fluid
from jaxdem.scene.regions import Region

ADVECTION = ("limited", "superbee", "upwind")
"""Schemes that keep the momentum of both fluids apart."""


class Surface(Section):
    """A second fluid with a sharp surface to that of `[fluid]`, which is the liquid. The liquid is below `level` and in
    `regions`; the second fluid has the rest of the box. A scene with `[start]` that keeps the fluid of its run keeps
    its liquid, and `level` and `regions` do not count.

    Attributes:
        density: density of the second fluid, at most that of the liquid [kg/m3].
        viscosity: kinematic viscosity of the second fluid [m2/s].
        tension: surface tension between both fluids [N/m].
        level: height of the liquid at the start, along the last axis. Default: there is none but in `regions` [m].
        regions: parts of the box with liquid at the start; as those of packs, also inside of a mesh.
        heat_capacity: heat capacity of the second fluid at constant pressure. Needed with `[heat]`, whose keys of the
            fluid are those of the liquid [J/(kg K)].
        conductivity: thermal conductivity of the second fluid. Needed with `[heat]` [W/(m K)].
        expansion: thermal expansion coefficient of the second fluid, as `heat.expansion` is that of the liquid; both
            have their densities at `heat.reference_temperature` [1/K].
        temperature: temperature of the second fluid at the start. Default: `heat.fluid_temperature` [K].
    """

    density: Positive = 1.2
    viscosity: NonNegative = 1.5e-5
    tension: NonNegative = 0.0
    level: Finite | None = None
    regions: Tables[Region] = ()
    heat_capacity: Positive | None = None
    conductivity: Positive | None = None
    expansion: Finite = 0.0
    temperature: Finite | None = None


def check_surface(
    surface: Surface | None,
    fluid: Fluid | None,
    domain: Domain,
    boundary: Mapping[str, BoundarySide],
    others: Mapping[str, tuple[bool, object, str]],
    goes_on: bool,
) -> None:
    """Refuses a second fluid that does not fit the rest of a scene.

    Args:
        surface: the table; None without.
        fluid: the table `[fluid]`.
        domain: the box, with its gravity.
        boundary: its sides.
        others: by key, whether the scene has what does not go together with two fluids, its value, and why.
        goes_on: whether the fluid is that of another run, with its liquid.

    Raises:
        InputError: naming the key.
    """
    if surface is None:
        for name, side in boundary.items():
            if side.level is not None:
                limit = "is of two fluids, and the scene has one"
                raise InputError(f"boundary.{name}.level", side.level, limit, "add [surface], or remove this key")
        return
    if fluid is None:
        raise InputError("surface", "...", "needs [fluid], the liquid", "add [fluid], or remove [surface]")
    for key, (there, value, reason) in others.items():
        if there:
            raise InputError(key, value, f"does not go together with [surface]: {reason}", "remove it, or [surface]")
    _check_fluid(surface, fluid)
    _check_place(surface, domain, goes_on, any((side.level or 0.0) > 0.0 for side in boundary.values()))
    _check_fall(fluid, domain, boundary)
    _check_sides(domain, boundary)


def check_surface_heat(surface: Surface | None, has_heat: bool) -> None:
    """Refuses numbers of the heat of a second fluid that are missing, or not used.

    Raises:
        InputError: naming the key.
    """
    if surface is None:
        return
    needed = {
        "heat_capacity": "the heat capacity of the second fluid [J/(kg K)]",
        "conductivity": "the thermal conductivity of the second fluid [W/(m K)]",
    }
    for name, meaning in needed.items() if has_heat else ():
        if getattr(surface, name) is None:
            raise InputError(f"surface.{name}", None, f"is needed in a scene with [heat]: {meaning}", "set it")
    for name in () if has_heat else (*needed, "expansion", "temperature"):
        value = getattr(surface, name)
        if value is not None and value != Surface.model_fields[name].default:
            limit = "the scene has no temperatures"
            raise InputError(f"surface.{name}", value, limit, "add [heat], or remove this key")


def of_one_fluid(coupling: Coupling, contact: Contact | None, samples: float) -> dict[str, tuple[bool, object, str]]:
    """Models of grains that know one density and one viscosity of the fluid: by key, whether there is one, its value,
    and why; for `check_surface`."""
    lubrication = None if contact is None else contact.lubrication
    reason = "it knows the density and viscosity of one fluid alone"
    without: dict[str, tuple[bool, object, str]] = {
        f"coupling.{name}": (bool(getattr(coupling, name)), getattr(coupling, name), reason)
        for name in ("lift", "rotational_drag", "virtual_mass", "basset")
    }
    coarse = coupling.drag_inputs_coarsened
    return without | {
        "coupling.drag_inputs_coarsened": (coarse > 1, coarse, "the coarser mesh has no surface"),
        "contact.lubrication.viscosity": (
            lubrication is not None and lubrication.viscosity is None,
            None,
            "the gaps would be full of liquid above the surface too; give the viscosity of what is in them",
        ),
        "output.samples": (samples > 0.0, samples, "a sample of the drag law is of one fluid"),
    }


def _check_fluid(surface: Surface, fluid: Fluid) -> None:
    if surface.density > fluid.density:
        limit = f"is the lighter fluid of both, and fluid.density is {fluid.density:g} kg/m3"
        raise InputError("surface.density", surface.density, limit, "give the numbers of both the other way round")
    if (surface.viscosity > 0.0) != (fluid.viscosity > 0.0):
        limit = f"both fluids have a viscosity or none has, and fluid.viscosity is {fluid.viscosity:g}"
        raise InputError("surface.viscosity", surface.viscosity, limit, "set both above 0, or both to 0")
    if fluid.advection not in ADVECTION:
        limit = "has waves beside a surface at which the density jumps"
        raise InputError("fluid.advection", fluid.advection, limit, f"use one of {', '.join(ADVECTION)}")
    if fluid.model != "A":
        limit = "has no rule for two fluids"
        raise InputError("fluid.model", fluid.model, limit, 'set fluid.model = "A"')
    closures = {"smagorinsky": fluid.smagorinsky > 0.0, "bed_mixing": fluid.bed_mixing, "subgrid": fluid.subgrid}
    for name, value in closures.items():
        if value:
            limit = "models eddies in one fluid and has no rule for two"
            raise InputError(f"fluid.{name}", getattr(fluid, name), limit, "remove it, or [surface]")
    if fluid.bulk_velocity is not None:
        limit = "is not held where there are two fluids"
        raise InputError("fluid.bulk_velocity", fluid.bulk_velocity, limit, "give fluid.pressure_gradient, or gravity")


def _check_place(surface: Surface, domain: Domain, goes_on: bool, comes_in: bool) -> None:
    """`comes_in`: whether liquid may come in through a side."""
    height, level = domain.size[-1], surface.level
    if not surface.regions and not goes_on and (level is None or (level == 0.0 and not comes_in)):
        limit = "is needed where there are no regions: without liquid there is one fluid"
        if level is not None:
            limit = "leaves the box without liquid, and there are no regions and no side that liquid comes in through"
        raise InputError("surface.level", level, limit, "set a surface.level above 0, or add [[surface.regions]]")
    if level is not None and not 0.0 <= level <= height:
        limit = f"must lie in the box, 0 ... {height:g} m"
        raise InputError("surface.level", level, limit, "set a height within the box")


def _check_fall(fluid: Fluid, domain: Domain, boundary: Mapping[str, BoundarySide]) -> None:
    """Refuses a box that is periodic along the vertical, where nothing holds the liquid up."""
    if boundary["bottom"].kind != "periodic" or not any(row[-1] for row in domain.gravities):
        return
    if any(row[-1] for row in at_all_times(fluid.pressure_gradient)):
        return
    limit = "acts along the last axis, which is periodic: the liquid falls for ever, with a second surface at the seam"
    remedy = "close the bottom and the top, set that component to 0, or hold the fluids by fluid.pressure_gradient"
    raise InputError("domain.gravity", domain.gravity, limit, remedy)


def _check_sides(domain: Domain, boundary: Mapping[str, BoundarySide]) -> None:
    gravity = domain.gravity or (0.0,)
    rows = gravity if isinstance(gravity[0], tuple) else (gravity,)
    oblique = any(any(part != 0.0 for part in row[:-1]) or row[-1] > 0.0 for row in rows)  # type: ignore[index]
    for name, side in boundary.items():
        key = f"boundary.{name}.level"
        if side.kind not in ("inlet", "outlet"):
            if side.level is not None:
                raise InputError(key, side.level, f"is not used with kind = {side.kind}", "remove this key")
            continue
        if side.kind == "inlet" and side.level is None:
            limit = "is needed by an inlet: below this height liquid comes in, above it the second fluid"
            raise InputError(key, None, limit, "set it; 0 for the second fluid alone")
        if side.kind == "outlet" and oblique:
            limit = "the pressure beyond an outlet is that of fluids at rest, of which gravity is along the last axis"
            raise InputError("domain.gravity", domain.gravity, limit, f"change it, or boundary.{name}.kind")
