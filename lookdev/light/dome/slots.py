"""The slots of a dome light: for each bin of normals, ranges of the light's points with equal probabilities.

For a diffuse surface, the best pdf is proportional to radiance times cosine. The points (`points`) are distributed in
proportion to the radiance. For each bin of normals (`bins`), the curve of the points is cut into M *slots*. A slot is a
range of consecutive points; all slots of a bin have nearly the same sum of g, the bin's widened cosine. A sample draws
a slot uniformly, then one of its points uniformly. The probability of a point is therefore 1 / (M c), where c is the
number of points in its slot. A point whose g is greater than the sum of a slot fills several slots.

Let p be the resulting pdf over solid angle, and m the mean of the channels of the radiance. p is nearly the pdf
q = m g / integral, where `integral` is the integral of m g over the sphere. q needs no table, so multiple importance
sampling computes its weight from q. The estimate divides by p. It is equal to an estimate that divides by q, times the
ratio q / p = g M c / sum(g), which is close to 1. The sum is over all points.

After the bins of normals there is one more bin, whose g is 1 for all directions.

The file of slots: slot n of bin b is the integer b M + n, in the format of `pack_ranges`. The file of bins has two
numbers for each bin: 1 / integral, or 0 if no light reaches the bin's normals, and M / sum(g).
"""

from __future__ import annotations

import os

import numpy as np

from lookdev.arrays import Floats, Floats32, Ints, Ints32
from lookdev.light.dome import bins

SLOTS = 2**12
"""The number of slots of each bin, M."""

MOST_POINTS = 3583
"""The largest number of points in a slot for which `pack_ranges` has a code."""

CODE_BITS = 12
"""The number of bits of the code in a packed slot; the bits above them are the index of the slot's first point."""

_MAX_REPETITIONS = 2**CODE_BITS - MOST_POINTS  # the most slots of one point for which there is a code
# The least weight of a point is the mean sum of a slot divided by this number, so that no slot has too many points.
_MIN_WEIGHTS_PER_SLOT = 2300


def cut_slots(directions: Floats, integral: float) -> tuple[Ints32, Floats32]:
    """Cut the curve of the points into the slots of each bin.

    Returns the content of both files: slots (bins, M), and the two numbers of each bin (bins, 2).

    Parameters
    ----------
    directions : (N, 3)
        The directions of the points. N is at most 387 times M, so that no slot has more than `MOST_POINTS`.
    integral
        The integral over the sphere of the mean of the radiance's channels.
    """
    from concurrent.futures import ThreadPoolExecutor  # imported here, so that the render worker starts sooner

    slots, numbers = np.zeros((bins.COUNT + 1, SLOTS), np.int32), np.zeros((bins.COUNT + 1, 2), np.float32)
    # float32, in which the shader computes, is enough, because g is only a weight.
    x, y, z = (np.ascontiguousarray(column, np.float32) for column in directions.T)

    def fill(number: int) -> None:
        if number == bins.COUNT:
            weights = np.ones_like(x)
        else:
            a, b, c = bins.AXES[number].astype(np.float32)
            weights = bins.widened_cosine(a * x + b * y + c * z)
        total = float(weights.sum(dtype=np.float64))
        if total > 0.0:
            slots[number] = pack_ranges(*cut_ranges(weights, SLOTS, least=total / (SLOTS * _MIN_WEIGHTS_PER_SLOT)))
            numbers[number] = len(directions) / (integral * total), SLOTS / total

    # Threads run in parallel: NumPy releases the interpreter's lock.
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(fill, range(bins.COUNT + 1)))
    return slots, numbers


def pack_ranges(first: Ints, count: Ints, times: Ints) -> Ints32:
    """Pack ranges, as `cut_ranges` returns them, into integers: 20 bits for the first point, 12 bits for a code.

    A code up to `MOST_POINTS` is the number of points in the slot. A greater code means a single point that fills
    ``code - MOST_POINTS + 1`` slots. The code 0 is an empty slot. If a point fills more slots than the largest code
    expresses, the excess slots are empty.
    """
    # The slots that one point fills are consecutive; `repetition` counts them from 0.
    repetition = np.arange(len(first)) - np.searchsorted(first, first)
    code = np.where(times > 1, MOST_POINTS - 1 + np.minimum(times, _MAX_REPETITIONS), count)
    return np.where(repetition < _MAX_REPETITIONS, first << CODE_BITS | code, 0).astype(np.uint32).view(np.int32)


def cut_ranges(values: Floats | Floats32, number: int, least: float = 0.0) -> tuple[Ints, Ints, Ints]:
    """Cut a row of values (n,), not negative and not all zero, into `number` ranges of nearly the same sum.

    Values below `least` count as `least`, which limits the length of a range. Long runs of zeros are in no range,
    because samples of points without weight are wasted; a *stretch* is a row of values between two such runs.

    Returns
    -------
    three arrays (number,)
        The first index of each range; the count of its values; and the number of ranges that are equal to it, itself
        included. Equal ranges have a single value. Apart from such repetitions, the ranges contain every value above
        zero once.
    """
    nonzero, weights = np.flatnonzero(values > 0.0), np.maximum(values, least)
    cumulative = np.cumsum(weights, dtype=np.float64)
    longest = max(1, len(nonzero) // number)
    # `gaps` are the indices, in `nonzero`, of the values before a long run of zeros. A run is long if it is longer than
    # an average range; the limit doubles until there are few enough runs.
    while (gaps := np.flatnonzero(np.diff(nonzero) > longest)).size > number // 4:
        longest *= 2
    begin, end = nonzero[np.append(0, gaps + 1)], nonzero[np.append(gaps, len(nonzero) - 1)] + 1
    before = cumulative[begin] - weights[begin]  # the sum of all values before each stretch
    mass = cumulative[end - 1] - before
    # `shares` are the numbers of ranges of each stretch, at least one. The heaviest stretches get the ranges that
    # rounding down leaves over.
    shares = 1 + np.floor((number - len(mass)) * mass / mass.sum()).astype(np.int64)
    shares[np.argsort(-mass, kind="stable")[: number - shares.sum()]] += 1
    stretch = np.repeat(np.arange(len(mass)), shares)
    number_in_stretch = np.arange(number) - np.repeat(np.cumsum(shares) - shares, shares)
    targets = before[stretch] + mass[stretch] * number_in_stretch / shares[stretch]
    first = np.clip(np.searchsorted(cumulative, targets, side="right"), begin[stretch], end[stretch] - 1)
    # The first range of a stretch begins with the stretch, even if the stretch's first value is too small to change the
    # cumulative sum.
    first = np.where(number_in_stretch == 0, begin[stretch], first)
    # A value that is greater than the sum of a range fills all ranges that begin with it. If other values follow before
    # the next range, the last of the filled ranges has these other values instead: it is the *remainder*.
    starts, group, times = np.unique(first, return_inverse=True, return_counts=True)
    times = times[group]
    count = np.minimum(np.append(starts[1:], len(values))[group], end[stretch]) - first
    followers = np.searchsorted(nonzero, first + count) - np.searchsorted(nonzero, first, side="right")
    has_remainder = (times > 1) & (followers > 0)
    is_remainder = has_remainder & np.append(np.diff(group) > 0, True)
    count = np.where(is_remainder, count - 1, np.where(times > 1, 1, count))
    return first + is_remainder, count, np.where(is_remainder, 1, times - has_remainder)
