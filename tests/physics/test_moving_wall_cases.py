"""The cases of moving walls of the verification page, at the size that a test can afford."""

import pytest

from tests.cases import checked
from tests.cases.tiers import cases_of


@pytest.mark.parametrize("name", cases_of("moving walls", long_runs=True))
def test_case(name):
    checked(name)
