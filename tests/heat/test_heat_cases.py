"""The cases of heat of the verification page, at the size that a test can afford."""

import pytest

from tests.cases import checked
from tests.cases.tiers import cases_of

pytestmark = pytest.mark.long_runs


@pytest.mark.parametrize("name", cases_of("heat"))
def test_case(name):
    checked(name)
