"""What plain float32 would do to contacts; what ours does: `tests/cases/conservation.py`."""

from tests.cases.conservation import worst


def test_plain_float32_fails():
    """Negative control: without the trailing parts a disc at 10 m feels forces off by more than 1 %."""
    assert worst(7e7, 1.6e-5, 10.0, 0.0, precise=False) > 1e-2
