"""The cases of two fluids of the verification page, at the size that a test can afford."""

import pytest

from tests.cases import checked, names

pytestmark = pytest.mark.long_runs


@pytest.mark.parametrize("name", names("surface"))
def test_case(name):
    checked(name)
