"""What a part of a scene adds to the files of a run: arrays of frames, columns of the history, figures of the summary.

A part derives from `Part`, overrides what it has, and stands in `PARTS`. Host side.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxdem.run.instant import Instant
from jaxdem.run.totals import Means, Totals
from jaxdem.setup.builder import Case

Arrays = Mapping[str, np.ndarray]
"""Arrays by name."""


class Part:
    """A part of a scene in what a run writes. Every method gives {} in a scene without the part.

    Attributes:
        name: under which `Totals` keep what the part gives at the start.
    """

    name = ""

    def arrays(self, case: Case, instant: Instant) -> Mapping[str, Arrays]:
        """Arrays of a frame, by the series that they belong to, see `jaxdem.io.series`; units are in `io.vtkhdf.UNITS`.

        Args:
            case: that runs.
            instant: of the frame.
        """
        return {}

    def columns(self, case: Case, instant: Instant, means: Means) -> Mapping[str, float]:
        """Values of its columns of history.csv, which `jaxdem.io.part_columns` describes.

        Args:
            case: that runs.
            instant: of the row.
            means: since the last output.
        """
        return {}

    def start(self, case: Case, instant: Instant) -> float | tuple[float, ...] | None:
        """What its summary compares the end with, kept in `Totals.at_start`; None for nothing.

        Args:
            case: that runs.
            instant: of the first state.
        """
        return None

    def summary(self, case: Case, instant: Instant, totals: Totals) -> Mapping[str, Any]:
        """Entries of summary.json.

        Args:
            case: that ran.
            instant: that it has reached.
            totals: of the run.
        """
        return {}
