"""The table `[contact]`."""

from __future__ import annotations

from typing import Annotated, Literal, overload

from pydantic import Field, model_validator

from jaxdem.scene.base import WALL, Fraction, NonNegative, Poisson, Positive, Section, WallMaterialName, wrong
from jaxdem.scene.cohesion import Cohesion
from jaxdem.scene.lubrication import Lubrication
from jaxdem.scene.materials import HERTZ
from jaxdem.scene.unread import ReadWith

LINEAR = ReadWith("contact.law = linear_spring_dashpot")
POISSON = ReadWith("contact.law = hertz_mindlin", "heat.particle_conductivity")
ROLLS = ReadWith("contact.rolling_friction", "materials.K.rolling_friction", "material_pairs.K.rolling_friction")
PARCELS = ReadWith("particles.coarse_grain")


class Contact(Section):
    """Contacts of particles with each other and with walls.

    Attributes:
        law: contact law, "hertz_mindlin" or "linear_spring_dashpot".
        young_modulus: Young's modulus of the particles [Pa].
        poisson_ratio: Poisson's ratio of the particles [-].
        restitution: coefficient of restitution, rebound speed over approach speed [-].
        friction: coefficient of sliding (Coulomb) friction [-].
        rolling_friction: coefficient of rolling friction; 0 for none [-].
        rolling_model: "cdt" (constant directional torque) or "epsd" (elastic-plastic spring and dashpot).
        rolling_damping: damping ratio of the spring of "epsd"; 1 is critical [-].
        wall_young_modulus: Young's modulus of the walls, or "rigid". Default: that of the particles [Pa].
        wall_poisson_ratio: Poisson's ratio of the walls. Default: that of the particles [-].
        wall_friction: coefficient of friction between particles and walls. Default: that of the particles [-].
        wall_material: name of one of `[[materials]]` for the walls, in place of the three `wall_` keys above.
        normal_stiffness: normal stiffness of the linear law [N/m].
        tangential_stiffness: tangential stiffness of the linear law. Default: 2/7 of the normal stiffness [N/m].
        time_step: contact step. "auto" takes a step that is stable and resolves an impact [s].
        speed: largest expected speed, for the automatic time step and the expected overlap. "auto" computes it from the
            inlets, the initial velocities and a fall through the box [m/s].
        maximum_overlap: largest expected overlap that is accepted, over the diameter [-].
        skin: additional reach of the neighbour list over the largest diameter. "auto" is 0.4 of
            the mean diameter, of clumps of the largest one of a member [-].
        parcel_loss: what impacts between parcels (`particles.coarse_grain` = l) have in common with those of their
            grains: "impact", the coefficient of restitution e; "rate", the rate at which agitated grains lose energy,
            with e_p of 1 - e_p^2 = l (1 - e^2). Impacts on walls have e.
        cohesion: what pulls particles together. Default: nothing.
        lubrication: what the liquid in narrow gaps does. Default: nothing.
    """

    law: Literal["hertz_mindlin", "linear_spring_dashpot"] = "hertz_mindlin"
    young_modulus: Annotated[Positive, HERTZ] = 7e7
    poisson_ratio: Annotated[Poisson, POISSON] = 0.3
    restitution: Fraction = 0.7
    friction: NonNegative = 0.5
    rolling_friction: NonNegative = 0.0
    rolling_model: Annotated[Literal["cdt", "epsd"], ROLLS] = "cdt"
    rolling_damping: Annotated[Fraction, ReadWith(".rolling_model = epsd"), ROLLS] = 0.3
    wall_young_modulus: Annotated[Positive | Literal["rigid"] | None, HERTZ] = None
    wall_poisson_ratio: Annotated[Poisson | None, HERTZ] = None
    wall_friction: NonNegative | None = None
    wall_material: WallMaterialName | None = None
    normal_stiffness: Annotated[Positive | None, LINEAR] = None
    tangential_stiffness: Annotated[NonNegative | None, LINEAR] = None
    time_step: Positive | Literal["auto"] = "auto"
    speed: Positive | Literal["auto"] = "auto"
    maximum_overlap: Annotated[float, Field(gt=0.0, le=0.5, strict=True)] = 0.2
    skin: Annotated[float, Field(gt=0.0, le=2.0, strict=True)] | Literal["auto"] = "auto"
    parcel_loss: Annotated[Literal["impact", "rate"], PARCELS] = "impact"
    cohesion: Cohesion | None = None
    lubrication: Lubrication | None = None

    @model_validator(mode="after")
    def _walls_have_one_material(self) -> Contact:
        """What follows a constant of the particles is not written in: it would be a number of its own."""
        if self.law == "linear_spring_dashpot" and self.normal_stiffness is None:
            limit = "is needed by contact.law = linear_spring_dashpot"
            raise wrong("normal_stiffness", None, limit, "set a stiffness [N/m]")
        if self.cohesion is not None and self.cohesion.kind == "jkr" and self.law != "hertz_mindlin":
            limit = f"needs the stiffness of Hertz's law, and contact.law = {self.law}"
            raise wrong("cohesion.kind", "jkr", limit, "set contact.law = hertz_mindlin, or take kind = dmt")
        if self.wall_material == WALL:  # the name of walls without a material
            return self.model_copy(update={"wall_material": None})
        for name in ("wall_young_modulus", "wall_poisson_ratio", "wall_friction"):
            if self.wall_material is not None and getattr(self, name) is not None:
                limit = f"the walls already have this constant from contact.wall_material = {self.wall_material!r}"
                raise wrong(name, getattr(self, name), limit, "remove one of the two keys")
        return self

    @property
    def cohesion_kind(self) -> str | None:
        """What pulls particles together; None for nothing."""
        return None if self.cohesion is None else self.cohesion.kind

    @overload
    def of_walls(self, name: Literal["young_modulus"]) -> float | Literal["rigid"]: ...
    @overload
    def of_walls(self, name: Literal["poisson_ratio", "friction"]) -> float: ...
    def of_walls(self, name: str) -> float | Literal["rigid"]:
        """A constant of the walls; the particles' where none is given."""
        own: float | Literal["rigid"] | None = getattr(self, f"wall_{name}")
        of_particles: float = getattr(self, name)
        return of_particles if own is None else own
