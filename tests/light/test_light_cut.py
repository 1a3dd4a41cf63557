"""The order of a light's points, and their ranges."""

import numpy as np
import pytest

from lookdev.arrays import Floats, Ints
from lookdev.light.dome.points import hilbert_positions
from lookdev.light.dome.slots import cut_ranges


def drawn(first: Ints, count: Ints, times: Ints, n: int) -> tuple[Floats, Ints]:
    """Return the probability of each of n points, and the first index of its distinct range, -1 without one."""
    distinct = np.unique(first, return_index=True)[1]
    part = np.full(n, -1)
    probability = np.zeros(n)
    for k in distinct:
        assert count[k] >= 1
        assert times[k] == (first == first[k]).sum()
        assert ((first[k] + count[k] <= first) | (first <= first[k])).all()  # ranges do not overlap
        part[first[k] : first[k] + count[k]] = k
        probability[first[k] : first[k] + count[k]] = times[k] / (len(first) * count[k])
    return probability, part


@pytest.mark.parametrize("side", [1, 2, 4, 32])
def test_a_hilbert_curve_goes_from_each_cell_to_the_next(side: int) -> None:
    square = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)
    position = hilbert_positions(square, side)
    assert sorted(position) == list(range(side * side))
    steps = np.abs(np.diff(square[np.argsort(position)], axis=0)).sum(axis=1)
    assert (steps == 1).all()


def random_values(seed: int) -> Floats:
    """Values of any size, in runs between zeros."""
    rng = np.random.default_rng(seed)
    size = int(rng.integers(1, 3000))
    seen = np.repeat(rng.random(size) < rng.random(), rng.integers(1, 40, size))[:size]
    values = seen * rng.uniform(0.01, 1.0, size) ** rng.integers(1, 4)
    values[rng.integers(size)] = 1.0
    return np.asarray(values)


@pytest.mark.parametrize(
    "values",
    [
        *(np.ones(size) for size in (1, 16, 17, 1000)),
        *(np.eye(1, 1000, position)[0] for position in (0, 321, 999)),
        np.arange(1000.0),
        1.0 + 500.0 * np.eye(1, 1000, 321)[0],
        np.arange(1000) % 50 == 7.0,
        np.arange(1000) % 500 < 3.0,
        *map(random_values, range(40)),
    ],
)
@pytest.mark.parametrize("number", [1, 4, 16, 256])
def test_ranges_have_all_that_is_above_zero_once(values: Floats, number: int) -> None:
    values = values.astype(np.float64)
    first, count, times = cut_ranges(values, number)
    assert len(first) == len(count) == len(times) == number
    assert (first >= 0).all()
    assert (np.diff(first) >= 0).all()
    assert (first + count <= len(values)).all()
    probability, part = drawn(first, count, times, len(values))
    assert probability.sum() == pytest.approx(1.0, rel=1e-12)
    assert (probability[values > 0.0] > 0.0).all()
    # At both ends an edge may fall inside a value. Stretches between zeros, at most a quarter plus one, get a range
    # each first; only the other ranges are in proportion.
    sums = np.bincount(part[part >= 0], values[part >= 0], number)
    most = times * values.sum() / (number - number // 4 - 1 if number > 1 else 1) + values.max()
    assert (sums <= most * (1.0 + 1e-12)).all()


@pytest.mark.parametrize("number", [1, 4, 16, 256])
def test_ranges_of_one_stretch_are_alike(number: int) -> None:
    values = np.random.default_rng(1).uniform(0.1, 1.0, 5000)
    first, count, times = cut_ranges(values, number)
    for begin, size, how_many in zip(first, count, times, strict=True):
        error = values[begin : begin + size].sum() - how_many * values.sum() / number
        assert abs(error) <= values.max()


def test_even_values_are_cut_evenly() -> None:
    first, count, times = cut_ranges(np.ones(16), 4)
    assert [first.tolist(), count.tolist(), times.tolist()] == [[0, 4, 8, 12], [4] * 4, [1] * 4]
    first, count, times = cut_ranges(np.ones(4), 16)
    assert [first.tolist(), count.tolist(), times.tolist()] == [[*np.repeat(range(4), 4)], [1] * 16, [4] * 16]


def test_a_value_that_outweighs_ranges_has_them() -> None:
    values = np.ones(1000)
    values[600] = 1000.0
    first, _, times = cut_ranges(values, 100)
    # Half of all ranges, except for those at its ends.
    assert 49 <= (first == 600).sum() <= 51
    assert (times[first == 600] == (first == 600).sum()).all()
    lone = cut_ranges(np.eye(1, 1000, 600)[0], 100)
    assert [set(column.tolist()) for column in lone] == [{600}, {1}, {100}]


def test_ranges_end_where_nothing_is_for_long() -> None:
    # A range has 100 values that are not zero. More zeros than that split the row: 101 do, 99 do not.
    for zeros, covered in ((101, 0), (99, 99)):
        values = np.ones(800 + zeros)
        values[450 : 450 + zeros] = 0.0
        probability, _ = drawn(*cut_ranges(values, 8), len(values))
        assert (probability[450 : 450 + zeros] > 0.0).sum() == covered


@pytest.mark.parametrize("seed", range(20))
def test_ranges_of_small_values_are_short(seed: int) -> None:
    values, number = random_values(seed), 64
    least = values.sum() / (4 * number)
    first, count, times = cut_ranges(values, number, least=least)
    probability, _ = drawn(first, count, times, len(values))
    assert (probability[values > 0.0] > 0.0).all()
    # A range has at most 4/3 of its share, because stretches take a quarter first, plus one value at an edge.
    share = np.maximum(values, least).sum() / (number - number // 4 - 1)
    assert (count <= share / least + 1.0).all()
