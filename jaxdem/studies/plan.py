"""What a full-size study is made of: runs, closures and parts, as plain data."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from jaxdem.train.finetune import FinetuneSettings
from jaxdem.train.fit_settings import FitSettings


@dataclasses.dataclass(frozen=True)
class RunSpec:
    """One run of a study.

    Attributes:
        name: of its folder in the study's.
        scene: file name of the scene.
        overrides: dotted key -> value.
        closure: name of the closure that it uses, None for the scene's drag law.
        subgrid: name of the training whose subgrid stress it uses, None for none.
    """

    name: str
    scene: str
    overrides: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    closure: str | None = None
    subgrid: str | None = None

    @property
    def learned(self) -> tuple[str, ...]:
        """Names of the closures that it uses."""
        return tuple(dict.fromkeys(name for name in (self.closure, self.subgrid) if name is not None))

    def with_closure(self, closure: str) -> RunSpec:
        """The same run with a closure, under a name that says so."""
        return dataclasses.replace(self, name=f"{self.name}_{closure}", closure=closure)

    def with_stress(self, stress: StressSpec) -> RunSpec:
        """The same run with a subgrid stress, under a name that says so."""
        return dataclasses.replace(self, name=f"{self.name}_{stress.name}", subgrid=stress.name)

    def with_tuned(self, tuned: TuneSpec) -> RunSpec:
        """The same run with what a training through the solver gave, beside what it began with."""
        closure = tuned.name if "drag" in tuned.trained else tuned.start
        subgrid = tuned.name if "subgrid" in tuned.trained else None
        return dataclasses.replace(self, name=f"{self.name}_{tuned.name}", closure=closure, subgrid=subgrid)


@dataclasses.dataclass(frozen=True)
class DatasetSpec:
    """Training data from a run.

    Attributes:
        name: of the file, without its ending.
        run: name of the run, which writes samples.
        coarsen: factors of the mesh.
        every: every so many-th sample is used.
        overrides: of the kernel through which the coarse meshes see the particles.
    """

    name: str
    run: str
    coarsen: tuple[int, ...]
    every: int = 1
    overrides: Mapping[str, Any] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class FitSpec:
    """One closure to train.

    Attributes:
        name: of the file, without its ending.
        recipe: "paper" or "filtered".
        settings: of the fit.
        datasets: names of the datasets; the last one's run is held out, for R2 alone.
    """

    name: str
    recipe: str
    settings: FitSettings
    datasets: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class TuneSpec:
    """Closures trained through coarse runs that follow a finer one.

    Attributes:
        name: of the files, without their endings.
        reference: name of the run to follow.
        overrides: of the reference's scene that make it the coarse one.
        settings: of the training.
        start: drag closure to begin with, None for the scene's drag law.
        trained: "drag", "subgrid" or both; a subgrid stress begins as one that gives nothing.
    """

    name: str
    reference: str
    overrides: Mapping[str, Any]
    settings: FinetuneSettings
    start: str | None = None
    trained: tuple[str, ...] = ("drag",)


@dataclasses.dataclass(frozen=True)
class SmallerSpec:
    """A cheaper closure made of another one.

    Attributes:
        name: of the file, without its ending.
        teacher: the other one.
        datasets: as for `FitSpec`.
        epochs: of the training.
        hidden: widths of a network that is taught by it; None prunes.
        neurons: part of the neurons that pruning keeps, before it trains on.
    """

    name: str
    teacher: str
    datasets: tuple[str, ...]
    epochs: int
    hidden: tuple[int, ...] | None = None
    neurons: float = 0.5


@dataclasses.dataclass(frozen=True)
class EnsembleSpec:
    """Closures that differ in their seed as one.

    Attributes:
        name: of the file, without its ending.
        members: the closures.
    """

    name: str
    members: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class StressSpec:
    """A subgrid stress with the same coefficients everywhere, that nothing is learned for.

    Attributes:
        name: of the file, without its ending.
        viscosity, gradient: c_1 and c_n, see `SubgridClosure.constant`.
    """

    name: str
    viscosity: float
    gradient: float


ClosureSpec = FitSpec | TuneSpec | SmallerSpec | EnsembleSpec | StressSpec
"""Any closure of a study."""


def made_of(spec: ClosureSpec) -> tuple[str, ...]:
    """Names of the closures that another one is made of."""
    if isinstance(spec, TuneSpec):
        return () if spec.start is None else (spec.start,)
    if isinstance(spec, SmallerSpec):
        return (spec.teacher,)
    return spec.members if isinstance(spec, EnsembleSpec) else ()


ENDINGS = {"drag": ".closure.h5", "subgrid": ".subgrid.h5"}
"""Of the files of closures, by what they are."""


def files_of(spec: ClosureSpec) -> dict[str, str]:
    """Names of a closure's files: `drag`, `subgrid` or both."""
    kinds: tuple[str, ...] = ("drag",)
    if isinstance(spec, TuneSpec):
        kinds = spec.trained
    elif isinstance(spec, StressSpec):
        kinds = ("subgrid",)
    return {kind: f"{spec.name}{ENDINGS[kind]}" for kind in kinds}


@dataclasses.dataclass(frozen=True)
class SearchSpec:
    """Networks of the recipe `paper` that differ in one setting, as `jaxdem train --sweep` trains them.

    Attributes:
        name: of the folder.
        sweep: the setting and its values, "activation=relu,elu".
        settings: what is not varied.
        datasets: as for `FitSpec`.
    """

    name: str
    sweep: str
    settings: FitSettings
    datasets: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Part:
    """One question of a study: what it needs; its answer is computed by the function of the same name.

    Attributes:
        name: as given to `--parts`.
        runs: names of runs.
        closures: names of closures.
        datasets: names of datasets beside those that the closures are trained on.
        oracles: factors of the mesh on which the fine run is replayed.
        searches: names of searches over networks.
    """

    name: str
    runs: tuple[str, ...]
    closures: tuple[str, ...] = ()
    datasets: tuple[str, ...] = ()
    oracles: tuple[int, ...] = ()
    searches: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class StudyPlan:
    """All of a study: everything by name, in the order in which it is done."""

    runs: Mapping[str, RunSpec]
    datasets: Mapping[str, DatasetSpec]
    closures: Mapping[str, ClosureSpec]
    parts: Mapping[str, Part]
    searches: Mapping[str, SearchSpec] = dataclasses.field(default_factory=dict)

    @property
    def files(self) -> set[str]:
        """Names of all runs, datasets, closures and searches in the study's folder."""
        closures = {file for spec in self.closures.values() for file in files_of(spec).values()}
        parities = {f"{name}.parity.npz" for name in self.closures}
        return {*self.runs, *(f"{name}.h5" for name in self.datasets), *closures, *parities, *self.searches}


Named = TypeVar("Named", RunSpec, DatasetSpec, ClosureSpec, Part, SearchSpec)


def by_name(items: Iterable[Named]) -> dict[str, Named]:
    """Items by their names.

    Raises:
        ValueError: two of one name that are not the same.
    """
    result: dict[str, Named] = {}
    for item in items:
        if result.setdefault(item.name, item) != item:
            raise ValueError(f"two different {type(item).__name__} named {item.name}")
    return result
