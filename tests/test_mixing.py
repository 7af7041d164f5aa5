"""The mixing index of Lacey against closed forms, and what is refused."""

import numpy as np
import pytest

from jaxdem.errors import InputError
from jaxdem.mixing import mixing_index


def lattice(cells, each):
    """Centres of `each` particles in every one of cells x cells unit squares, and the number of the square along x."""
    corner = np.stack(np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij"), -1).reshape(-1, 1, 2)
    inside = np.random.default_rng(0).uniform(0.01, 0.99, (cells**2, each, 2))
    return (corner + inside).reshape(-1, 2)


def test_apart_is_zero_and_even_is_more_than_random():
    """Apart s^2 = s0^2; half and half in every cell s = 0, so M = 1/(1 - 1/n)."""
    x, each = lattice(8, 12), 12
    assert mixing_index(x, x[:, 0] < 4.0, 1.0) == pytest.approx(0.0, abs=1e-14)
    even = np.arange(len(x)) % 2 == 0
    assert mixing_index(x, even, 1.0) == pytest.approx(1.0 / (1.0 - 1.0 / each), rel=1e-13)
    # In cells that the border halves, where a quarter of all are: s^2 = 3/4 s0^2.
    half = mixing_index(x, x[:, 0] < 4.0, (2.0, 8.0), origin=(-1.0, 0.0))
    number = len(x) / 5
    assert half == pytest.approx(0.25 / (1.0 - 1.0 / number), rel=0.1)


@pytest.mark.parametrize("large", [1.0, 27.0])
def test_at_random_is_one(large):
    """The mean over 200 mixtures, within four of its standard errors; of two sizes by their volumes. Shuffled among the
    same places, a particle is the less likely to meet its own kind: (N - n)/(N - 1) of the variance is left."""
    random, x = np.random.default_rng(1), lattice(6, 20)
    number = len(x)
    first = np.arange(number) < number // 3
    volume = np.where(first, large, 1.0)
    order = [random.permutation(number) for _ in range(200)]
    found = np.asarray([mixing_index(x, first[p], 1.0, volume[p]) for p in order])
    error = found.std() / np.sqrt(len(found))
    # 1 + (sr^2/s0^2)/(1 - sr^2/s0^2) (n - 1)/(N - 1) for equal ones; 1 % or less.
    assert abs(found.mean() - 1.0) < 4.0 * error + 0.012
    assert error < 0.005
    if large > 1.0:  # negative control: the variance of as many equal particles is not that of these
        share = large * first.mean() / (large * first.mean() + 1.0 - first.mean())
        apart, of_equal = share * (1.0 - share), share * (1.0 - share) / 20
        exact = 36 * float(np.sum((volume * (first - share)) ** 2)) / volume.sum() ** 2
        wrong = found * (apart - exact) / (apart - of_equal)
        assert abs(wrong.mean() - 1.0) > 4.0 * error + 0.012


def test_two_sizes_have_the_variance_of_stange():
    """p q (q w_1 + p w_2) over the volume in a cell, from the index of a mixture that is even in every cell."""
    x = lattice(5, 9)
    first = np.arange(len(x)) % 3 == 0
    volume = np.where(first, 8.0, 1.0)
    p = 8.0 / 10.0  # three of 8 and six of 1 in a cell
    in_cell = 30.0
    random = p * (1 - p) * ((1 - p) * 8.0 + p * 1.0) / in_cell
    expected = p * (1 - p) / (p * (1 - p) - random)
    assert mixing_index(x, first, 1.0, volume) == pytest.approx(expected, rel=1e-12)


def test_what_is_refused():
    x = lattice(3, 4)
    kind = np.arange(len(x)) % 2 == 0
    for given, key, words in (
        ((x, kind.astype(int), 1.0), "position", "bool"),
        ((x[:-1], kind, 1.0), "position", "do not fit"),
        ((np.where(x > 2.9, np.nan, x), kind, 1.0), "position", "finite"),
        ((x, kind | True, 1.0), "kind", "both"),
        ((x, kind, -1.0), "cell", "positive"),
        ((x, kind, (1.0, 1.0, 1.0)), "cell", "2 axes"),
        ((x, kind, 1e-6), "cell", "larger"),
        ((x, kind, 1e-300), "cell", "too small to number"),
    ):
        with pytest.raises(InputError) as caught:
            mixing_index(*given)
        assert caught.value.key == key and words in f"{caught.value}"
    for origin in (0.5, [0.5], [0.0, np.nan]):
        with pytest.raises(InputError, match="2 finite numbers"):
            mixing_index(x, kind, 1.0, origin=origin)
