"""The laws of a scene that may be learned: drag and subgrid stress."""

from __future__ import annotations

from jaxdem.closures import drag_law, load_closure, load_subgrid
from jaxdem.closures.base import DragClosure, as_closure
from jaxdem.errors import InputError
from jaxdem.fluid.subgrid_stress import SubgridLaw
from jaxdem.scene import Scene
from jaxdem.scene.coupling import Coupling
from jaxdem.scene.fluid import Fluid


def drag_closure(scene: Scene, coupling: Coupling, own: DragClosure | None) -> DragClosure:
    """The drag law of a scene: `own` of the user, else of its `closure.file`, else the correlation that it names.

    Raises:
        InputError: no law has that name, the file cannot be read, or it was trained in another dimension.
    """
    file = scene.closure.file
    closure = own
    if closure is None:
        closure = drag_law(coupling.drag) if file is None else load_closure(file)[0]
    trained = getattr(closure, "dimension", scene.dimension)
    if trained != scene.dimension:
        limit = f"was trained in {trained}-D, the scene is {scene.dimension}-D"
        raise InputError("closure.file", file, limit, f"train a closure on {scene.dimension}-D runs")
    return as_closure(closure)


def subgrid_closure(fluid: Fluid, own: SubgridLaw | None) -> SubgridLaw | None:
    """The learned subgrid stress: `own` of the user, else of `fluid.subgrid`; None without.

    Raises:
        InputError: the file cannot be read, or one is given beside another model of the same eddies.
    """
    for key, there in (("smagorinsky", fluid.smagorinsky > 0.0), ("bed_mixing", fluid.bed_mixing is not None)):
        if own is not None and there:
            limit = "models the same unresolved eddies as the subgrid closure that is given in Python"
            raise InputError(f"fluid.{key}", getattr(fluid, key), limit, f"remove fluid.{key} or subgrid=")
    if own is not None or fluid.subgrid is None:
        return own
    return load_subgrid(fluid.subgrid)[0]
