"""The table `[walls.wear]` of a scene: how grains wear a mesh."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from jaxdem.scene.base import Positive, Section, wrong

NEEDED = {
    "archard": {"coefficient": "the wear coefficient k", "hardness": "the hardness of the wall"},
    "finnie": {"coefficient": "the part of the grains that cut", "flow_stress": "the flow stress of the wall"},
}
"""Keys that each model must have, and what they are."""

OPTIONAL: dict[str, tuple[str, ...]] = {"archard": (), "finnie": ("force_ratio", "depth_ratio")}
"""Keys that it may have."""

FINNIE = {"force_ratio": 2.0, "depth_ratio": 2.0}
"""Values of Finnie for ductile metals."""


class Wear(Section):
    """Wear of a mesh: the volume that grains take from each of its triangles. The mesh keeps its shape.

    Attributes:
        model: "archard" (sliding: V = k N s / H, of the normal force N over the distance s of sliding) or "finnie"
            (impacts: V = c m v^2 / (p psi K) f(a) of a grain of mass m that arrives at a speed v and an angle a to the
            surface, with f = sin 2a - (6/K) sin^2 a up to tan a = K/6, and (K/6) cos^2 a beyond).
        coefficient: k of archard; c of finnie, the part of the grains that cut (0.5 by Finnie) [-].
        hardness: H of archard [Pa].
        flow_stress: p of finnie [Pa].
        force_ratio: K of finnie, vertical over horizontal force on a grain. Default: 2 [-].
        depth_ratio: psi of finnie, length of contact over depth of cut. Default: 2 [-].
    """

    model: Literal["archard", "finnie"]
    coefficient: Annotated[float, Field(gt=0.0, le=10.0, strict=True)]
    hardness: Positive | None = None
    flow_stress: Positive | None = None
    force_ratio: Positive | None = None
    depth_ratio: Positive | None = None

    @model_validator(mode="after")
    def _keys_of_its_model(self) -> Wear:
        needed, optional = NEEDED[self.model], OPTIONAL[self.model]
        for name in type(self).model_fields:
            value = getattr(self, name)
            if value is None and name in needed:
                raise wrong(name, None, f"is needed by model = {self.model}: {needed[name]}", "add this key")
            if value is not None and name not in ("model", *needed, *optional):
                limit = f"the keys of wear by {self.model} are {', '.join((*needed, *optional))}"
                raise wrong(name, value, limit, "remove this key")
        if self.model == "finnie":
            update = {name: value for name, value in FINNIE.items() if getattr(self, name) is None}
            return self.model_copy(update=update) if update else self
        return self
