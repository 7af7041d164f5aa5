"""The cases of heat of the verification page, at the size that a test can afford."""

import pytest

from tests.cases import checked
from tests.cases.tiers import cases_of


@pytest.mark.parametrize("name", cases_of("heat", long_runs=True))
def test_case(name):
    checked(name)
