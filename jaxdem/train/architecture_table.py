"""What a search gave, as a table: R2 of every network, and of those that differ in the seed alone together."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxdem.errors import InputError
from jaxdem.files.reading import read_text
from jaxdem.io.durable import write_bytes
from jaxdem.train.fit_settings import FitSettings

TABLE, PAGE = "sweep.csv", "sweep.md"

PAPER_R2: dict[str, dict[Any, float]] = {
    "activation": {
        "relu": 0.8185,
        "elu": 0.8408,
        "sigmoid": 0.4113,
        "tanh": 0.7023,
        "softsign": 0.7378,
        "softplus": 0.8332,
        "selu": 0.8096,
    },
    "loss": {"mse": 0.8408, "mae": 0.3809, "msle": 0.1256, "mape": 0.2449, "log_cosh": 0.7937},
    "samples": {
        1_000_000: 0.8689,
        500_000: 0.8642,
        250_000: 0.8408,
        100_000: 0.7881,
        50_000: 0.7601,
        25_000: 0.5913,
        10_000: 0.2106,
    },
}
"""R2 on held-out fine inputs by what differs from the paper's settings.

Source: Davydzenka & Tahmasebi (2022), J. Fluid Mech. 938, A20.
"""


@dataclasses.dataclass
class Network:
    """One combination.

    Attributes:
        name: of its closure file, without ending.
        chosen: varied setting -> value.
        settings: of its fit.
        metadata: of its closure file; None before the training, or where the loss did not stay finite.
        reason: why there is no closure.
    """

    name: str
    chosen: dict[str, Any]
    settings: FitSettings
    metadata: dict[str, Any] | None = None
    reason: str = ""

    def r2(self, coarsening: str, of: str = "closure") -> float:
        """R2 on held-out rows; NaN where there is none."""
        scores = {} if self.metadata is None else self.metadata["r2"]
        return float(scores[coarsening][of]) if coarsening in scores else math.nan


@dataclasses.dataclass
class Search:
    """All combinations, in the order of the grid: the last setting varies fastest.

    Attributes:
        recipe: "paper" or "filtered".
        names: of the varied settings.
        networks: one a combination.
        out: folder of the closure files and tables.
    """

    recipe: str
    names: tuple[str, ...]
    networks: list[Network]
    out: Path

    @property
    def coarsenings(self) -> list[str]:
        """Those that the held-out rows have, ascending."""
        found = {n for network in self.networks if network.metadata for n in network.metadata["r2"]}
        return sorted(found, key=int)

    def closure_file(self, network: Network) -> Path:
        """Where a network's closure is kept."""
        return self.out / f"{network.name}.closure.h5"

    def by_seed(self) -> list[tuple[dict[str, Any], list[Network]]]:
        """The networks that differ in the seed alone, together: varied settings without it, and the networks."""
        groups: dict[str, tuple[dict[str, Any], list[Network]]] = {}
        for network in self.networks:
            others = {name: value for name, value in network.chosen.items() if name != "seed"}
            groups.setdefault(network_name(others), (others, []))[1].append(network)
        return list(groups.values())

    def paper_r2(self, network: Network) -> float:
        """The paper's figure where the settings differ from the paper's in one at most; else NaN.

        The number of epochs and the seed are left out: they say how exact the figure beside it is.
        """
        usual, own = FitSettings(), network.settings
        names = (
            "hidden",
            "activation",
            "loss",
            "learning_rate",
            "schedule",
            "batch",
            "samples",
            "coarsenings",
        )
        differing = [name for name in names if getattr(own, name) != getattr(usual, name)] or ["activation"]
        if self.recipe != "paper" or len(differing) > 1:
            return math.nan
        return PAPER_R2.get(differing[0], {}).get(getattr(own, differing[0]), math.nan)

    def write(self) -> None:
        """sweep.csv with a line a network, and sweep.md with a line for all that differ in the seed alone."""
        text = io.StringIO()
        lines = csv.writer(text, lineterminator="\n")
        columns = [f"r2_{n}_{of}" for n in self.coarsenings for of in ("closure", "base", "regression")]
        lines.writerow(["network", *self.names, *columns, "r2_paper", "samples", "seconds", "reason"])
        for network in self.networks:
            scores = [network.r2(n, of) for n in self.coarsenings for of in ("closure", "base", "regression")]
            record = network.metadata or {}
            lines.writerow(
                [
                    network.name,
                    *map(as_text, network.chosen.values()),
                    *map(repr, scores),
                    repr(self.paper_r2(network)),
                    record.get("samples", ""),
                    repr(record.get("seconds", math.nan)),
                    network.reason,
                ]
            )
        write_bytes(self.out / TABLE, text.getvalue().encode())
        write_bytes(self.out / PAGE, self.page().encode())

    def page(self) -> str:
        """Markdown: R2 by coarsening, mean and range over seeds, the paper's beside it."""
        names = [name for name in self.names if name != "seed"]
        paper = any(math.isfinite(self.paper_r2(network)) for network in self.networks)
        done = next((network for network in self.networks if network.metadata), None)
        head = [
            *names,
            "seeds",
            *(f"R2 at {n}x" for n in self.coarsenings),
            *(["paper"] * paper),
            "s a network",
        ]
        rows = [head, ["---"] * len(head)]
        for chosen, networks in self.by_seed():
            scores = [_range([network.r2(n) for network in networks]) for n in self.coarsenings]
            given = self.paper_r2(networks[0])
            figure = [f"{given:.4f}" if math.isfinite(given) else ""] * paper
            seconds = [network.metadata["seconds"] for network in networks if network.metadata]
            spent = f"{np.mean(seconds):.3g}" if seconds else ""
            rows.append([*map(as_text, chosen.values()), str(len(networks)), *scores, *figure, spent])
        if done is not None and done.metadata is not None:
            for of, title in (("base", done.metadata["base_law"]), ("regression", "regression")):
                scores = [f"{done.r2(n, of):.4f}" for n in self.coarsenings]
                label = [title, *[""] * (len(names) - 1)] if names else []
                rows.append([*label, "" if names else title, *scores, *([""] * paper), ""])
        table = "\n".join("| " + " | ".join(row) + " |" for row in rows)
        split = "" if done is None or done.metadata is None else f" {done.metadata['split']}."
        note = " Paper: Davydzenka & Tahmasebi (2022), on fine inputs of its own runs." * paper
        return f"R2 on held-out rows, recipe {self.recipe}; mean (range) over seeds.{split}{note}\n\n{table}\n"


def read_search(folder: Path) -> list[dict[str, str]]:
    """Lines of a search's sweep.csv, by column; none where there is no such file."""
    path = folder / TABLE
    if not path.is_file():
        return []
    try:
        return list(csv.DictReader(io.StringIO(read_text(path), newline="")))
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(TABLE, str(path), f"cannot be read ({error})", "Take it from a backup.") from error


def as_text(value: Any) -> str:
    """A value as the command line takes it."""
    if isinstance(value, tuple):
        joint = "-" if value and isinstance(value[0], int) else "+"
        return joint.join(map(str, value)) or "none"
    return str(value)


def network_name(chosen: dict[str, Any]) -> str:
    """A readable name such as "seed=0,hidden=170-70-30"."""
    return ",".join(f"{name}={as_text(value)}" for name, value in chosen.items())


def _range(values: Sequence[float]) -> str:
    """Mean and range of the values that there are."""
    finite = [value for value in values if math.isfinite(value)]
    if not finite:
        return "none"
    text = f"{np.mean(finite):.4f}"
    return text if len(finite) == 1 else f"{text} ({min(finite):.4f}-{max(finite):.4f})"
