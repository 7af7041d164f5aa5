"""The cases of bonds of the verification page, at the size that a test can afford."""

import pytest

from tests.cases import checked, names


@pytest.mark.parametrize("name", names("bonds"))
def test_case(name):
    checked(name)
