"""The tables `[[particles.inlet]]` of a scene, and the key `boundary.<side>.particles`."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import Field, field_validator

from jaxdem.errors import InputError
from jaxdem.scene.base import Finite, NonNegative, Positive, Section
from jaxdem.scene.materials import Name, Species, check_material, check_species


class ParticleInlet(Section):
    """An inlet through which particles enter during the run. Values that are not given are those of `[particles]`.

    Attributes:
        side: side of the box; particles enter in a layer beside it that is one (largest) diameter thick. Give either this or `start`
            and `stop`.
        start: lower corner of a box in which particles enter; they lie wholly inside it [m].
        stop: upper corner of this box [m].
        from_: corner of a patch of the side, in the other axes (key `from`) [m].
        to: opposite corner of the patch [m].
        rate: particles per second. Give either this or `mass_flow` [1/s].
        mass_flow: mass per second [kg/s].
        velocity: velocity of the entering particles, one number per axis; at a side also the inward speed [m/s].
        begin: start of the inlet; the first particle is due 1 / rate later [s].
        end: end of the inlet; no particle is due later. Default: `time.end` [s].
        total: largest number of particles.
        radius: radius of these particles [m].
        density: density of these particles [kg/m3].
        material: name of one of `[[materials]]`.
        species: kinds of particles with their own radius, density or material, drawn according to their shares.
    """

    side: str | None = None
    start: tuple[Finite, ...] | None = None
    stop: tuple[Finite, ...] | None = None
    from_: tuple[Finite, ...] | None = Field(default=None, alias="from")
    to: tuple[Finite, ...] | None = None
    rate: Positive | None = None
    mass_flow: Positive | None = None
    velocity: Finite | tuple[Finite, ...]
    begin: NonNegative = 0.0
    end: Positive | None = None
    total: Annotated[int, Field(ge=1, le=100_000_000, strict=True)] | None = None
    radius: Positive | None = None
    density: Positive | None = None
    material: Name | None = None
    species: tuple[Species, ...] = ()

    @field_validator("from_", "to", mode="before")
    @classmethod
    def _corner(cls, value: Any) -> Any:
        return (value,) if isinstance(value, int | float) and not isinstance(value, bool) else value

    def species_of(self, particles: Any) -> tuple[Species, ...]:
        """Its species: its own, one of its own numbers, or those of `[particles]`."""
        if self.species:
            return self.species
        own = {name: getattr(self, name) for name in ("radius", "density", "material")}
        if particles.species and not any(own.values()):
            return tuple(particles.species)
        return (Species(share=1.0, **own),)


def completed_inlets(
    particles: Any, size: tuple[float, ...], sides: tuple[str, ...], periodic: tuple[bool, ...],
    end: float, names: tuple[str, ...],
) -> tuple[ParticleInlet, ...]:  # fmt: skip
    """The inlets with their region, velocity and end written in, checked.

    Args:
        particles: `[particles]`.
        size: of the box [m].
        sides: names of its sides, axis by axis.
        periodic: whether each axis is periodic.
        end: of the scene [s].
        names: of the materials.

    Raises:
        InputError: a key is missing, too many or wrong.
    """
    result = []
    for k, inlet in enumerate(particles.inlet):
        key = f"particles.inlet.{k}"
        if (inlet.rate is None) == (inlet.mass_flow is None):
            raise InputError(
                f"{key}.rate",
                inlet.rate,
                "an inlet needs either rate or mass_flow",
                "give one of the two keys",
            )
        if inlet.species and (inlet.radius or inlet.density or inlet.material):
            raise InputError(
                f"{key}.species",
                "...",
                "have their own radius, density and material",
                "remove radius, density and material of the inlet",
            )
        check_material(f"{key}.material", inlet.material, names)
        species = inlet.species_of(particles)
        check_species(f"{key}.species" if inlet.species else key, species, particles, names)
        largest = max(one.radius if one.radius is not None else particles.radius for one in species)
        region = _region(key, inlet, size, sides, periodic, largest)
        velocity = _velocity(key, inlet, sides, len(size))
        last = end if inlet.end is None else inlet.end
        if last <= inlet.begin:
            raise InputError(f"{key}.end", last, f"must be after begin = {inlet.begin} s", "raise the end")
        _check_room(f"{key}.stop", region, size, largest)
        result.append(
            inlet.model_copy(
                update={"start": region[0], "stop": region[1], "velocity": velocity, "end": last}
                | {"side": None, "from_": None, "to": None}
            )
        )
    return tuple(result)


def _region(
    key: str, inlet: ParticleInlet, size: tuple[float, ...], sides: tuple[str, ...],
    periodic: tuple[bool, ...], largest: float,
) -> tuple[tuple[float, ...], tuple[float, ...]]:  # fmt: skip
    """Corners of the box in which the particles come in."""
    if (inlet.side is None) == (inlet.start is None) or (inlet.start is None) != (inlet.stop is None):
        raise InputError(
            f"{key}.side",
            inlet.side,
            "an inlet needs either a side, or start and stop of a box",
            "give one of the two",
        )
    if inlet.start is not None and inlet.stop is not None:
        for name, corner in (("start", inlet.start), ("stop", inlet.stop)):
            if len(corner) != len(size):
                raise InputError(f"{key}.{name}", corner, f"needs {len(size)} numbers", f"give {len(size)} numbers")
        if inlet.from_ is not None or inlet.to is not None:
            raise InputError(f"{key}.from", inlet.from_ or inlet.to, "is only used with a side", "remove from and to")
        return inlet.start, inlet.stop
    if inlet.side not in sides:
        raise InputError(f"{key}.side", inlet.side, "there is no such side", f"known: {', '.join(sides)}")
    axis, upper = divmod(sides.index(inlet.side), 2)
    if periodic[axis]:
        raise InputError(f"{key}.side", inlet.side, "is a periodic side", "give start and stop of a box")
    others = [a for a in range(len(size)) if a != axis]
    if (inlet.from_ is None) != (inlet.to is None):
        raise InputError(
            f"{key}.from", inlet.from_ or inlet.to, "a patch needs both from and to", "give both or neither"
        )
    lower, higher = list(map(float, (0.0,) * len(size))), list(size)
    for position, a in enumerate(others):
        if inlet.from_ is not None and inlet.to is not None:
            if len(inlet.from_) != len(others) or len(inlet.to) != len(others):
                raise InputError(
                    f"{key}.from", inlet.from_, f"from and to need {len(others)} number(s)", "correct them"
                )
            lower[a], higher[a] = inlet.from_[position], inlet.to[position]
    # Room for rounding: a layer of exactly one diameter might not hold it.
    lower[axis] = size[axis] - 2.001 * largest if upper else 0.0
    higher[axis] = size[axis] if upper else 2.001 * largest
    return tuple(lower), tuple(higher)


def _check_room(
    key: str, region: tuple[tuple[float, ...], tuple[float, ...]], size: tuple[float, ...], largest: float
) -> None:
    for low, high, length in zip(*region, size, strict=True):
        if not (low >= 0.0 and high <= length):
            raise InputError(key, region, "the inlet must lie inside the box", "move the inlet")
        if high - low < 2.0 * largest:
            raise InputError(
                key, region, f"holds no particle of radius {largest:.4g} m: it needs {2 * largest:.4g} m along "
                "every axis", "enlarge the inlet",
            )  # fmt: skip


def _velocity(key: str, inlet: ParticleInlet, sides: tuple[str, ...], dimension: int) -> tuple[float, ...]:
    velocity = inlet.velocity
    axis, upper = divmod(sides.index(inlet.side), 2) if inlet.side is not None else (0, 0)
    if isinstance(velocity, float):
        if inlet.side is None:
            raise InputError(
                f"{key}.velocity", velocity, "must be a vector, because without a side there is no inward direction",
                f"give {dimension} numbers",
            )  # fmt: skip
        velocity = tuple((-velocity if upper else velocity) if a == axis else 0.0 for a in range(dimension))
    if len(velocity) != dimension:
        raise InputError(f"{key}.velocity", velocity, f"needs {dimension} numbers", f"give {dimension} numbers")
    if inlet.side is not None and (velocity[axis] >= 0.0 if upper else velocity[axis] <= 0.0):
        raise InputError(
            f"{key}.velocity",
            velocity,
            f"does not point into the box at side {inlet.side}",
            "reverse its direction",
        )
    return velocity


def check_exits(scene: Any) -> None:
    """Refuses to remove particles where that is not built or means nothing."""
    for name, side in scene.boundary.items():
        if side.particles == "screen":
            continue
        key = f"boundary.{name}.particles"
        reason = None
        if scene.particles is None:
            reason = "needs [particles]"
        elif side.kind == "periodic":
            reason = "particles cannot leave through a periodic side"
        elif scene.fluid is not None and side.kind != "outlet":
            reason = f"with a fluid, particles can leave only through an outlet, and this side is {side.kind}"
        elif side.from_ is not None:
            reason = "particles can leave only through a whole side, and this outlet is a patch"
        if reason is not None:
            raise InputError(key, side.particles, reason, 'set it to "screen"')


def check_history(scene: Any) -> None:
    """Refuses the Basset force for particles without a past."""
    if scene.coupling is not None and scene.coupling.basset and comes_and_goes(scene):
        raise InputError(
            "coupling.basset",
            scene.coupling.basset,
            "its history is kept only for particles that are present from the start to the end",
            "set it to 0, or use a scene in which no particle enters or leaves",
        )


def comes_and_goes(scene: Any) -> bool:
    """Whether the number of particles changes while the scene runs."""
    if scene.particles is None:
        return False
    return bool(scene.particles.inlet) or any(s.particles == "remove" for s in scene.boundary.values())


def inlet_speed(particles: Any) -> float:
    """Largest speed with which particles come in; zero without inlets [m/s]."""
    return max((math.hypot(*inlet.velocity) for inlet in particles.inlet), default=0.0)
