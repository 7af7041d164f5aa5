"""Learning a drag closure: dataset files, fits, training through the solver."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from jaxdem.errors import InputError


def check_trained(trained: Sequence[str], given: Collection[str]) -> None:
    """Refuse to train nothing, or what is not given; without JAX.

    Args:
        trained: names of closures, "drag" and "subgrid".
        given: those that there are.

    Raises:
        InputError: naming the option.
    """
    if not trained:
        raise InputError("--closure", "", "is needed, or --subgrid", "Give a closure file, or --subgrid new.")
    for name in trained:
        if name not in given:
            option = "--closure" if name == "drag" else "--subgrid"
            raise InputError("--train", name, f"needs {option}", f"Give {option}, or train another.")
