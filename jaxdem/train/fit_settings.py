"""The settings of a fit."""

from __future__ import annotations

import dataclasses
from typing import Any

from jaxdem.closures.invariant import FEATURES, check_features, check_terms
from jaxdem.closures.network import ACTIVATIONS
from jaxdem.errors import InputError, require_whole
from jaxdem.train.fit_loop import LOSSES


@dataclasses.dataclass(frozen=True)
class FitSettings:
    """How to fit; the defaults are the source paper's, `FitSettings.filtered()` has the other recipe's.

    Attributes:
        hidden: widths of the hidden layers.
        activation: a name of `ACTIVATIONS`.
        loss: a name of `LOSSES`; the filtered recipe knows "mse" and "balance", see `fit_filtered`.
        learning_rate: of Adamax (0.9, 0.999, 1e-7).
        schedule: "constant", or "cosine" down to a hundredth of the learning rate.
        batch: rows in a batch.
        epochs: passes through the data.
        samples: largest number of training rows, drawn by the seed; the filtered recipe shares them out
            evenly among the coarsenings.
        coarsenings: those used for training; None means the finest there is (paper) or all (filtered).
        terms: terms of the remainder (filtered), see `InvariantClosure`.
        features: what the network sees (filtered), names of `FEATURES` and `FURTHER_FEATURES` of
            `jaxdem.closures.invariant` in their order.
        bounded: whether the factor is at most one (filtered), see `InvariantClosure`.
        held_out: name of the run held out; None means the last dataset's.
        held_out_fraction: part of the time span held out where all data are of one run.
        seed: of initial weights, shuffling and the choice of rows.

    Source: Davydzenka & Tahmasebi (2022), J. Fluid Mech. 938, A20.
    """

    hidden: tuple[int, ...] = (170, 70, 30)
    activation: str = "elu"
    loss: str = "mse"
    learning_rate: float = 1e-3
    schedule: str = "constant"
    batch: int = 500
    epochs: int = 2000
    samples: int = 250_000
    coarsenings: tuple[int, ...] | None = None
    terms: tuple[str, ...] = ()
    features: tuple[str, ...] = FEATURES
    bounded: bool = False
    held_out: str | None = None
    held_out_fraction: float = 0.15
    seed: int = 0

    @classmethod
    def filtered(cls, **changes: Any) -> FitSettings:
        """Settings of the filtered recipe: a small network, large batches, a falling rate.

        One layer of 8: the smallest that kept R2 on the injection scene and the coarse run's error
        (docs/results/injection_study.md, "Cheaper closures").
        """
        defaults: dict[str, Any] = {
            "hidden": (8,),
            "learning_rate": 1e-2,
            "schedule": "cosine",
            "batch": 2000,
            "epochs": 200,
        }
        return cls(**{**defaults, **changes})

    def as_plain(self) -> dict[str, Any]:
        """The settings as JSON has them."""
        fields = dataclasses.asdict(self)
        return {name: list(value) if isinstance(value, tuple) else value for name, value in fields.items()}

    def __post_init__(self) -> None:
        """Raise InputError for a setting out of its range."""
        for name, known in (("activation", ACTIVATIONS), ("loss", (*LOSSES, "balance"))):
            value = getattr(self, name)
            if value not in known:
                raise InputError(name, value, "is not known", f"Use one of {', '.join(known)}.")
        if self.schedule not in ("constant", "cosine"):
            raise InputError("schedule", self.schedule, "is not known", "Use constant or cosine.")
        require_whole(self, ("batch", "epochs", "samples", "hidden", "coarsenings"), 1)
        require_whole(self, ("seed",), 0)
        if not self.learning_rate > 0:
            raise InputError("learning_rate", self.learning_rate, "must be positive", "Raise it.")
        check_terms(self.terms)
        check_features(self.features)
        if not 0 < self.held_out_fraction < 1:
            raise InputError("held_out_fraction", self.held_out_fraction, "must lie in (0, 1)", "Use 0.15.")
