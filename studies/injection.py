"""The full-size study of the injection scene: its runs, closures and parts.

Names are made up of the scene's, the mesh's (`fine`, `coarse_4`: cells four times as wide), what else is changed, and
the closure's; `_seed_1` behind the mesh is another jitter of the pack. Without a scene's name it is injection.toml.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from jaxdem.closures.invariant import TERMS
from jaxdem.study import SHARP
from jaxdem.train.dataset_file import SEEING
from jaxdem.train.finetune import FinetuneSettings
from jaxdem.train.fit_settings import FitSettings
from studies.specs import (
    DatasetSpec,
    EnsembleSpec,
    FitSpec,
    Part,
    Plan,
    ReplaySpec,
    RunSpec,
    SmallerSpec,
    Spec,
    StressSpec,
    TuneSpec,
    by_name,
)

INJECTION, SLAB, DILUTE = "injection.toml", "injection_slab.toml", "dilute_jet.toml"

FACTORS = (2, 4, 8)
"""Coarse meshes of 8, 16 and 32 cm."""

COARSENINGS = (1, 2, 4, 8)
"""Meshes that the recipe `filtered` is trained on, the fine one among them."""

SEEDS = (1, 2)
"""Jitters of the pack beside the first."""

SOFT: dict[str, Any] = {"contact.young_modulus": 7e6, "contact.maximum_overlap": 0.3}
"""Contacts of the study: a contact step of 1.1e-4 s, where the source study has 2e-4 s."""

STIFF: dict[str, Any] = {"contact.young_modulus": 7e7, "contact.maximum_overlap": 0.2}
"""Contacts of the scenes' files: three times the contact steps. Where grains fall far they cannot be softer."""

CONTACTS: dict[str, dict[str, Any]] = {SLAB: STIFF, DILUTE: {}}
"""Of scenes that have others: soft grains of the slab, thrown to the ceiling, would overlap by more than they may."""

CELLS: dict[str, dict[int, list[int]]] = {
    INJECTION: {2: [150, 25], 3: [100, 17], 4: [75, 12], 8: [38, 6]},
    SLAB: {2: [150, 1, 25], 4: [75, 1, 12], 8: [38, 1, 6]},
    "injection_small_grains.toml": {4: [75, 12]},
    "settling_column.toml": {4: [25, 25]},
    "fluidised_bed.toml": {4: [8, 20]},
    DILUTE: {2: [128, 32, 32], 4: [64, 16, 16]},
}
"""Cells of the coarse meshes, by scene and factor."""

WHOLE_INLET = {"boundary.left.to": 2.0, "time.end": 2.5}
"""Water through all of the left side, as the source study's text may be read: the front is at the screen after 1.9 s,
and two seconds later the water presses the grains through it."""

UNSEEN: dict[str, tuple[str, dict[str, Any]]] = {
    "speed_1_5": (INJECTION, {"boundary.left.velocity": 1.5}),
    "speed_6": (
        INJECTION,
        {
            "boundary.left.velocity": 6.0,
            "fluid.time_step": 0.005,
            "time.end": 2.5,
            **STIFF,
            "contact.maximum_overlap": 0.25,
        },
    ),
    "density_2500": (INJECTION, {"particles.density": 2500.0}),
    "small_grains": ("injection_small_grains.toml", {}),
    "settling_column": ("settling_column.toml", STIFF),
    "fluidised_bed": ("fluidised_bed.toml", {}),
}
"""Scenes that no closure was trained on, beside injection.toml itself."""

ACTIVATIONS = ("elu", "relu", "softplus")
"""Of the networks that are run in the solver."""

SWEEPS: dict[str, tuple[Any, ...]] = {
    "activation": ("relu", "elu", "sigmoid", "tanh", "softsign", "softplus", "selu"),
    "loss": ("mse", "mae", "msle", "mape", "log_cosh"),
    "samples": (10_000, 25_000, 50_000, 100_000, 250_000, 500_000, 1_000_000),
    "hidden": ((170, 70, 30), (170, 70), (170,), (64, 32, 16), (64, 32), (32, 16), (16, 8), (8, 4), (4,)),
}
"""Settings of the paper's network that are varied, one at a time."""

SWEEP_EPOCHS = 100
"""A twentieth of the source study's: with all of them the networks would take half a day of one core."""

NARROW: dict[str, Any] = {"coupling.kernel_width": SHARP["coupling.kernel_width"]}
"""Kernels half as wide as the scenes' on coarse meshes, where the cells decide; the sharp fluid has them too."""

FOURTH: dict[str, Any] = {**SHARP, "fluid.advection": "central_4"}
"""The same with eddies of a few cells that run at nearly their speed."""

DECONVOLVED: dict[str, Any] = {**SHARP, "coupling.deconvolution": 0.17}
"""The sharp fluid, and a drag law that is given what cells and kernels of 16 cm took from the velocity (0.17 is what
the fine run's averages ask for there, and under the limit of stability, 0.23)."""

WIDE_DECONVOLVED: dict[str, Any] = {"fluid.advection": "central", "coupling.deconvolution": 0.35}
"""Kernels of a whole cell, which take more of the velocity, and its deconvolution, which may give more back (limit
0.46)."""

FOURTH_DECONVOLVED: dict[str, Any] = {**FOURTH, "coupling.deconvolution": 0.17}
"""Fourth order with the velocity deconvolved."""

FLUID_VARIANTS: dict[str, dict[str, Any]] = {
    "upwind": {"fluid.advection": "upwind"},
    "smagorinsky": {"fluid.smagorinsky": 0.15},
    "superbee": {"fluid.advection": "superbee"},
    "central": {"fluid.advection": "central"},
    "narrow": NARROW,
    "sharp": SHARP,
}
"""Changes of the coarse fluid of 16 cm; the scene's own is second order, limited, without a subgrid viscosity, kernels
of a cell. The other meshes have first order and the sharp one."""

COMPARED = 3.4
"""End of runs that only errors are taken of [s]: the fine run's grains come to the screen at 3.3 s."""

SETTINGS: dict[str, dict[str, Any]] = {
    "float64": {"precision": "float64"},
    "fluid_step_0_005": {"fluid.time_step": 0.005, "coupling.interval": 0.01},
    "interval_0_005": {"fluid.time_step": 0.005, "coupling.interval": 0.005},
    "interval_0_02": {"fluid.time_step": 0.01, "coupling.interval": 0.02},
    "fluid_step_0_02": {"fluid.time_step": 0.02, "coupling.interval": 0.02},
}
"""What else the error is bought with, apart from mesh and closure."""


def planned(name: str, scene: str, overrides: Mapping[str, Any] | None = None) -> RunSpec:
    """A run with the study's contacts, if its overrides do not say otherwise."""
    contacts = CONTACTS.get(scene, SOFT)
    return RunSpec(name, scene, {**contacts, **(overrides or {})})


def coarse(name: str, scene: str, factor: int, overrides: Mapping[str, Any] | None = None) -> RunSpec:
    """A run on a coarse mesh; `name` is what stands before `coarse_F`, with its underscore."""
    cells = {"fluid.cells": CELLS[scene][factor]}
    return planned(f"{name}coarse_{factor}", scene, {**cells, **(overrides or {})})


def varied(run: RunSpec, what: str, overrides: Mapping[str, Any]) -> RunSpec:
    """A run with further overrides, and what they are in its name."""
    return RunSpec(f"{run.name}_{what}", run.scene, {**run.overrides, **overrides}, run.closure)


def briefly(run: RunSpec, end: float = COMPARED) -> RunSpec:
    """The run as far as it is compared."""
    return dataclasses.replace(run, overrides={**run.overrides, "time.end": end})


def jittered(run: RunSpec) -> list[RunSpec]:
    """The run with other jitters of the pack; they write no samples."""
    overrides = {key: value for key, value in run.overrides.items() if key != "output.samples"}
    bare = RunSpec(run.name, run.scene, overrides, run.closure)
    return [varied(bare, f"seed_{seed}", {"seed": seed}) for seed in SEEDS]


FINE = planned("fine", INJECTION, {"output.samples": 0.02})
BARE = planned("fine", INJECTION)
"""The fine run, to vary."""
COARSE = {factor: coarse("", INJECTION, factor) for factor in (2, 3, 4, 8)}
STIFF_FINE = planned("stiff_fine", INJECTION, STIFF)
STIFF_COARSE = {factor: coarse("stiff_", INJECTION, factor, STIFF) for factor in FACTORS}
STIFF_PACK = jittered(briefly(STIFF_FINE, 3.6))[0]
"""The stiff fine run's grains come to the screen at 3.5 s."""
SLAB_FINE = planned("slab_fine", SLAB)
SLAB_COARSE = {factor: coarse("slab_", SLAB, factor) for factor in FACTORS}
DILUTE_FINE = planned("dilute_fine", DILUTE)
DILUTE_COARSE = {factor: coarse("dilute_", DILUTE, factor) for factor in (2, 4)}
TRAINING = (
    planned("training_column", "training_column.toml", {**STIFF, "output.samples": 0.05}),
    planned("training_injection", "training_injection.toml", {"output.samples": 0.05}),
)
"""Runs that closures are trained on: no run of injection.toml is among them."""


def mesh_runs() -> list[RunSpec]:
    """All meshes, single layer and slab, three packs of the layer and of the fine slab; stiff contacts; drag laws."""
    laws = [varied(COARSE[2], law, {"coupling.drag": law}) for law in ("di_felice", "gidaspow")]
    whole = [planned("whole_fine", INJECTION, WHOLE_INLET)]
    whole += [coarse("whole_", INJECTION, factor, WHOLE_INLET) for factor in FACTORS]
    layer = [FINE, *(COARSE[factor] for factor in FACTORS)]
    slab = [SLAB_FINE, *jittered(SLAB_FINE), *SLAB_COARSE.values()]
    seeds = [*jittered(FINE), *(run for factor in FACTORS for run in jittered(briefly(COARSE[factor])))]
    return [*layer, *laws, *seeds, *slab, *whole, STIFF_FINE, STIFF_PACK, *STIFF_COARSE.values()]


def budget_runs() -> list[RunSpec]:
    """What of the coarse error is the drag's, and what the fluid's."""
    inputs = [
        varied(briefly(BARE), f"inputs_{factor}", {"coupling.drag_inputs_coarsened": factor}) for factor in FACTORS
    ]
    fluids = [
        varied(briefly(COARSE[factor]), name, changes)
        for factor in FACTORS
        for name, changes in FLUID_VARIANTS.items()
        if factor == 4 or name in ("upwind", "sharp")
    ]
    return [FINE, *jittered(FINE), *(COARSE[factor] for factor in FACTORS), *inputs, *fluids]


DATASETS = (*(f"dataset_{run.name}" for run in TRAINING), "dataset_fine")
"""What closures are trained on, and the fine run, which is held out."""

KERNELS: dict[str, dict[str, Any]] = {
    name: {key: value for key, value in fluid.items() if key in SEEING}
    for name, fluid in (
        ("narrow", SHARP),
        ("deconvolved", DECONVOLVED),
        ("wide_deconvolved", WIDE_DECONVOLVED),
    )
}
"""What other coarse fluids change in the inputs of the drag law, by what stands behind the names of the datasets."""

ENSEMBLE = EnsembleSpec("filtered_ensemble", ("filtered", *(f"filtered_seed_{seed}" for seed in SEEDS)))

TUNING = FinetuneSettings(horizons=(1, 2), updates=3)
"""Through the solver: a gradient over one output costs as much as half a second of a run."""

SEARCHING = FinetuneSettings(method="gradient-free", horizons=(20,), updates=20, starts=1)
"""Without gradients a run may be unrolled for two seconds; a handful of parameters each."""

GRADIENT_STRESS = StressSpec("gradient_stress", 0.0, 1.0 / 12.0)
"""The gradient model, that nothing is learned for: the stress of a smooth flow averaged over cells."""


FILTERED = FitSettings.filtered(coarsenings=COARSENINGS)
"""The recipe's defaults, whose one layer of 8 came out of the part `smaller`."""

BAND_EPOCHS = 400
"""Of the paper's networks with other seeds and activations, a fifth of its 2,000: R2 is 0.991 after 100 epochs, 0.997
after 2,000."""


def fits() -> list[FitSpec]:
    """Both recipes with three seeds, the paper's with the activations that it runs in the solver, and `filtered` for
    other coarse fluids."""
    settings = FitSettings(coarsenings=(1,))
    result = [
        FitSpec("paper", "paper", settings, DATASETS),
        FitSpec("filtered", "filtered", FILTERED, DATASETS),
    ]
    band = dataclasses.replace(settings, epochs=BAND_EPOCHS)
    for activation in ACTIVATIONS[1:]:
        one = dataclasses.replace(band, activation=activation)
        result.append(FitSpec(f"paper_{activation}", "paper", one, DATASETS))
    for seed in SEEDS:
        name, one = f"paper_seed_{seed}", dataclasses.replace(band, seed=seed)
        result.append(FitSpec(name, "paper", one, DATASETS))
        one = dataclasses.replace(FILTERED, seed=seed)
        result.append(FitSpec(f"filtered_seed_{seed}", "filtered", one, DATASETS))
    settings = dataclasses.replace(FILTERED, terms=TERMS)
    result.append(FitSpec("filtered_terms", "filtered", settings, DATASETS))
    for kernel in KERNELS:
        result.append(FitSpec(f"filtered_{kernel}", "filtered", FILTERED, _datasets(kernel)))
    result.append(FitSpec("filtered_narrow_terms", "filtered", settings, _datasets("narrow")))
    return result


def _datasets(kernel: str) -> tuple[str, ...]:
    return tuple(f"{name}_{kernel}" for name in DATASETS)


def tuned() -> list[TuneSpec]:
    """Trained through runs of the training injection on the sharp fluid of 16 cm: drag, stress and both by a search,
    the drag by gradients too."""
    cells = {"fluid.cells": CELLS[INJECTION][4], **SHARP}
    run = TRAINING[1].name
    drag = TuneSpec("searched_drag", run, cells, SEARCHING, "filtered_narrow")
    return [
        drag,
        TuneSpec("searched_stress", run, cells, SEARCHING, trained=("subgrid",)),
        dataclasses.replace(drag, name="searched_both", trained=("drag", "subgrid")),
        TuneSpec("gradient_drag", run, cells, TUNING, "filtered"),
    ]


def smaller() -> list[FitSpec | SmallerSpec]:
    """Networks of less neurons, of both recipes."""
    result: list[FitSpec | SmallerSpec] = []
    for hidden in ((64, 32), (16, 16), (4,)):
        settings = dataclasses.replace(FILTERED, hidden=hidden)
        result.append(FitSpec(f"filtered_{_words(hidden)}", "filtered", settings, DATASETS))
    for hidden in ((32, 16), (8, 4)):
        name = f"paper_distilled_{_words(hidden)}"
        result.append(SmallerSpec(name, "paper", DATASETS, epochs=200, hidden=hidden))
    for neurons in (0.5, 0.25):
        name = f"paper_pruned_{_words((neurons,))}"
        result.append(SmallerSpec(name, "paper", DATASETS, epochs=100, neurons=neurons))
    return result


def _words(numbers: Iterable[float]) -> str:
    return "_".join(f"{number:g}".replace(".", "_") for number in numbers)


def sweeps() -> dict[str, list[FitSpec]]:
    """The source study's tables: the paper's network with one setting varied."""
    usual = FitSettings(epochs=SWEEP_EPOCHS)
    return {
        what: [
            FitSpec(f"sweep_{what}_{_word(value)}", "paper", dataclasses.replace(usual, **{what: value}), DATASETS)
            for value in values
        ]
        for what, values in SWEEPS.items()
    }


def _word(value: Any) -> str:
    return "_".join(map(str, value)) if isinstance(value, tuple) else str(value)


def closure_runs() -> list[RunSpec]:
    """Coarse runs with closures: all meshes with the first seed, 8 cm with the paper's others."""
    first = [COARSE[factor].with_closure(name) for factor in FACTORS for name in ("filtered", "paper")]
    other = [briefly(COARSE[4]).with_closure(name) for name in ("filtered_terms", ENSEMBLE.name)]
    band = [fit.name for fit in fits() if fit.name.startswith("paper_")]
    return [*first, *other, *(briefly(COARSE[2]).with_closure(name) for name in band)]


def solver_runs() -> list[RunSpec]:
    """Coarse runs with what was trained through the solver at 16 cm, and with what nothing is learned for."""
    found = [briefly(COARSE[4]).with_stress(GRADIENT_STRESS)]
    found += [run.with_closure("filtered") for run in jittered(briefly(COARSE[4]))]
    for factor in FACTORS:
        sharp = varied(briefly(COARSE[factor]), "sharp", SHARP)
        found += [sharp, sharp.with_closure("filtered")]
        fourth = varied(briefly(COARSE[factor]), "fourth", FOURTH)
        found += [fourth, fourth.with_closure("filtered")]
        shown = varied(briefly(COARSE[factor]), "deconvolved", DECONVOLVED)
        found.append(shown.with_closure("filtered_deconvolved"))
        if factor == 4:
            # What is said of closures at 16 cm rests on three packs.
            packs = [*jittered(sharp), *jittered(fourth)]
            found += [*packs, *(run.with_closure("filtered") for run in packs)]
            others = ("filtered_terms", ENSEMBLE.name, "filtered_narrow", "filtered_narrow_terms")
            found += [sharp.with_closure(name) for name in others]
            found += [
                run.with_stress(GRADIENT_STRESS)
                for run in (
                    sharp,
                    *(one.with_closure("filtered") for one in (sharp, fourth, *jittered(fourth))),
                )
            ]
            found += [sharp.with_tuned(one) for one in tuned()]
            wide = varied(briefly(COARSE[4]), "wide_deconvolved", WIDE_DECONVOLVED)
            found += [shown, *(run.with_closure("filtered") for run in (shown, *jittered(shown)))]
            found += [run.with_closure("filtered_deconvolved") for run in jittered(shown)]
            found += [wide, wide.with_closure("filtered_wide_deconvolved")]
            both = varied(briefly(COARSE[4]), "fourth_deconvolved", FOURTH_DECONVOLVED)
            found += [run.with_closure("filtered").with_stress(GRADIENT_STRESS) for run in (both, *jittered(both))]
    return found


def smaller_runs() -> list[RunSpec]:
    """16 cm with closures of all sizes."""
    full = [COARSE[4].with_closure(name) for name in ("filtered", "paper")]
    return [*full, *(briefly(COARSE[4]).with_closure(one.name) for one in smaller())]


def unseen_runs() -> list[RunSpec]:
    """Of every scene fine, fine with another jitter, coarse 4x, and coarse 4x on the sharp fluid, with the closure and
    without; the same with the velocity deconvolved and the closure of that; and mesh ratio 3."""
    result = [COARSE[4], COARSE[4].with_closure("filtered"), *_with_and_without(briefly(COARSE[4]))[2:]]
    result += _with_and_without(briefly(COARSE[3]))
    for name, (scene, overrides) in UNSEEN.items():
        fine = planned(f"{name}_fine", scene, {**overrides, "output.samples": 0.1})
        result += [fine, jittered(fine)[0], *_with_and_without(coarse(f"{name}_", scene, 4, overrides))]
    return result


def _with_and_without(plain: RunSpec) -> list[RunSpec]:
    sharp, shown = (varied(plain, *what) for what in (("sharp", SHARP), ("deconvolved", DECONVOLVED)))
    both = [one for run in (plain, sharp) for one in (run, run.with_closure("filtered"))]
    return [*both, shown.with_closure("filtered_deconvolved")]


def pareto_runs() -> list[RunSpec]:
    """Everything that error is bought with, on the fine and the 16 cm mesh; and a scene where the fluid dominates."""
    plain = (briefly(run) for run in (BARE, COARSE[4]))
    settings = [varied(run, what, keys) for run in plain for what, keys in SETTINGS.items()]
    closed = [run.with_closure("filtered") for run in DILUTE_COARSE.values()]
    stiff = [STIFF_FINE, *STIFF_COARSE.values()]
    return [*settings, *stiff, DILUTE_FINE, *jittered(DILUTE_FINE)[:1], *DILUTE_COARSE.values(), *closed]


def injection_plan() -> Plan:
    """The study of the injection scene at full size."""
    # Rows of a sample are grains: some hundred thousand in all are enough, and memory is not.
    training = [DatasetSpec(f"dataset_{run.name}", run.name, COARSENINGS, every=3) for run in TRAINING]
    held_out = DatasetSpec("dataset_fine", FINE.name, (1, 2, 3, 4, 8), every=10)
    other_kernels = [
        dataclasses.replace(one, name=f"{one.name}_{name}", overrides=overrides)
        for name, overrides in KERNELS.items()
        for one in (*training, held_out)
    ]
    tests = [held_out, *(DatasetSpec(f"dataset_{name}", f"{name}_fine", (1, 4), every=2) for name in UNSEEN)]
    replays = [ReplaySpec(f"oracle_{factor}", FINE.name, factor) for factor in COARSENINGS]
    varied_once = [fit for group in sweeps().values() for fit in group]
    plain = [FINE, *jittered(FINE), *(COARSE[factor] for factor in FACTORS)]
    begun = [COARSE[factor].with_closure("filtered") for factor in FACTORS]
    closed, through = closure_runs(), solver_runs()
    fitted = by_name(fits())
    filtered, paper = fitted["filtered"], fitted["paper"]
    names = ("filtered_terms", *(f"filtered_{fluid}" for fluid in KERNELS), "filtered_narrow_terms")
    for_solver = [filtered, *(fitted[name] for name in names), ENSEMBLE, GRADIENT_STRESS, *tuned()]
    parts: dict[str, Sequence[Spec]] = {
        "mesh": mesh_runs(),
        "budget": [*budget_runs(), *replays],
        "closures": [*plain, *closed, *fitted.values(), ENSEMBLE, held_out, *varied_once],
        "solver": [*plain, *begun, *through, *for_solver],
        "smaller": [*plain, *smaller_runs(), filtered, paper, *smaller()],
        "generalisation": [*plain, *unseen_runs(), filtered, paper, *tests],
        "pareto": [*plain, *closed, *through, *pareto_runs(), filtered, paper],
    }
    specs = by_name([*TRAINING, *training, *other_kernels, *(one for part in parts.values() for one in part)])
    return Plan(specs, {name: Part(name, tuple(by_name(needed))) for name, needed in parts.items()})
