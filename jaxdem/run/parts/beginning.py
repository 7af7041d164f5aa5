"""How a scene began, in the summary of its run. Host side."""

from __future__ import annotations

from typing import Any

from jaxdem.run.instant import Instant
from jaxdem.run.parts.part import Part
from jaxdem.run.totals import Totals
from jaxdem.setup.builder import Case


class Packs(Part):
    """The packs of the first state."""

    def summary(self, case: Case, instant: Instant, totals: Totals) -> dict[str, Any]:
        """Number and solid fraction of every pack, before it settled."""
        packs = () if case.particles is None else case.particles.packs
        found = [
            {"kind": pack.pack.kind, "particles": pack.count, "solid_fraction": pack.solid_fraction} for pack in packs
        ]
        return {"packs": found} if found else {}


class RunBefore(Part):
    """The run that a scene begins from."""

    def summary(self, case: Case, instant: Instant, totals: Totals) -> dict[str, Any]:
        """Which one, and what was changed of it."""
        return {"start": case.start_figures} if case.start is not None else {}
