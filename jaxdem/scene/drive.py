"""What drives a fluid round a periodic box: nothing yet, so gravity along a periodic axis is refused."""

from __future__ import annotations

from collections.abc import Sequence

from jaxdem.errors import InputError

AXES = {2: "xz", 3: "xyz"}
"""Names of the axes; the last one is up."""


def check_drive(key: str, gravity: Sequence[float], periodic: Sequence[bool]) -> None:
    """Refuses gravity along a periodic axis in a scene with a fluid.

    The fluid's pressure is the reduced one, p - rho g.x, which is periodic like everything else: along a periodic axis
    the weight of the fluid drops out, and no wall holds it. Particles would feel that component and the fluid would
    not.

    Args:
        key: that holds it, for the message.
        gravity: (D,) [m/s2].
        periodic: whether each axis is periodic.

    Raises:
        InputError: a component along a periodic axis is not zero.
    """
    for axis, (component, wraps) in enumerate(zip(gravity, periodic, strict=True)):
        if wraps and component != 0.0:
            name = AXES[len(periodic)][axis]
            limit = f"has {component:.6g} m/s2 along {name}, where the box is periodic: it would act on the particles"
            remedy = f"set that component to 0, or close the box along {name} with walls. A key that drives a fluid"
            remedy += " through a periodic box, fluid.pressure_gradient, is planned but not there yet"
            raise InputError(key, tuple(gravity), f"{limit} and not on the fluid", remedy)
