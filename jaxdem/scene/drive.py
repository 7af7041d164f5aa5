"""What drives a fluid round a periodic box: checks that need the sides of the box."""

from __future__ import annotations

from collections.abc import Sequence

from jaxdem.errors import InputError
from jaxdem.numerics.axes import AXES
from jaxdem.scene.base import at_all_times
from jaxdem.scene.domain import Domain
from jaxdem.scene.fluid import Fluid


def is_driven(fluid: Fluid, domain: Domain, periodic: Sequence[bool]) -> bool:
    """Whether a pressure gradient, a bulk velocity or gravity acts on the fluid along a periodic axis, at any time."""
    given = fluid.pressure_gradient is not None or fluid.bulk_velocity is not None
    return any(wraps and (given or weight > 0.0) for weight, wraps in zip(domain.gravity_along, periodic, strict=True))


def check_drive(fluid: Fluid, domain: Domain, periodic: Sequence[bool]) -> None:
    """Refuses a drive along an axis that is not periodic, two drives along one axis, and model B under gravity.

    Raises:
        InputError: see above.
    """
    gradient, bulk = at_all_times(fluid.pressure_gradient), at_all_times(fluid.bulk_velocity)
    for axis, (wraps, name) in enumerate(zip(periodic, AXES[len(periodic)], strict=True)):
        drops = any(row[axis] != 0.0 for row in gradient)
        flows = [row[axis] for row in bulk if row[axis] != "free"]
        for key, acts in (("pressure_gradient", drops), ("bulk_velocity", any(flow != 0.0 for flow in flows))):
            if acts and not wraps:
                limit = f"has a component along {name}, where the box is not periodic"
                remedy = (
                    f"set that component to 0, make both sides across {name} periodic, or use an inlet and an outlet"
                )
                raise InputError(f"fluid.{key}", getattr(fluid, key), limit, remedy)
        if drops and flows:
            limit = f"is given along {name}, where fluid.bulk_velocity is held: the gradient is a result there"
            remedy = 'set that component to 0, or that of fluid.bulk_velocity to "free"'
            raise InputError("fluid.pressure_gradient", fluid.pressure_gradient, limit, remedy)
        if 0 < len(flows) < len(bulk):
            limit = f'is "free" along {name} at some of the times and held at others'
            raise InputError("fluid.bulk_velocity", fluid.bulk_velocity, limit, "use one of both at all times")
        if wraps and domain.gravity_along[axis] > 0.0 and fluid.model == "B":
            limit = f"has no pressure gradient on particles, so it cannot have gravity along {name}, which is periodic"
            raise InputError("fluid.model", "B", limit, 'set fluid.model = "A", or that component of gravity to 0')


def check_own_gravity(gravity: Sequence[object] | None, periodic: Sequence[bool]) -> None:
    """Refuses gravity by default along a periodic axis of a fluid, where all would fall without end.

    Raises:
        InputError: the box is periodic along the vertical axis and the scene gives no gravity.
    """
    if periodic[-1] and gravity is None:
        limit = "is 9.81 m/s2 downwards by default, where the box is periodic: fluid and particles would fall for ever"
        remedy = "give domain.gravity: zeros for none, or the value, with fluid.bulk_velocity to hold the fluid"
        raise InputError("domain.gravity", None, limit, remedy)


def check_gravity(gravity: Sequence[float], driven: Sequence[bool], periodic: Sequence[bool]) -> None:
    """Refuses gravity along a periodic axis that the simulation was not built to be driven along.

    Raises:
        InputError: a component along a periodic axis is not zero, and the scene's is.
    """
    for component, wraps, acts, name in zip(gravity, periodic, driven, AXES[len(periodic)], strict=True):
        if wraps and component != 0.0 and not acts:
            limit = (
                f"has {component:.6g} m/s2 along {name}, where the box is periodic and the scene has none: it would act"
            )
            remedy = "build the simulation from a scene whose domain.gravity has that component, or set it to 0"
            raise InputError(
                "parameters.gravity", tuple(gravity), f"{limit} on the particles and not on the fluid", remedy
            )
