"""How a closure of neighbours is trained: its sizes, and the settings."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

from jaxdem.closures.moments import MomentBasis
from jaxdem.closures.neighbor_level import LARGE, Width
from jaxdem.errors import InputError, require_whole


class Size(NamedTuple):
    """How large a closure is.

    Attributes:
        basis, carried, widths, wake: see `NeighborClosure.initial`.
    """

    basis: MomentBasis
    carried: MomentBasis | None
    widths: tuple[Width, ...]
    wake: MomentBasis | None = None


SIZES = {
    "large": Size(
        MomentBasis(4.45, 10, 6, 3),
        MomentBasis(4.45, 6, 4, 2),
        (LARGE, LARGE._replace(scalars=124)),
        MomentBasis(2.0, 6, 4, 1, stretch=3.0, decay=6),
    ),
    "medium": Size(MomentBasis(4.45, 10, 6, 3), None, (LARGE,)),
    "short": Size(MomentBasis(3.25, 7, 5, 3), None, (Width(48, 12, (64, 64)),)),
    "small": Size(MomentBasis(2.5, 6, 4, 3), None, (Width(24, 8, (32, 32)),)),
}
"""The sizes by name; docs/results/neighbours.md compares errors and costs."""


@dataclasses.dataclass(frozen=True)
class NeighborSettings:
    """How to train.

    Attributes:
        size: a name of `SIZES`.
        hidden: widths of the hidden layers; None means those of the size.
        learning_rate: of Adamax, falling to a hundredth along a cosine.
        batch: spheres in a batch.
        epochs: passes through the data.
        samples: largest number of spheres to train on, drawn by whole arrays; None means all.
        held_out_fraction: part of the arrays of every group that is held out.
        seed: of initial weights, held-out arrays and shuffling.
    """

    size: str = "large"
    hidden: tuple[int, ...] | None = None
    learning_rate: float = 6e-3
    batch: int = 1000
    epochs: int = 40
    samples: int | None = None
    held_out_fraction: float = 0.1
    seed: int = 0

    def __post_init__(self) -> None:
        """Raise InputError for a setting out of its range."""
        if self.size not in SIZES:
            raise InputError("size", self.size, "is not known", f"Use one of {', '.join(SIZES)}.")
        require_whole(self, ("batch", "epochs", "samples", "hidden"), 1)
        require_whole(self, ("seed",), 0)
        if not self.learning_rate > 0:
            raise InputError("learning_rate", self.learning_rate, "must be positive", "Raise it.")
        if not 0 < self.held_out_fraction < 1:
            raise InputError("held_out_fraction", self.held_out_fraction, "must lie in (0, 1)", "Use 0.1.")
