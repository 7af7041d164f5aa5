"""The tables `[[particles.inlet]]` of a scene."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field, model_validator

from jaxdem.scene.base import (
    Abscissae,
    Corner,
    Finite,
    MaterialName,
    NonNegative,
    Positive,
    Section,
    Vector,
    check_table,
    wrong,
)
from jaxdem.scene.distribution import Distribution, check_no_radius
from jaxdem.scene.materials import Mixture, Species
from jaxdem.scene.regions import Region


class ParticleInlet(Section):
    """An inlet through which particles enter during the run. Values that are not given are those of `[particles]`.

    Attributes:
        side: side of the box; particles enter in a layer beside it that is one (largest) diameter thick. Give either
            this, or `start` and `stop`, or `region`.
        start: lower corner of a box in which particles enter; they lie wholly inside it [m].
        stop: upper corner of this box [m].
        region: part of the box in which particles enter, wholly inside it: a cylinder, sphere or polygon.
        from_: corner of a patch of the side, in the other axes (key `from`) [m].
        to: opposite corner of the patch [m].
        rate: particles per second. Give either this or `mass_flow`; with `times` one number for each time [1/s].
        mass_flow: mass per second; with `times` one number for each time [kg/s].
        times: increasing times for `rate` or `mass_flow`, from the start of the simulation. Linear between them,
            constant before the first and after the last; nothing before `begin` and after `end`. A particle is due when
            the integral of the rate has reached its number, or that of the mass flow the mass up to its own [s].
        velocity: velocity of the entering particles, one number per axis; at a side also the inward speed [m/s].
        begin: start of the inlet; the first particle is due 1 / rate later [s].
        end: end of the inlet; no particle is due later. Default: `time.end` [s].
        total: largest number of particles.
        radius: radius of these particles [m].
        distribution: distribution of the radii of these particles, in place of `radius`.
        density: density of these particles [kg/m3].
        material: name of one of `[[materials]]`.
        species: kinds of particles with their own radius, density or material, drawn according to their shares.
        temperature: temperature of these particles. Default: `heat.particle_temperature` [K].
    """

    side: str | None = None
    start: Vector | None = None
    stop: Vector | None = None
    region: Region | None = None
    from_: Corner | None = Field(default=None, alias="from")
    to: Corner | None = None
    rate: Positive | tuple[NonNegative, ...] | None = None
    mass_flow: Positive | tuple[NonNegative, ...] | None = None
    times: Abscissae | None = None
    velocity: Finite | Vector
    begin: NonNegative = 0.0
    end: Positive | None = None
    total: Annotated[int, Field(ge=1, le=100_000_000, strict=True)] | None = None
    radius: Positive | None = None
    distribution: Distribution | None = None
    density: Positive | None = None
    material: MaterialName | None = None
    species: Mixture = ()
    temperature: Finite | None = None

    @model_validator(mode="after")
    def _one_way_each(self) -> ParticleInlet:
        if (self.rate is None) == (self.mass_flow is None):
            raise wrong("rate", self.rate, "an inlet needs either rate or mass_flow", "give one of the two keys")
        if self.species and (self.radius or self.density or self.material):
            remedy = "remove radius, density and material of the inlet"
            raise wrong("species", "...", "have their own radius, density and material", remedy)
        given = {"radius": self.radius} | {f"species.{k}.radius": one.radius for k, one in enumerate(self.species)}
        check_no_radius(self.distribution, given)
        places = sum(given is not None for given in (self.side, self.start, self.region))
        if places != 1 or (self.start is None) != (self.stop is None):
            limit = "an inlet needs either a side, or start and stop of a box, or a region"
            raise wrong("side", self.side, limit, "give one of the three")
        if self.side is None and (self.from_ is not None or self.to is not None):
            raise wrong("from", self.from_ or self.to, "is only used with a side", "remove from and to")
        if (self.from_ is None) != (self.to is None):
            raise wrong("from", self.from_ or self.to, "a patch needs both from and to", "give both or neither")
        if self.side is None and isinstance(self.velocity, float):
            limit = "must be a vector, because without a side there is no inward direction"
            raise wrong("velocity", self.velocity, limit, "give one number per axis")
        return self

    @model_validator(mode="after")
    def _flow_over_time(self) -> ParticleInlet:
        """One rate, or one for each of the times."""
        name, given = self.flow
        check_table("times", self.times, name, given if isinstance(given, tuple) else None)
        if isinstance(given, tuple) and not any(given):
            raise wrong(name, given, "is zero at all times", "give a positive number, or remove the inlet")
        return self

    @property
    def flow(self) -> tuple[str, float | tuple[float, ...]]:
        """`rate` or `mass_flow`, whichever is given, and its value: one for each of the `times`, if any."""
        return ("rate", self.rate or 0.0) if self.mass_flow is None else ("mass_flow", self.mass_flow)

    def species_of(self, others: tuple[Species, ...]) -> tuple[Species, ...]:
        """Its species: its own, one of its own numbers, or those of `[particles]`."""
        own = Species.model_construct(share=1.0, radius=self.radius, density=self.density, material=self.material)
        has_own = any(value is not None for value in (self.radius, self.distribution, self.density, self.material))
        return self.species or ((own,) if has_own or not others else others)


def inlet_speed(inlets: tuple[ParticleInlet, ...]) -> float:
    """Largest speed with which particles come in; zero without inlets [m/s]."""
    velocities = [inlet.velocity for inlet in inlets]
    return max((math.hypot(*v) if isinstance(v, tuple) else abs(v) for v in velocities), default=0.0)
