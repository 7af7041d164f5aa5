"""Keys of the scene that nothing reads, in the summary of a run."""

from __future__ import annotations

from jaxdem.run.instant import Instant
from jaxdem.run.parts.part import Part
from jaxdem.run.totals import Totals
from jaxdem.setup.builder import Case


class UnreadKeys(Part):
    """Keys that another model would read."""

    def summary(self, case: Case, instant: Instant, totals: Totals) -> dict[str, tuple[str, ...]]:
        """A sentence for each."""
        return {"unread_keys": case.unread} if case.unread else {}
