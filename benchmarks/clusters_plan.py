"""The runs of the study `benchmarks/clusters.py`, by what they are for."""

from __future__ import annotations

from dataclasses import replace

from benchmarks.clusters_closures import AGAIN, ANEW, SEEN_FITS, Seen, tuned_name
from benchmarks.clusters_matched import CALIBRATED, MATCHED
from benchmarks.clusters_nudged import FITTED, LONGER_FITTED, MIXED_AGAIN, MIXED_FITTED
from benchmarks.clusters_runs import Case

FRACTIONS = (0.02, 0.05, 0.2)
"""Mean solid fractions at which all closures are compared."""
TRAINED_ON = (Case(0.05, samples=1), Case(0.1, samples=1, times=11))
"""Fine runs that closures are trained on, see `clusters_closures.FITS`."""
MODELS = ("", "radl", "regression", "network", "network2", "fraction", "bounded", "gradient")
"""Closures that are compared, see `clusters_closures`."""
COARSE = (12.0, 24.0)
"""Sides of coarse cells, in diameters."""
LOSSY = ("", "gradient")
"""Closures of the runs with parcels whose impacts keep the rate of loss of the grains, on cells of 24 diameters."""
OWN = ("", "radl", "gradient")
"""Closures of the runs with parcels that see the volume of a grain in place of their own, on cells of 24 diameters."""
SEEDS = (0, 1)
"""Of the places at the start, for the fine runs and for the closures of `OWN`."""
TUNED = ((24.0, 4),)
"""Cells and parcels for which the network is tuned by statistics."""
FINE_TIMES = {0.02: 110, 0.05: 40, 0.2: 25}
"""Length of a fine run in relaxation times; of coarse runs with grains at most `GRAIN_TIMES`."""
GRAIN_TIMES = 40
PARCEL_STEP, PARCEL_TIMES = 5e-4, 110
"""Fluid step of runs with parcels [s], and their length in relaxation times."""


def fine(solid_fraction: float, seed: int = 0) -> Case:
    """The fine run of a mean solid fraction."""
    samples = int(solid_fraction == TRAINED_ON[0].solid_fraction and seed == 0)
    return Case(solid_fraction, seed=seed, samples=samples, times=FINE_TIMES[solid_fraction])


def coarse(solid_fraction: float, cell: float, closure: str = "", parcel: int = 1, seed: int = 0) -> Case:
    """A coarse run beside it."""
    times = min(FINE_TIMES.get(solid_fraction, GRAIN_TIMES), GRAIN_TIMES)
    case = Case(solid_fraction, cell, seed, closure, parcel, times=times)
    return case if parcel == 1 else replace(case, step=PARCEL_STEP, times=PARCEL_TIMES)


def lossy(case: Case) -> Case:
    """The case with parcels whose impacts keep the rate of loss of the grains."""
    return replace(case, name="loss", changes=(("contact.parcel_loss", "rate"),))


def of_grain(case: Case) -> Case:
    """The case with parcels that see the volume of one grain in place of their own."""
    return replace(case, name="own", changes=(("coupling.own_volume", "grain"),))


def with_long_step(case: Case) -> Case:
    """The case with a contact step of a tenth of an impact in place of a twentieth; it takes half of the time."""
    return replace(case, name="step", changes=(("contact.time_step", 1e-5),))


LONG = with_long_step(Case(0.2, seed=2, times=52, samples=3))
"""A further fine run, for the mean."""
DENSE = tuple(with_long_step(Case(0.2, seed=seed, times=80)) for seed in (3, 4))
"""Longer ones where the slip comes and goes with the clusters, so that its mean needs many relaxation times."""
SEEN_ON = (
    Seen(Case(0.05, seed=2, times=36, samples=0.1), draws=8, dropped=6),
    Seen(with_long_step(Case(0.01, times=30, samples=0.1)), draws=16, dropped=6),
    Seen(with_long_step(Case(0.15, times=15, samples=0.1)), draws=4, dropped=5),
    Seen(with_long_step(Case(0.3, times=13, samples=0.1)), draws=4, dropped=5),
)
"""Fine runs that the closures of `SEEN_FITS` are trained on: their solid fractions lie round those of `FRACTIONS`."""
LONGER_ON = (
    Seen(Case(0.05, seed=3, times=80, samples=0.1), draws=8, dropped=6),
    Seen(with_long_step(Case(0.01, seed=3, times=110, samples=0.1)), draws=16, dropped=6),
    Seen(with_long_step(Case(0.15, seed=3, times=60, samples=0.1)), draws=4, dropped=5),
    Seen(with_long_step(Case(0.3, seed=3, times=60, samples=0.1)), draws=4, dropped=5),
)
"""Longer fine runs, that the closures of `LONGER_FITTED` are trained on."""
CALIBRATED_ON = (
    Seen(Case(0.05, seed=4, times=80, samples=0.1), draws=8, dropped=6),
    Seen(with_long_step(Case(0.01, seed=4, times=110, samples=0.1)), draws=16, dropped=6),
    Seen(with_long_step(Case(0.1, seed=5, times=80, samples=0.1)), draws=4, dropped=5),
    Seen(with_long_step(Case(0.15, seed=4, times=60, samples=0.1)), draws=4, dropped=5),
    Seen(with_long_step(Case(0.3, seed=4, times=60, samples=0.1)), draws=4, dropped=5),
)
"""Fine runs that the closure `CALIBRATED` and those of `MIXED_FITTED` are trained on."""
CALIBRATED_AT = tuple(
    (one.case.solid_fraction, cell)
    for one in CALIBRATED_ON
    for cell in COARSE
    if (one.case.solid_fraction, cell) != (0.01, 12.0)
)
"""Solid fractions and cells at which its coarse runs are to have the slip of the fine ones. Parcels of 4 that are few
and in cells of 12 diameters take so much gas along that they would need more than twice the drag of the law."""
MESHES = {24.0: SEEDS, 12.0: SEEDS, 16.0: SEEDS[:1]}
"""Sides of coarse cells in diameters, and seeds of the places, of the runs with the closure `CALIBRATED`, which is
trained on cells of 24 and 12 diameters."""
UNSEEN = (0.03, 0.07, 0.12)
"""Solid fractions at which nothing was run before that closure was made."""
SMALLER = {0.02: (0, 1, 2), 0.05: (0, 1)}
"""Solid fractions of the runs with parcels of 2, and the seeds of the places."""
MATCHED_AT = (0.01, 0.05)
"""Solid fractions at which coarse runs are to have the slip of fine ones; the others' are known to 11 % at best."""


def with_tuned(case: Case) -> Case:
    """The case with the closure that is tuned for it."""
    return replace(case, closure=tuned_name(case))


def plan() -> dict[str, list[Case]]:
    """All runs by what they are for, but those on the way to a tuned closure."""
    small = [Case(0.05, cell, box=(48, 96)) for cell in (3.0, 2.0)]
    base = coarse(0.05, 12.0, parcel=4)
    checks = [
        replace(base, name="stiff", changes=(("contact.young_modulus", 2e5),)),
        replace(base, name="wide", changes=(("coupling.kernel_width.cells", 1.0),)),
    ]
    return {
        "fine": [*(fine(s, seed) for seed in SEEDS for s in FRACTIONS), LONG],
        "dense": [*DENSE],
        "training": [one.case for one in SEEN_ON],
        "longer": [one.case for one in LONGER_ON],
        "mesh": [*small, *checks],
        "models": [coarse(s, cell, model) for cell in reversed(COARSE) for model in MODELS for s in FRACTIONS],
        "parcels": [coarse(s, cell, model, 4) for cell in COARSE for model in MODELS for s in FRACTIONS],
        "seeds": [coarse(s, 24.0, model, 4, seed) for model in OWN for s in FRACTIONS for seed in SEEDS[1:]],
        "own": [of_grain(coarse(s, 24.0, model, 4, seed)) for model in OWN for s in FRACTIONS for seed in SEEDS],
        "loss": [lossy(coarse(s, 24.0, model, 4)) for model in LOSSY for s in FRACTIONS],
        "seen": [coarse(s, 24.0, model, 4, seed) for model in SEEN_FITS for s in FRACTIONS for seed in SEEDS],
        "matched": [coarse(s, 24.0, MATCHED, 4, seed) for s in FRACTIONS for seed in SEEDS],
        "smaller": [coarse(s, 24.0, "wide", 2, seed) for s, seeds in SMALLER.items() for seed in seeds],
        "smaller_none": [coarse(s, 24.0, parcel=2) for s in FRACTIONS],
        "nudged": [coarse(s, 24.0, model, 4, seed) for s in FRACTIONS for seed in SEEDS for model in FITTED],
        "nudged_longer": [coarse(s, 24.0, m, 4, seed) for m in LONGER_FITTED for s in FRACTIONS for seed in SEEDS],
        "between": [
            with_long_step(Case(0.1, seed=3, times=80)),
            *(coarse(0.1, 24.0, m, 4, seed) for m in ("", "radl", *LONGER_FITTED) for seed in SEEDS),
        ],
        "calibration": [one.case for one in CALIBRATED_ON],
        "calibrated": [
            coarse(s, cell, CALIBRATED, 4, seed)
            for cell, seeds in MESHES.items()
            for s in (*FRACTIONS, 0.1)
            for seed in seeds
        ],
        "meshes": [
            *(coarse(s, 12.0, model, 4) for model in ("", "radl") for s in (*FRACTIONS, 0.1)),
            *(coarse(s, 16.0, model, 4) for model in ("", "radl") for s in (0.05, 0.2)),
        ],
        "unseen": [
            *(with_long_step(Case(s, seed=4, times=110 if s < 0.05 else 80)) for s in (*UNSEEN, 0.1)),
            *(coarse(s, 24.0, m, 4, seed) for m in ("", "radl", CALIBRATED) for s in UNSEEN for seed in SEEDS),
        ],
        "mixed": [
            *(coarse(s, 24.0, m, 4, seed) for m in MIXED_FITTED for s in (*UNSEEN, *FRACTIONS, 0.1) for seed in SEEDS),
            *(coarse(s, 24.0, m, 4) for m in MIXED_FITTED for s in (0.01, 0.15, 0.3)),
            *(coarse(s, 24.0, m, 4) for m in MIXED_AGAIN for s in (*UNSEEN, *FRACTIONS, 0.1)),
        ],
        "anew": [
            *(coarse(0.05, 24.0, model, 4, 2) for model in ("", "radl")),
            *(coarse(s, 24.0, model, 4, seed) for model in ANEW for s in FRACTIONS for seed in (0, 1, 2)),
        ],
        "trainings": [coarse(s, 24.0, model, 4) for model in AGAIN for s in FRACTIONS],
        "tuned": [with_tuned(coarse(s, cell, parcel=parcel)) for cell, parcel in TUNED for s in FRACTIONS],
    }
