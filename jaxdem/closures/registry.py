"""The drag laws by the names that scene files use."""

from __future__ import annotations

import difflib

from jaxdem.closures.beetstra import Beetstra
from jaxdem.closures.correlation import Correlation
from jaxdem.closures.di_felice import DiFeliceDallavalle
from jaxdem.closures.ergun import Ergun
from jaxdem.closures.gidaspow import Gidaspow, GidaspowBlended
from jaxdem.closures.koch_hill import KochHill
from jaxdem.closures.rong import Rong
from jaxdem.closures.schiller_naumann import SchillerNaumann
from jaxdem.closures.shaped import HaiderLevenspiel, HoelzerSommerfeld
from jaxdem.closures.stokes import Stokes
from jaxdem.closures.tang import Tang
from jaxdem.closures.wen_yu import WenYu
from jaxdem.errors import InputError

DRAG_LAWS: dict[str, type[Correlation]] = {
    "stokes": Stokes,
    "schiller_naumann": SchillerNaumann,
    "ergun": Ergun,
    "wen_yu": WenYu,
    "gidaspow": Gidaspow,
    "gidaspow_blended": GidaspowBlended,
    "di_felice": DiFeliceDallavalle,
    "koch_hill": KochHill,
    "beetstra": Beetstra,
    "tang": Tang,
    "rong": Rong,
    "haider_levenspiel": HaiderLevenspiel,
    "hoelzer_sommerfeld": HoelzerSommerfeld,
}
"""Scene name (`coupling.drag`) to correlation."""


def drag_law(name: str, key: str = "coupling.drag") -> Correlation:
    """An instance of the correlation of that scene name; `key` is what an error names.

    Raises:
        InputError: no law has that name.
    """
    if not isinstance(name, str) or name not in DRAG_LAWS:
        near = difflib.get_close_matches(str(name), DRAG_LAWS, n=1)
        hint = f"Did you mean {near[0]!r}? " if near else ""
        raise InputError(key, name, "no drag law has this name", f"{hint}Use one of {', '.join(DRAG_LAWS)}.")
    return DRAG_LAWS[name]()


def drag_law_name(law: Correlation) -> str:
    """The scene name of a correlation.

    Raises:
        InputError: the law is not in `DRAG_LAWS`.
    """
    for name, kind in DRAG_LAWS.items():
        if type(law) is kind:
            return name
    raise InputError("drag law", type(law).__name__, "is not in DRAG_LAWS", "Register it there under a name.")
