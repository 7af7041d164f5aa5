"""Many networks on one dataset: all combinations of some settings, those of one shape trained at once.

Example:
    >>> varied = [parse_sweep("seed=0,1,2"), parse_sweep("activation=relu,elu")]  # doctest: +SKIP
    >>> search([dataset], "paper", FitSettings(), varied, Path("networks"), listener)  # doctest: +SKIP
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from jaxdem.closures.file import load_closure, save_closure
from jaxdem.errors import InputError
from jaxdem.train.architecture_table import TABLE, Network, Search, network_name
from jaxdem.train.dataset_file import Dataset
from jaxdem.train.fit import RECIPES, fit_together
from jaxdem.train.fit_problem import Problem
from jaxdem.train.fit_settings import FitSettings

AT_ONCE = 8
"""Networks that are trained at once at most; more bring nothing and take memory."""


class Listener(Protocol):
    """Who hears how the search goes on; the command line draws bars."""

    def stage(self, name: str, total: float) -> Callable[[float], None]:
        """A group of networks starts, of so many epochs; the result is called with how many are done."""
        ...

    def say(self, message: str) -> None:
        """A line for the reader."""
        ...


class Varied(NamedTuple):
    """A setting of the fit, and the values that it takes."""

    name: str
    values: tuple[Any, ...]


def parse_sweep(text: str) -> Varied:
    """`name=a,b,c` of the command line: numbers, names, hidden layers as 170-70-30, terms joined by +, or none.

    Raises:
        InputError: not a setting that can be varied, no value, or one given twice or of the wrong kind.
    """
    name, separator, given = text.partition("=")
    name = name.strip()
    if not separator or name not in _READERS:
        limit = f"must be NAME=A,B,... with a name of {', '.join(_READERS)}"
        raise InputError("--sweep", text, limit, "For example --sweep seed=0,1,2.")
    parts = [part.strip() for part in given.split(",")]
    try:
        values = tuple(_READERS[name](part) for part in parts)
    except ValueError:
        limit = "has a value that cannot be read"
        raise InputError(f"--sweep {name}", given, limit, f"For example {_EXAMPLES[name]}.") from None
    if len(set(values)) < len(values):
        raise InputError(f"--sweep {name}", given, "has a value twice", "Name every value once.")
    return Varied(name, values)


def _widths(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split("-"))


def _terms(text: str) -> tuple[str, ...]:
    return () if text == "none" else tuple(text.split("+"))


_READERS: dict[str, Callable[[str], Any]] = {
    "seed": int,
    "hidden": _widths,
    "activation": str,
    "loss": str,
    "samples": int,
    "batch": int,
    "epochs": int,
    "learning_rate": float,
    "schedule": str,
    "terms": _terms,
}
_EXAMPLES = {
    "seed": "seed=0,1,2",
    "hidden": "hidden=170-70-30,64-32",
    "samples": "samples=250000,25000",
    "batch": "batch=500,2000",
    "epochs": "epochs=200,2000",
    "learning_rate": "learning_rate=1e-3,1e-2",
}


def search(
    datasets: Sequence[Dataset],
    recipe: str,
    settings: FitSettings,
    varied: Sequence[Varied],
    out: Path,
    listener: Listener,
) -> Search:
    """Train a network for every combination; a closure file each, sweep.csv and sweep.md kept up to date.

    Networks of one shape, loss and number of rows are trained at once, `AT_ONCE` of them at most; a group that was
    trained before is taken as it is, one that was stopped starts again.

    Args:
        datasets: see `jaxdem.train.fit`.
        recipe: a name of `RECIPES`.
        settings: what is not varied.
        varied: settings and values; another setting each.
        out: new or empty, or of an earlier search.
        listener: hears of each group that is trained.

    Raises:
        InputError: a setting twice or out of its range, datasets that do not fit, a folder that holds something else.
    """
    found = plan(recipe, settings, varied, out)
    _claim(found, datasets)
    found.write()
    waiting = [network for network in found.networks if network.metadata is None]
    done = len(found.networks) - len(waiting)
    while waiting:
        group, problems = _next_group(waiting, datasets, recipe)
        title = f"networks {done + 1} to {done + len(group)} of {len(found.networks)}"
        advance = listener.stage(title, group[0].settings.epochs)
        fits = fit_together(problems, lambda epoch, *_, advance=advance: advance(epoch))
        for network, (outcome, result) in zip(group, fits, strict=True):
            if result is None:
                network.reason = f"the loss is {outcome.history[-1]} in epoch {len(outcome.history)}"
                listener.say(f"{network.name}: {network.reason}")
                continue
            save_closure(found.closure_file(network), result.closure, result.metadata)
            network.metadata = result.metadata
        waiting = [network for network in waiting if network not in group]
        done += len(group)
        found.write()
    return found


def plan(recipe: str, settings: FitSettings, varied: Sequence[Varied], out: Path) -> Search:
    """The combinations, none of them trained.

    Raises:
        InputError: a setting twice or out of its range.
    """
    names = tuple(one.name for one in varied)
    for name in names:
        if names.count(name) > 1:
            raise InputError("--sweep", name, "is given twice", "Give every setting once.")
    networks = []
    for values in itertools.product(*(one.values for one in varied)):
        chosen = dict(zip(names, values, strict=True))
        networks.append(Network(network_name(chosen), chosen, dataclasses.replace(settings, **chosen)))
    return Search(recipe, names, networks, out)


def _next_group(
    waiting: Sequence[Network], datasets: Sequence[Dataset], recipe: str
) -> tuple[list[Network], list[Problem]]:
    """The first network that waits, and those that one program can train beside it."""
    first = waiting[0]

    def shape(settings: FitSettings) -> FitSettings:
        return dataclasses.replace(settings, seed=0, learning_rate=1.0)

    alike = [network for network in waiting if shape(network.settings) == shape(first.settings)][:AT_ONCE]
    return alike, [RECIPES[recipe](datasets, network.settings) for network in alike]


def _claim(found: Search, datasets: Sequence[Dataset]) -> None:
    """Take the networks that are there; refuse a folder that holds something else under these names."""
    out = found.out
    if out.is_dir() and any(out.iterdir()) and not (out / TABLE).is_file():
        raise InputError("--out", str(out), f"is not empty and has no {TABLE}", "Choose another folder.")
    runs = {dataset.run for dataset in datasets}
    for network in found.networks:
        path = found.closure_file(network)
        if not path.is_file():
            continue
        metadata = load_closure(path)[1]
        wanted = (found.recipe, network.settings.as_plain(), runs)
        if (metadata.get("recipe"), metadata.get("settings"), set(metadata.get("datasets", ()))) != wanted:
            limit = "was trained with another recipe, other settings or other runs"
            raise InputError("--out", str(path), limit, "Choose another folder.")
        network.metadata = metadata
    out.mkdir(parents=True, exist_ok=True)
