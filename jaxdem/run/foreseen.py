"""What is known of the end of a run before it has run: enough to check the scene that begins from there."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from jaxdem.run.restart import about
from jaxdem.setup.builder import Case
from jaxdem.setup.start_point import StartPoint
from jaxdem.setup.stored import named


def foreseen_end(case: Case) -> StartPoint:
    """The end of a run, as far as its scene tells it: time, intervals, sizes and queues, and where particles begin.

    All that are due have come in by then; where particles are is not known, so they stand where they start.
    """
    steps = case.simulation.steps
    state = case.first_state()[0]
    arrays = named("state", state)
    if case.particles is not None and case.particles.queues:
        came = [len(queue.rows) for queue in case.particles.queues]
        arrays["state.particles.inserted"] = np.asarray(came, np.int32)
    rows, attributes = about(case, Fraction(repr(float(case.scene.time.end))))
    done = int(state.step) + steps.outputs * steps.intervals_per_output
    arrays["state.step"] = np.asarray(done, np.int32)
    return StartPoint("the stage before", arrays | rows, attributes, foreseen=True)
