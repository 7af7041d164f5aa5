"""The tables `[[walls.opening]]` of a scene: inlets and outlets of the fluid on walls that it sees."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from jaxdem.scene.base import Abscissae, Finite, NonNegative, Section, check_table, wrong
from jaxdem.scene.regions import Region

SHAPES = ("box", "cylinder", "sphere")
"""Of the regions that an opening can be the part of a wall in."""

AMOUNTS = ("velocity", "flow", "velocities", "flows")
"""Keys of an inlet, of which it has one."""

OF_INLETS = (*AMOUNTS, "ramp_time", "times")


class Opening(Section):
    """An inlet or outlet of the fluid on a wall that it sees, along the normal of the wall. To grains it is a wall.

    Attributes:
        kind: "inlet", or "outlet": it takes what the volume of a box without another outlet leaves over. All outlets
            have one speed.
        region: the part of the wall that lies in it, with the keys of a region of the shapes "box", "cylinder" (3-D
            only) and "sphere". It moves with the wall, and must reach a cell beyond its surface to both sides. Default:
            the whole wall.
        velocity: of an inlet: superficial velocity along the normal of the wall, into the fluid, relative to the wall.
            Negative: suction [m/s].
        flow: of an inlet, in place of a velocity: what comes in by it in all, over the depth of the box in 2-D, on
            whatever mesh. Negative: suction [m3/s].
        ramp_time: time in which velocity or flow rises from zero. Default: 0.05 s for an inlet without `times`,
            otherwise 0 [s].
        times: increasing times, for an inlet that changes in time. Needs `velocities` or `flows` [s].
        velocities: velocities at these times, linear between them, constant before the first and after the last [m/s].
        flows: flows at these times, the same [m3/s].
        temperature: of the fluid that comes in; needed with `[heat]` by an inlet that brings some [K].
        scalars: values of `[[scalars]]` by name, the same.
    """

    kind: Literal["inlet", "outlet"]
    region: Region | None = None
    velocity: Finite | None = None
    flow: Finite | None = None
    ramp_time: NonNegative | None = None
    times: Abscissae | None = None
    velocities: tuple[Finite, ...] | None = None
    flows: tuple[Finite, ...] | None = None
    temperature: Finite | None = None
    scalars: dict[str, Finite] | None = None

    @model_validator(mode="after")
    def _one_amount(self) -> Opening:
        if self.kind == "outlet":
            for name in OF_INLETS:
                if getattr(self, name) is not None:
                    limit = "is of an inlet; an outlet takes what is left over"
                    raise wrong(name, getattr(self, name), limit, "remove this key, or give an inlet a negative flow")
            return self
        given = [name for name in AMOUNTS if getattr(self, name) is not None]
        if len(given) != 1:
            limit = "an inlet has one of velocity, flow, and, with times, velocities or flows"
            found = " and ".join(given) or None
            raise wrong("velocity", found, limit, "add a velocity" if not given else "leave one of them")
        table = "velocities" if self.by_velocity else "flows"
        if self.times is not None and given[0] != table:
            limit = f"is one for all times, and there are times; these need {table}"
            raise wrong(given[0], getattr(self, given[0]), limit, f"give {table} in its place, or remove times")
        check_table("times", self.times, table, getattr(self, table))
        return self

    @model_validator(mode="after")
    def _shape_of_its_region(self) -> Opening:
        if self.region is not None and self.region.shape not in SHAPES:
            limit = f"the region of an opening is one of {', '.join(SHAPES)}"
            raise wrong("region", self.region.shape, limit, "take one of these, or several openings")
        return self

    @property
    def ramped_over(self) -> float:
        """Over which its flow rises [s]."""
        default = 0.05 if self.kind == "inlet" and self.times is None else 0.0
        return default if self.ramp_time is None else self.ramp_time

    @property
    def brings(self) -> bool:
        """Whether fluid comes in through it at any time."""
        return max(self.amounts) > 0.0

    @property
    def given(self) -> str | None:
        """Key that says how much comes in; None of an outlet."""
        return next((name for name in AMOUNTS if getattr(self, name) is not None), None)

    @property
    def by_velocity(self) -> bool:
        """Whether its velocity is given."""
        return self.velocity is not None or self.velocities is not None

    @property
    def amounts(self) -> tuple[float, ...]:
        """Its velocities [m/s] or flows [m3/s] at all of its times; zero of an outlet."""
        given = self.velocities or self.flows
        return given or (self.velocity or self.flow or 0.0,)
