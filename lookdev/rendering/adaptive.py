"""Samples where the error is: rounds over the whole frame, then over rectangles of it, until a target is reached.

Each half's rectangles follow from the other half's rounds over the whole frame, between which the spread of a pixel is
its variance, and from numbers that concern the whole frame: how much is done, its error, the target. So the number of
samples of a pixel in one half does not depend on what that half found in it, and rounds weighted by their samples
remain unbiased. (A half that chose for itself would take few samples where it happens to have found little light.)

A rectangle takes a power of two of samples, as only such blocks are stratified.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from lookdev.metrics import EPSILON, reference_of_halves
from lookdev.scene import Sampling

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_FIRST_ROUND = 8  # samples of a half in the first round towards a target error
_WHOLE_ROUNDS = 2  # at least, as their spread is the variance
_NEAR = 4.0  # times the target: above it the whole frame takes another round
_AIM = 0.9  # of the target: a round that falls short takes another one
_LEAST_GROWTH = 0.05  # of a round over rectangles
_LAST_ROUND = 24  # from which on samples double, so that seeds suffice
_TILE, _TILES = 16, 32  # pixels along the side of a tile at least; tiles along the side of a frame at most
_CALL = 1024.0  # samples of pixels of the asset that take as long as a call of the renderer does besides
_BACKGROUND = 0.1  # of the time of a pixel of the asset, for one that shows none


@dataclass(frozen=True)
class Region:
    """A rectangle of the frame, rows counted from the top, and the samples a pixel that it takes."""

    rows: slice
    columns: slice
    samples: int
    whole: bool = False  # of the rounds over the whole frame, by which later ones are planned


Round = tuple[tuple[Region, ...], tuple[Region, ...]]
"""The regions of each half."""


@dataclass
class Half:
    """What the rounds of one half have found."""

    width: int
    height: int
    gain: float = 1.0  # of the exposure: errors are relative to what is shown
    colors: Floats = field(init=False)  # (H, W, 3), sum over samples
    coverage: Floats = field(init=False)  # (H, W), sum over samples
    samples: Floats = field(init=False)  # (H, W)
    spread: Floats = field(init=False)  # (H, W, 3), squared deviations of whole rounds, by samples
    parts: dict[str, Floats] = field(default_factory=dict)  # (H, W, 3), of colors
    whole_rounds: int = 0

    def __post_init__(self) -> None:
        shape = self.height, self.width
        self.colors, self.spread = np.zeros((*shape, 3)), np.zeros((*shape, 3))
        self.coverage, self.samples = np.zeros(shape), np.zeros(shape)

    def add(
        self,
        region: Region,
        color: NDArray[np.float32],
        coverage: NDArray[np.float32],
        parts: Mapping[str, NDArray[np.float32]] = MappingProxyType({}),
    ) -> None:
        """Add the mean colour (h, w, 3), coverage (h, w) and parts of the colour of the samples of a region."""
        part, size = (region.rows, region.columns), region.samples
        if region.whole:
            if done := float(self.samples[0, 0]):
                # Welford 1962, each mean weighted by its samples.
                self.spread += done * size / (done + size) * (color - self.color) ** 2
            self.whole_rounds += 1
        self.colors[part] += size * color.astype(np.float64)
        self.coverage[part] += size * coverage.astype(np.float64)
        self.samples[part] += size
        for name, each in parts.items():
            self.parts.setdefault(name, np.zeros_like(self.colors))[part] += size * each.astype(np.float64)

    @property
    def color(self) -> Floats:
        """The mean colour, (H, W, 3)."""
        return np.asarray(self.colors / self.samples[..., None])

    @property
    def alpha(self) -> Floats:
        """The mean coverage, (H, W)."""
        return np.asarray(self.coverage / self.samples)

    @property
    def error(self) -> Floats:
        """The relative squared error of one sample, (H, W); 0 where no asset is seen."""
        variance, shown = self.gain**2 * self.spread / (self.whole_rounds - 1), self.gain * self.color
        reference = reference_of_halves(shown, shown, self.alpha)
        return np.asarray((variance / (reference**2 + EPSILON)).mean(axis=-1) * (self.coverage > 0.0))


def mean_samples(halves: Sequence[Half]) -> float:
    """Return the samples of a half, the mean over the pixels of the asset; of the frame where there is none."""
    covered = np.any([half.coverage > 0.0 for half in halves], axis=0)
    total = np.mean([half.samples for half in halves], axis=0)
    return float(np.mean(total[covered] if covered.any() else total))


def next_round(sampling: Sampling, halves: tuple[Half, Half], number: int, error: float) -> Round:
    """Return what to render next: no regions where the frame is done.

    Without a target, the whole frame takes the fewest powers of two that sum up to the samples set. With one, it
    doubles its samples until the target is near, and rectangles of it follow.

    number : of rounds so far; error : the estimated relMSE of what they rendered, infinite where there is nothing.
    """
    (first, second), target, most = halves, sampling.error, sampling.samples // 2
    done = mean_samples(halves)
    if done >= most or (target is not None and error <= target):
        return (), ()
    if target is None:
        return _whole(most - done, first)
    if number == first.whole_rounds and (number < _WHOLE_ROUNDS or error > _NEAR * target):
        return _whole(min(max(_FIRST_ROUND, done), most - done), first)
    growth = _LEAST_GROWTH if number < _LAST_ROUND else 1.0
    wanted = _AIM * target / error, growth * done, most - done
    return plan_regions(first, second, *wanted), plan_regions(second, first, *wanted)


def _whole(samples: float, half: Half) -> Round:
    return (region := _frame(half, _power(samples), whole=True),), (region,)


def _frame(half: Half, samples: int, *, whole: bool = False) -> Region:
    return Region(slice(0, half.height), slice(0, half.width), samples, whole)


def plan_regions(half: Half, other: Half, ratio: float, least: float, most: float) -> tuple[Region, ...]:
    """Return the regions of a half that bring its error, as the other's, to `ratio` of what it is, at the least cost.

    A price of samples decides: each rectangle takes the samples for which the sum of its error and their price is
    least, and is split in two where that costs less, calls of the renderer included. The price is the highest for which
    the error is as wanted and at least `least` samples are taken, the mean over the pixels of the asset, or the lowest
    for which these are at most `most`.
    """
    tree = _Tree(half, other, most)
    before = tree.left[0, 0]
    if before <= 0.0:
        return (_frame(half, _power(min(mean_samples((half,)), most))),)

    def dear(price: float) -> bool:
        cut = tree.cut(2.0**price)
        return cut.left > ratio * before or cut.samples < least

    def affordable(price: float) -> bool:
        return tree.cut(2.0**price).samples <= most

    # Of the whole frame, the error that the next sample takes away, for the time of a pixel.
    usual = np.log2(before / (mean_samples((half,)) * tree.time[0]))
    within = usual - 30.0, usual + 10.0
    price = max(_boundary(*within, dear)[0], _boundary(*within, affordable)[1])
    return tree.regions(tree.cut(2.0**price))


@dataclass(frozen=True)
class _Cut:
    """Nodes of a tree that fill the frame, the samples of each, their mean, and the error that they leave."""

    nodes: list[int]
    sizes: list[int]
    samples: float
    left: float


class _Tree:
    """The rectangles of tiles of a half, each cut in two where errors differ most, down to single tiles."""

    def __init__(self, half: Half, other: Half, most: float) -> None:
        side = max(_TILE, -(-max(half.height, half.width) // _TILES))
        self._edges = _edges(half.height, side), _edges(half.width, side)
        covered = (other.coverage > 0.0).astype(np.float64)
        error, area = self._sums(other.error), self._sums(covered)
        time = area + _BACKGROUND * (self._sums(np.ones_like(covered)) - area)
        samples = half.samples[np.ix_(*(edges[:-1] for edges in self._edges))]
        self._boxes, self._parts = _cut_in_two(error, time)
        self._sizes = np.array([0, *(2**power for power in range(int(most).bit_length()))])
        self.left = self._of_boxes(error[..., None] / (samples[..., None] + self._sizes))
        self.time = self._of_boxes(time)
        self._share = self._of_boxes(area) / max(covered.sum(), 1.0)

    def cut(self, price: float) -> _Cut:
        """Return the rectangles for which the sum of what error is left and the price of their time is least."""
        costs = self.left + price * (self.time[:, None] * self._sizes + _CALL * (self._sizes > 0))
        choice = costs.argmin(axis=1)
        least = costs[np.arange(len(choice)), choice]
        for node in reversed(range(len(least))):
            if parts := self._parts[node]:
                apart = least[parts[0]] + least[parts[1]]
                if apart < least[node]:
                    least[node], choice[node] = apart, -1
        nodes, waiting = [], [0]
        while waiting:
            node = waiting.pop()
            if choice[node] < 0:
                waiting += self._parts[node] or ()
            else:
                nodes.append(node)
        sizes = self._sizes[choice[nodes]]
        samples, left = float(self._share[nodes] @ sizes), float(self.left[nodes, choice[nodes]].sum())
        return _Cut(nodes, sizes.tolist(), samples, left)

    def regions(self, cut: _Cut) -> tuple[Region, ...]:
        """Return the rectangles of a cut that take samples."""
        rows, columns = self._edges
        return tuple(
            Region(slice(int(rows[top]), int(rows[bottom])), slice(int(columns[left]), int(columns[right])), size)
            for (top, bottom, left, right), size in zip(self._boxes[cut.nodes], cut.sizes, strict=True)
            if size
        )

    def _sums(self, values: Floats) -> Floats:
        """Return the sums over tiles."""
        rows, columns = self._edges
        return np.asarray(np.add.reduceat(np.add.reduceat(values, rows[:-1], axis=0), columns[:-1], axis=1))

    def _of_boxes(self, values: Floats) -> Floats:
        """Return the sums of values of tiles over all boxes."""
        sums = np.zeros((values.shape[0] + 1, values.shape[1] + 1, *values.shape[2:]))
        sums[1:, 1:] = values.cumsum(axis=0).cumsum(axis=1)
        top, bottom, left, right = self._boxes.T
        return np.asarray(sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left])


def _edges(size: int, side: int) -> Ints:
    """Return where tiles begin along a side of the frame, and its end; no tile is less than half as long as others."""
    return np.asarray([*range(0, size - side // 2, side), size] if size > side // 2 else [0, size])


def _cut_in_two(error: Floats, time: Floats) -> tuple[Ints, list[tuple[int, int] | None]]:
    """Return boxes (n, 4) of tiles, top, bottom, left, right, and the numbers of the two parts of each, none of a tile.

    With any number of samples in each part, the time to an error is least in proportion to the square of the sum of
    ``sqrt(error * time)``.
    """
    boxes: list[tuple[int, int, int, int]] = [(0, error.shape[0], 0, error.shape[1])]
    parts: list[tuple[int, int] | None] = []
    # The list grows while it is read: parts come after what they are parts of.
    for top, bottom, left, right in boxes:
        best: tuple[float, int, int] | None = None
        for axis in (0, 1):
            errors, times = (np.cumsum(each[top:bottom, left:right].sum(axis=1 - axis)) for each in (error, time))
            if len(errors) > 1:
                first, second = errors[:-1] * times[:-1], (errors[-1] - errors[:-1]) * (times[-1] - times[:-1])
                work = np.sqrt(first) + np.sqrt(np.maximum(second, 0.0))
                where = int(work.argmin())
                best = min(filter(None, (best, (float(work[where]), axis, where + 1))))
        if best is None:
            parts.append(None)
            continue
        parts.append((len(boxes), len(boxes) + 1))
        _, axis, where = best
        if axis == 0:
            boxes += [(top, top + where, left, right), (top + where, bottom, left, right)]
        else:
            boxes += [(top, bottom, left, left + where), (top, bottom, left + where, right)]
    return np.array(boxes), parts


def _boundary(low: float, high: float, holds: Callable[[float], bool]) -> tuple[float, float]:
    """Return, within .05, the last number for which something does not hold, and the first for which it does."""
    while high - low > 0.05:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return low, high


def _power(samples: float) -> int:
    """Return the largest power of two that is at most some samples."""
    return 1 << (int(samples).bit_length() - 1)
