"""The two tiers of the tests: what `make test` leaves out, CI runs, and no topic is left out as a whole."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.cases import collect
from tests.cases.tiers import COMBINATION, SECOND, cases_of, tiered

ROOT = Path(__file__).parents[1]


def test_cases_of_the_second_tier_are_cases_and_every_topic_of_several_has_others():
    cases = collect()
    assert all(cases[name].tested for name in SECOND)
    for topic in {case.topic for case in cases.values() if case.tested}:
        marked = [one for one in cases_of(topic) if not isinstance(one, str)]
        assert {one.values[0] for one in marked} == SECOND & {name for name in cases if cases[name].topic == topic}
        assert len(marked) < len(cases_of(topic)) or len(marked) == 1, topic


def test_values_that_are_not_in_the_first_tier_are_marked():
    plain, marked = tiered([(1, "a"), (2, "b")], first=[(1, "a")])
    assert plain == (1, "a") and marked.values == (2, "b") and marked.marks == (COMBINATION,)
    with pytest.raises(ValueError, match="'c'"):
        tiered(["a", "b"], first=["c"])


def test_both_tiers_are_all_tests():
    """`make test` and `make test-rest` have the same mark, and CI calls both."""
    made = (ROOT / "Makefile").read_text()
    rules = dict(re.findall(r"^(test|pytest|test-rest|test-all):[^\n]*\n((?:\t[^\n]*\n)+)", made, re.M))
    assert '-m "not $(SECOND)"' in rules["pytest"] and "-m $(SECOND)" in rules["test-rest"]
    assert re.search(rf"^SECOND := {COMBINATION.name}$", made, re.M)
    assert re.findall(r"^ *make ([\w-]+)$", (ROOT / ".ci" / "run").read_text(), re.M)[:2] == ["test", "test-rest"]
