"""Adaptive sampling: rounds over the whole frame, then over rectangles of it, until the frame reaches a target error.

The rectangles of a half follow from the other half's rounds over the whole frame, whose spread in a pixel is the
pixel's variance, and from figures of the whole frame: its samples, its error, the target. The samples of a pixel in one
half therefore do not depend on the colours of that half, and the mean of rounds, weighted by their samples, remains
unbiased. (A half that planned its own rectangles would take few samples where its colours happen to be dark.)

The samples of a rectangle are a power of two, as only such blocks are stratified.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from lookdev.arrays import Floats, Floats32, Ints
from lookdev.metrics import EPSILON, reference_of_halves
from lookdev.scene import Sampling

_FIRST_ROUND = 8  # samples of a half in the first round, where there is a target error
_WHOLE_ROUNDS = 2  # the fewest: their spread is the variance
_NEAR_TARGET = 4.0  # times the target: with an error above this, the next round is over the whole frame
_AIM = 0.9  # times the target: a round aims lower, as another round costs more
_LEAST_GROWTH = 0.05  # of a half's samples, in a round over rectangles
_LAST_ROUND = 24  # from this number on, each round doubles the samples, so that the seeds of a frame suffice
_TILE_SIDE, _TILES_PER_SIDE = 16, 32  # the fewest pixels along a tile; the most tiles along a frame
_CALL_COST = 1024.0  # of a call of the renderer, in samples of one pixel of the asset
_BACKGROUND_COST = 0.1  # of a pixel without the asset, over that of a pixel of the asset


@dataclass(frozen=True)
class Region:
    """A rectangle of the frame, rows counted from the top, and its samples per pixel."""

    rows: slice
    columns: slice
    samples: int
    is_whole_frame: bool = False  # part of a round over the whole frame, whose spread plans later rounds


Round = tuple[tuple[Region, ...], tuple[Region, ...]]
"""The regions of each half."""


@dataclass
class Half:
    """The sums of the rounds of one half of a frame."""

    width: int
    height: int
    gain: float = 1.0  # of the exposure: errors are relative to exposed colours
    colors: Floats = field(init=False)  # (H, W, 3), sum over samples
    coverage: Floats = field(init=False)  # (H, W), sum over samples
    samples: Floats = field(init=False)  # (H, W)
    spread: Floats = field(init=False)  # (H, W, 3), of whole rounds: squared deviations, weighted by samples
    parts: dict[str, Floats] = field(default_factory=dict)  # (H, W, 3), sums over samples, as `colors`
    whole_rounds: int = 0

    def __post_init__(self) -> None:
        shape = self.height, self.width
        self.colors, self.spread = np.zeros((*shape, 3)), np.zeros((*shape, 3))
        self.coverage, self.samples = np.zeros(shape), np.zeros(shape)

    def add(
        self,
        region: Region,
        color: Floats32,
        coverage: Floats32,
        parts: Mapping[str, Floats32] = MappingProxyType({}),
    ) -> None:
        """Add the mean colour (h, w, 3), the mean coverage (h, w) and the parts of the colour of a rendered region."""
        window, samples = (region.rows, region.columns), region.samples
        if region.is_whole_frame:
            if before := float(self.samples[0, 0]):
                # Welford 1962, each mean weighted by its samples.
                self.spread += before * samples / (before + samples) * (color - self.color) ** 2
            self.whole_rounds += 1
        self.colors[window] += samples * color.astype(np.float64)
        self.coverage[window] += samples * coverage.astype(np.float64)
        self.samples[window] += samples
        for name, part in parts.items():
            self.parts.setdefault(name, np.zeros_like(self.colors))[window] += samples * part.astype(np.float64)

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
        """The relative squared error of one sample, (H, W); 0 in pixels without the asset."""
        variance, exposed = self.gain**2 * self.spread / (self.whole_rounds - 1), self.gain * self.color
        reference = reference_of_halves(exposed, exposed, self.alpha)
        return np.asarray((variance / (reference**2 + EPSILON)).mean(axis=-1) * (self.coverage > 0.0))


def mean_samples(halves: Sequence[Half]) -> float:
    """Return the mean samples of a half per pixel of the asset; per pixel of the frame where no asset is seen."""
    covered = np.any([half.coverage > 0.0 for half in halves], axis=0)
    total = np.mean([half.samples for half in halves], axis=0)
    return float(np.mean(total[covered] if covered.any() else total))


def next_round(sampling: Sampling, halves: tuple[Half, Half], rounds: int, error: float) -> Round:
    """Return the regions of the next round, none where the frame is done.

    Without a target error, the whole frame takes the fewest powers of two that sum up to the samples of the job. With
    one, rounds over the whole frame double the samples until the target is near; rounds over rectangles follow.

    rounds : their number so far; error : the estimated relMSE of these, infinite before the first.
    """
    (first, second), target, limit = halves, sampling.error, sampling.samples // 2
    current = mean_samples(halves)
    if current >= limit or (target is not None and error <= target):
        return (), ()
    if target is None:
        return _whole_frame_round(limit - current, first)
    if rounds == first.whole_rounds and (rounds < _WHOLE_ROUNDS or error > _NEAR_TARGET * target):
        return _whole_frame_round(min(max(_FIRST_ROUND, current), limit - current), first)
    growth = _LEAST_GROWTH if rounds < _LAST_ROUND else 1.0
    goals = _AIM * target / error, growth * current, limit - current
    return plan_regions(first, second, *goals), plan_regions(second, first, *goals)


def _whole_frame_round(samples: float, half: Half) -> Round:
    return (region := _whole_frame(half, _power_of_two_below(samples), is_whole_frame=True),), (region,)


def _whole_frame(half: Half, samples: int, *, is_whole_frame: bool = False) -> Region:
    return Region(slice(0, half.height), slice(0, half.width), samples, is_whole_frame)


def plan_regions(half: Half, other: Half, ratio: float, min_samples: float, max_samples: float) -> tuple[Region, ...]:
    """Return the regions of a half that bring its error to `ratio` of the present one, at the least cost.

    The error of the `other` half replaces that of `half`. Samples have a price: each rectangle takes the number of
    samples with the least sum of its error and their price. It is split in two if the parts cost less, calls of the
    renderer included. The price is the highest for which the error reaches the ratio and the mean samples per pixel of
    the asset are at least `min_samples`. If the lowest price for which these are at most `max_samples` is higher, it
    is that price.
    """
    tree = _Tree(half, other, max_samples)
    error = tree.remaining_error[0, 0]
    if error <= 0.0:
        return (_whole_frame(half, _power_of_two_below(min(mean_samples((half,)), max_samples))),)

    def is_too_high(price: float) -> bool:
        cut = tree.cut(2.0**price)
        return cut.remaining_error > ratio * error or cut.samples < min_samples

    def is_affordable(price: float) -> bool:
        return tree.cut(2.0**price).samples <= max_samples

    # The fall of the whole frame's error by one more sample per pixel, over the time of that sample.
    usual_price = np.log2(error / (mean_samples((half,)) * tree.time[0]))
    price_range = usual_price - 30.0, usual_price + 10.0
    price = max(_bisect(*price_range, is_too_high)[0], _bisect(*price_range, is_affordable)[1])
    return tree.regions(tree.cut(2.0**price))


@dataclass(frozen=True)
class _Cut:
    """Nodes of a tree that fill the frame, the samples of each, the mean of these, and the error that remains."""

    nodes: list[int]
    sizes: list[int]
    samples: float
    remaining_error: float


class _Tree:
    """A binary tree of rectangles of tiles, each split where the errors of its parts differ most, down to one tile."""

    def __init__(self, half: Half, other: Half, most: float) -> None:
        side = max(_TILE_SIDE, -(-max(half.height, half.width) // _TILES_PER_SIDE))
        self._edges = _tile_edges(half.height, side), _tile_edges(half.width, side)
        covered = (other.coverage > 0.0).astype(np.float64)
        error, area = self._sums_of_tiles(other.error), self._sums_of_tiles(covered)
        time = area + _BACKGROUND_COST * (self._sums_of_tiles(np.ones_like(covered)) - area)
        samples = half.samples[np.ix_(*(edges[:-1] for edges in self._edges))]
        self._boxes, self._children = _split_tiles(error, time)
        self._sizes = np.array([0, *(2**power for power in range(int(most).bit_length()))])
        self.remaining_error = self._sums_of_boxes(error[..., None] / (samples[..., None] + self._sizes))
        self.time = self._sums_of_boxes(time)
        self._share = self._sums_of_boxes(area) / max(covered.sum(), 1.0)

    def cut(self, price: float) -> _Cut:
        """Return the rectangles for which the remaining error plus the price of their time is least."""
        costs = self.remaining_error + price * (self.time[:, None] * self._sizes + _CALL_COST * (self._sizes > 0))
        choice = costs.argmin(axis=1)
        least = costs[np.arange(len(choice)), choice]
        for node in reversed(range(len(least))):
            if parts := self._children[node]:
                split_cost = least[parts[0]] + least[parts[1]]
                if split_cost < least[node]:
                    least[node], choice[node] = split_cost, -1
        nodes, pending = [], [0]
        while pending:
            node = pending.pop()
            if choice[node] < 0:
                pending += self._children[node] or ()
            else:
                nodes.append(node)
        sizes, errors = self._sizes[choice[nodes]], self.remaining_error[nodes, choice[nodes]]
        return _Cut(nodes, sizes.tolist(), float(self._share[nodes] @ sizes), float(errors.sum()))

    def regions(self, cut: _Cut) -> tuple[Region, ...]:
        """Return the regions of a cut, without rectangles that take no samples."""
        rows, columns = self._edges
        return tuple(
            Region(slice(int(rows[top]), int(rows[bottom])), slice(int(columns[left]), int(columns[right])), size)
            for (top, bottom, left, right), size in zip(self._boxes[cut.nodes], cut.sizes, strict=True)
            if size
        )

    def _sums_of_tiles(self, values: Floats) -> Floats:
        """Return the sums of the pixels of each tile."""
        rows, columns = self._edges
        return np.asarray(np.add.reduceat(np.add.reduceat(values, rows[:-1], axis=0), columns[:-1], axis=1))

    def _sums_of_boxes(self, values: Floats) -> Floats:
        """Return the sums of the tiles of each box, by a summed-area table."""
        sums = np.zeros((values.shape[0] + 1, values.shape[1] + 1, *values.shape[2:]))
        sums[1:, 1:] = values.cumsum(axis=0).cumsum(axis=1)
        top, bottom, left, right = self._boxes.T
        return np.asarray(sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left])


def _tile_edges(size: int, side: int) -> Ints:
    """Return the edges of the tiles along a side of the frame; the last tile is at least half as long as the others."""
    return np.asarray([*range(0, size - side // 2, side), size] if size > side // 2 else [0, size])


def _split_tiles(error: Floats, time: Floats) -> tuple[Ints, list[tuple[int, int] | None]]:
    """Return boxes (n, 4) of tiles (top, bottom, left, right), and the numbers of each box's parts, None for a tile.

    With the best number of samples in each part, the time to reach an error is proportional to the square of the sum of
    ``sqrt(error * time)`` over the parts; the split with the least sum is taken.
    """
    boxes: list[tuple[int, int, int, int]] = [(0, error.shape[0], 0, error.shape[1])]
    parts: list[tuple[int, int] | None] = []
    # The list grows in the loop: the parts of a box come after it.
    for top, bottom, left, right in boxes:
        best_split: tuple[float, int, int] | None = None
        for axis in (0, 1):
            errors, times = (np.cumsum(values[top:bottom, left:right].sum(axis=1 - axis)) for values in (error, time))
            if len(errors) > 1:
                first, second = errors[:-1] * times[:-1], (errors[-1] - errors[:-1]) * (times[-1] - times[:-1])
                work = np.sqrt(first) + np.sqrt(np.maximum(second, 0.0))
                split = int(work.argmin())
                best_split = min(filter(None, (best_split, (float(work[split]), axis, split + 1))))
        if best_split is None:
            parts.append(None)
            continue
        parts.append((len(boxes), len(boxes) + 1))
        _, axis, split = best_split
        if axis == 0:
            boxes += [(top, top + split, left, right), (top + split, bottom, left, right)]
        else:
            boxes += [(top, bottom, left, left + split), (top, bottom, left + split, right)]
    return np.array(boxes), parts


def _bisect(low: float, high: float, holds: Callable[[float], bool]) -> tuple[float, float]:
    """Return two numbers less than .05 apart: `holds` is false at the first and true at the second."""
    while high - low > 0.05:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return low, high


def _power_of_two_below(samples: float) -> int:
    """Return the largest power of two that is at most `samples`."""
    return 1 << (int(samples).bit_length() - 1)
