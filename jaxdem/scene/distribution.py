"""The tables `[particles.distribution]` and `[particles.inlet.distribution]` of a scene."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field, model_validator

from jaxdem.scene.base import Abscissae, Positive, Section, check_table, wrong

KEYS: dict[str, tuple[str, ...]] = {
    "normal": ("mean", "standard_deviation", "lower", "upper"),
    "lognormal": ("median", "log_standard_deviation", "lower", "upper"),
    "weibull": ("scale", "shape", "lower", "upper"),
    "table": ("cumulative",),
}
"""Keys that each kind needs; a table needs radii or diameters too, and may have cut-offs."""


class Distribution(Section):
    """Sizes of particles, drawn with the seed of the scene. All lengths are radii, but for `diameters`.

    Attributes:
        kind: "normal", "lognormal", "weibull" (by volume that of Rosin and Rammler), or "table": a cumulative curve,
            such as a sieve curve, linear between its points.
        by: what the distribution counts: the number of particles, or their volume (of spheres, in 2-D too). Default:
            "volume" for a table, "number" for the others.
        mean: of a normal distribution, before the cut-offs [m].
        standard_deviation: of a normal distribution, before the cut-offs [m].
        median: of a lognormal distribution, before the cut-offs [m].
        log_standard_deviation: standard deviation of ln(radius) of a lognormal distribution, before the cut-offs [-].
        scale: of a Weibull distribution: 63.2 % are smaller, before the cut-offs [m].
        shape: of a Weibull distribution: the exponent [-].
        radii: of a table, increasing. Give either this or `diameters` [m].
        diameters: of a table, increasing, such as openings of sieves [m].
        cumulative: of a table: fraction that is smaller than each radius or diameter, from 0 to 1 [-].
        lower: smallest radius. The distribution is cut there and made whole again; nothing gathers at a cut. Needed by
            all kinds but a table, whose default is its first radius [m].
        upper: largest radius. Needed by all kinds but a table, whose default is its last radius [m].
    """

    kind: Literal["normal", "lognormal", "weibull", "table"]
    by: Literal["number", "volume"] | None = None
    mean: Positive | None = None
    standard_deviation: Positive | None = None
    median: Positive | None = None
    log_standard_deviation: Annotated[float, Field(gt=0.0, le=5.0, strict=True)] | None = None
    scale: Positive | None = None
    shape: Annotated[float, Field(ge=0.1, le=1000.0, strict=True)] | None = None
    radii: Abscissae | None = None
    diameters: Abscissae | None = None
    cumulative: tuple[Annotated[float, Field(ge=0.0, le=1.0, strict=True)], ...] | None = None
    lower: Positive | None = None
    upper: Positive | None = None

    @property
    def table_radii(self) -> tuple[float, ...]:
        """Radii of a table [m]; empty for the other kinds."""
        return self.radii or tuple(0.5 * diameter for diameter in self.diameters or ())

    @property
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest radius [m]."""
        if self.lower is None or self.upper is None:
            raise ValueError("a distribution that was not validated")
        return self.lower, self.upper

    def number(self, name: str) -> float:
        """A number that the kind needs, by its key."""
        value = getattr(self, name)
        if not isinstance(value, float):
            raise ValueError(f"a {self.kind} distribution has no {name}")
        return value

    @model_validator(mode="after")
    def _keys_of_its_kind(self) -> Distribution:
        needed = KEYS[self.kind]
        of_table = ("radii", "diameters", "lower", "upper") if self.kind == "table" else ()
        for name in type(self).model_fields:
            value = getattr(self, name)
            if name in ("kind", "by") or (value is None) == (name not in needed) or name in of_table:
                continue
            limit = f"a {self.kind} distribution needs {', '.join(needed)}"
            if name in ("lower", "upper"):
                limit += "; the smallest radius decides the time step, the largest the neighbour list"
            raise wrong(name, value, limit, "add this key" if value is None else "remove this key")
        update: dict[str, object] = {"by": self.by or ("volume" if self.kind == "table" else "number")}
        if self.kind == "table":
            update |= self._checked_table()
        lower, upper = update.get("lower", self.lower), update.get("upper", self.upper)
        if not (isinstance(lower, float) and isinstance(upper, float) and lower < upper):
            raise wrong("upper", upper, f"must be above lower = {lower} m", "raise it, or lower the other")
        return self.model_copy(update=update)

    def _checked_table(self) -> dict[str, object]:
        """The cut-offs of a table, its curve checked."""
        if (self.radii is None) == (self.diameters is None):
            remedy = "give one of the two"
            raise wrong("radii", self.radii, "a table needs either radii or diameters", remedy)
        name = "radii" if self.radii is not None else "diameters"
        check_table(name, self.radii or self.diameters, "cumulative", self.cumulative)
        radii, cumulative = self.table_radii, self.cumulative or ()
        if radii[0] <= 0.0:
            raise wrong(name, radii[0], "the first size must be above 0", "give the size that none is smaller than")
        for a, b in itertools.pairwise(cumulative):
            if b < a:
                raise wrong("cumulative", cumulative, f"must not fall, but {b} follows {a}", "sort the entries")
        if (cumulative[0], cumulative[-1]) != (0.0, 1.0):
            limit = "must begin with 0 and end with 1: the curve has to say how small and how large the particles are"
            remedy = "add the size that none is smaller than, and the one that all are smaller than; 1 is 100 %"
            raise wrong("cumulative", cumulative, limit, remedy)
        lower, upper = self.lower or radii[0], self.upper or radii[-1]
        for key, value in (("lower", lower), ("upper", upper)):
            if not radii[0] <= value <= radii[-1]:
                limit = f"must lie in the table, {radii[0]:.6g} ... {radii[-1]:.6g} m (radii)"
                raise wrong(key, value, limit, "move it into the table, or remove this key")
        return {"lower": lower, "upper": upper}


def check_no_radius(distribution: Distribution | None, radii: Mapping[str, object]) -> None:
    """Refuses radii that a table gives beside its distribution; `radii` has them by key, None for nothing."""
    for key, value in radii.items():
        if distribution is not None and value is not None:
            limit = "cannot be given together with the distribution, from which the radii are drawn"
            raise wrong(key, value, limit, "remove this key, or the key distribution")
