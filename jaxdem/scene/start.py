"""The table `[start]`: a scene that begins where another run is."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any, Literal

from pydantic import Field, ValidatorFunctionWrapHandler, field_validator, model_validator

from jaxdem.errors import InputError, number_of_tables
from jaxdem.scene.base import NonNegative, Section, Tables, wrong
from jaxdem.scene.particles import Particles
from jaxdem.scene.regions import Region

OF_PARTICLES = re.compile(r"\bparticles\.(?=[a-z])")
"""What messages about the table `[particles]` have before a key."""


@contextmanager
def keys_of_added() -> Iterator[None]:
    """Messages about `[particles]` have the keys of `start.add`, a table of the same keys."""
    try:
        yield
    except InputError as error:
        key, limit, remedy = (OF_PARTICLES.sub("start.add.", x) for x in (error.key, error.limit, error.remedy))
        raise InputError(key, error.value, limit, remedy) from error


class Start(Section):
    """A run from whose state this scene begins. Its clock goes on: `time.end` counts from the very first run.

    Particles with their sizes, densities, materials and identities are those of that run, and so are the keys of
    `[particles]`: they need not be repeated, and must not differ. Inlets may, and `coarse_grain` may be larger: then
    the particles are merged into parcels first. What else is changed of the particles at the start is given here, in
    the order remove, add, relax.

    Attributes:
        from_: the run directory, relative to the scene file (key `from`).
        time: take the frame at this time. Default: the newest checkpoint. A frame holds no contact springs and no face
            velocities: springs start at rest, and face velocities are made from the means of the cells [s].
        fluid: "keep" goes on with the fluid of the run, "new" starts it anew with `fluid.velocity`, and what it
            carries with the values of this scene.
        remove: regions; particles whose centres lie in one of them are removed.
        add: particles to be added, with the keys of `[particles]` except `inlet`. They must not overlap those that are
            there.
        relax: whether particles that overlap each other, a side of the box or one of `[[walls]]` are moved apart. Their
            contact springs start at rest.
        absent: whether some particles of the run may have left, or have still to come in. Default: what the scene of
            that run says.
    """

    from_: Annotated[str, Field(alias="from", min_length=1)]
    time: NonNegative | None = None
    fluid: Literal["keep", "new"] = "keep"
    remove: Tables[Region] = ()
    add: Particles | None = None
    relax: bool = Field(default=False, strict=True)
    absent: bool = Field(default=False, strict=True)

    @field_validator("add", mode="wrap")
    @classmethod
    def _with_its_keys(cls, value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        with keys_of_added():
            return handler(value)

    @model_validator(mode="after")
    def _placed_at_once(self) -> Start:
        if self.add is not None and self.add.inlet:
            raise wrong("add.inlet", number_of_tables(self.add.inlet), "is not added here", "use [[particles.inlet]]")
        if self.add is not None and any(pack.kind == "settled" for pack in self.add.packs):
            remedy = "use another kind; they settle as the run goes on"
            raise wrong("add.pack.kind", "settled", "is made before a run, and this one goes on", remedy)
        return self
