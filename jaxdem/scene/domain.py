"""The tables `[domain]`, `[time]` and `[output]`."""

from __future__ import annotations

from pydantic import Field

from jaxdem.errors import InputError
from jaxdem.scene.base import (
    Finite,
    NonNegative,
    Positive,
    Section,
)

SIDES_2D = ("left", "right", "bottom", "top")
SIDES_3D = ("left", "right", "front", "back", "bottom", "top")
"""Sides in the order axis by axis, lower before upper; the last axis is up."""


MOST_OUTPUTS = 1_000_000
"""Frames that a run may write; more is a slip of the output interval's unit."""


class Domain(Section):
    """The box.

    Attributes:
        size: side lengths, two or three numbers; the last axis points up [m].
        depth: extent in the third direction, in 2-D only. Default: one (largest) diameter, or 1 m without particles [m].
        gravity: acceleration, one number per axis. Default: 9.81 downwards. With a fluid it must be zero along periodic
            axes [m/s2].
    """

    size: tuple[Positive, ...] = Field(min_length=2, max_length=3)
    depth: Positive | None = None
    gravity: tuple[Finite, ...] | None = None


class Time(Section):
    """Duration and output.

    Attributes:
        end: end of the simulation [s].
        output_interval: time between two frames and between two rows of `history.csv`; it must divide `end` [s].
    """

    end: Positive
    output_interval: Positive


class Output(Section):
    """Optional output.

    Attributes:
        samples: time between two samples of the inputs and results of the drag law; 0 for none [s].
        checkpoint_interval: wall time between two checkpoints; a checkpoint is written at the first output after it [s].
    """

    samples: NonNegative = 0.0
    checkpoint_interval: NonNegative = 60.0


def check_times(time: Time) -> None:
    """Refuse outputs that do not divide the run, or more than can be meant."""
    end, interval = time.end, time.output_interval
    frames = end / interval
    if frames > MOST_OUTPUTS:
        raise InputError(
            "time.output_interval",
            interval,
            f"makes {frames:.3g} outputs up to time.end = {end} s, the limit is {MOST_OUTPUTS}",
            f"raise it to at least {end / MOST_OUTPUTS:.3g} s",
        )
    if frames < 1.0 - 1e-9 or abs(frames - round(frames)) > 1e-6 * frames:
        nearest = end / max(1, round(frames))
        raise InputError(
            "time.output_interval",
            interval,
            f"must divide time.end = {end} s",
            f"use, for example, time.output_interval = {nearest:.6g}",
        )
