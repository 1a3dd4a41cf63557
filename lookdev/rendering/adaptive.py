"""Adaptive sampling: rounds over the whole frame, then over rectangles of it, until the frame reaches a target error.

A renderer calls `next_round` until it returns no more regions (`lookdev.rendering.frame`). A frame is the mean of two
independent halves, and a round adds samples to both.

The rectangles of one half are planned from the variance of each pixel in the other half. This variance is measured
between rounds over the whole frame. Besides, the plan depends only on figures of the whole frame: its samples, its
error, the target. The number of samples of a pixel in one half therefore does not depend on the colours of that half.
The mean of rounds, weighted by their samples, thus remains unbiased. (A half that planned its own rectangles would take
few samples where its colours happen to be dark.)

The number of samples per pixel of a rectangle is a power of two, because only such blocks of samples are stratified.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from lookdev.arrays import Floats, Floats32, Ints
from lookdev.metrics import EPSILON, reference_of_halves
from lookdev.scene import Sampling

_FIRST_ROUND = 8  # samples per pixel of a half in the first round, where there is a target error
_WHOLE_ROUNDS = 2  # the least number of rounds over the whole frame: the variance of a pixel needs two
_NEAR_TARGET = 4.0  # times the target error: above this error, the next round is over the whole frame
_AIM = 0.9  # times the target error: a round aims at this lower error, because another round would cost more
_LEAST_GROWTH = 0.05  # a round over rectangles adds at least this share of a half's samples
_LAST_ROUND = 24  # from this round on, each round doubles the samples, so that the seeds of a frame suffice
_TILE_SIDE, _TILES_PER_SIDE = 16, 32  # the least pixels along a side of a tile; the most tiles along a side of a frame
_CALL_COST = 1024.0  # the time of a call of the renderer, over the time of one sample of a pixel on the asset
_BACKGROUND_COST = 0.1  # the time of a sample outside the asset, over the time of a sample on the asset


@dataclass(frozen=True)
class Region:
    """A rectangle of the frame, rows counted from the top, and the samples per pixel to render in one half."""

    rows: slice
    columns: slice
    samples: int
    is_whole_frame: bool = False  # whether the round is over the whole frame, and updates the variance of each pixel


Round = tuple[tuple[Region, ...], tuple[Region, ...]]
"""The regions to render in the first half, and those in the second."""


@dataclass
class Half:
    """One half of a frame: sums over the samples that its rounds have rendered so far."""

    width: int
    height: int
    gain: float = 1.0  # the factor of the exposure, 2 ** stops: errors are relative to exposed colours
    colors: Floats = field(init=False)  # (H, W, 3), sum over samples
    coverage: Floats = field(init=False)  # (H, W), sum over samples
    samples: Floats = field(init=False)  # (H, W), number of samples
    # (H, W, 3), sum over the rounds over the whole frame: the squared deviation of a round's mean, times its samples.
    spread: Floats = field(init=False)
    # Parts of the colours by name, such as the contribution of one light: each (H, W, 3), sum over samples.
    parts: dict[str, Floats] = field(default_factory=dict)
    whole_rounds: int = 0  # number of rounds over the whole frame

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
        """Add a rendered region: its mean colour (h, w, 3), mean coverage (h, w) and mean parts (h, w, 3) by name."""
        window, samples = (region.rows, region.columns), region.samples
        if region.is_whole_frame:
            if before := float(self.samples[0, 0]):
                # The update of Welford 1962 for a sum of squared deviations, each mean weighted by its samples.
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
    """Return the mean samples per pixel of a half, over the pixels of the asset; over all pixels if it is not seen."""
    covered = np.any([half.coverage > 0.0 for half in halves], axis=0)
    total = np.mean([half.samples for half in halves], axis=0)
    return float(np.mean(total[covered] if covered.any() else total))


def next_round(sampling: Sampling, halves: tuple[Half, Half], rounds: int, error: float) -> Round:
    """Return the regions of the next round; no regions if the frame is done.

    Without a target error, all rounds are over the whole frame. Their samples are the fewest powers of two that sum up
    to the samples of the job. With a target error, rounds over the whole frame double the samples until the target is
    near. Rounds over rectangles follow.

    rounds : the number of rounds so far; error : the relMSE that is estimated after these rounds, infinite before the
    first round.
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
    """Return a round over the whole frame, in both halves, with the largest power of two of at most `samples`."""
    return (region := _whole_frame(half, _power_of_two_below(samples), is_whole_frame=True),), (region,)


def _whole_frame(half: Half, samples: int, *, is_whole_frame: bool = False) -> Region:
    """Return the region of all pixels."""
    return Region(slice(0, half.height), slice(0, half.width), samples, is_whole_frame)


def plan_regions(half: Half, other: Half, ratio: float, min_samples: float, max_samples: float) -> tuple[Region, ...]:
    """Return the regions of a half that bring its error to `ratio` of the present one, at the least cost.

    The error of `half` is taken from the `other` half. Render time has a price, in error per sample of a pixel. The
    cost of a rectangle is its remaining error plus the price of its render time. For a given price, each rectangle
    takes the number of samples with the least cost. A rectangle is split in two if the two together cost less, calls of
    the renderer included. A high price gives few samples.

    The price is the highest price for which the error reaches the ratio and the mean samples per pixel of the asset are
    at least `min_samples`. If these samples exceed `max_samples`, the price is the lowest for which they do not.
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

    # Prices are searched as base 2 logarithms, in a range about a usual price. The usual price is the decrease of the
    # frame's error by one more sample per pixel, over the time of that sample.
    usual_price = np.log2(error / (mean_samples((half,)) * tree.time[0]))
    price_range = usual_price - 30.0, usual_price + 10.0
    price = max(_bisect(*price_range, is_too_high)[0], _bisect(*price_range, is_affordable)[1])
    return tree.regions(tree.cut(2.0**price))


@dataclass(frozen=True)
class _Cut:
    """Rectangles of a `_Tree` that together fill the frame, with the samples that each takes."""

    nodes: list[int]  # the numbers of the rectangles
    sizes: list[int]  # samples per pixel of each rectangle, 0 or a power of two
    samples: float  # mean over the pixels of the asset
    remaining_error: float  # sum over the frame, after these samples


class _Tree:
    """A binary tree of rectangles of tiles. Node 0 is the whole frame; `_split_tiles` splits nodes down to one tile.

    Parameters
    ----------
    half, other
        The half whose rectangles are planned, and the half from which errors are taken.
    most
        The most samples per pixel of a rectangle.

    Attributes
    ----------
    remaining_error
        (nodes, sizes): the error of each rectangle after it takes each number of samples in `_sizes`, 0, 1, 2, 4, ...
    time
        (nodes,): the time of one sample per pixel of each rectangle, in samples of one pixel of the asset.
    """

    def __init__(self, half: Half, other: Half, most: float) -> None:
        side = max(_TILE_SIDE, -(-max(half.height, half.width) // _TILES_PER_SIDE))
        self._edges = _tile_edges(half.height, side), _tile_edges(half.width, side)
        covered = (other.coverage > 0.0).astype(np.float64)
        error, area = self._sums_of_tiles(other.error), self._sums_of_tiles(covered)
        time = area + _BACKGROUND_COST * (self._sums_of_tiles(np.ones_like(covered)) - area)
        # All pixels of a tile have the same number of samples, since rounds are over whole tiles.
        samples = half.samples[np.ix_(*(edges[:-1] for edges in self._edges))]
        self._boxes, self._children = _split_tiles(error, time)
        self._sizes = np.array([0, *(2**power for power in range(int(most).bit_length()))])
        self.remaining_error = self._sums_of_boxes(error[..., None] / (samples[..., None] + self._sizes))
        self.time = self._sums_of_boxes(time)
        self._share = self._sums_of_boxes(area) / max(covered.sum(), 1.0)  # (nodes,): the share of the asset's pixels

    def cut(self, price: float) -> _Cut:
        """Return the rectangles and samples with the least cost: the remaining error plus the price of the time."""
        costs = self.remaining_error + price * (self.time[:, None] * self._sizes + _CALL_COST * (self._sizes > 0))
        choice = costs.argmin(axis=1)
        least = costs[np.arange(len(choice)), choice]
        # The parts of a rectangle have higher numbers than the rectangle, so they come first here. A choice of -1 means
        # that the rectangle is split.
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
        """Return the sums of pixel values (H, W) over each tile, (rows of tiles, columns of tiles)."""
        rows, columns = self._edges
        return np.asarray(np.add.reduceat(np.add.reduceat(values, rows[:-1], axis=0), columns[:-1], axis=1))

    def _sums_of_boxes(self, values: Floats) -> Floats:
        """Return the sums (nodes, ...) of tile values (rows, columns, ...) over each node, by a summed-area table."""
        sums = np.zeros((values.shape[0] + 1, values.shape[1] + 1, *values.shape[2:]))
        sums[1:, 1:] = values.cumsum(axis=0).cumsum(axis=1)
        top, bottom, left, right = self._boxes.T
        return np.asarray(sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left])


def _tile_edges(size: int, side: int) -> Ints:
    """Return the edges of tiles along a side of a frame; the side has `size` pixels, and a tile has `side` pixels.

    The last tile has at least half of these pixels.
    """
    return np.asarray([*range(0, size - side // 2, side), size] if size > side // 2 else [0, size])


def _split_tiles(error: Floats, time: Floats) -> tuple[Ints, list[tuple[int, int] | None]]:
    """Return the nodes of a tree: boxes (n, 4), and the numbers of the two parts of each box, or None for one tile.

    A box is (top, bottom, left, right), edges counted in tiles. Box 0 is the whole frame. A box is split at the row or
    column for which the sum of ``sqrt(error * time)`` over the two parts is least: with the best number of samples in
    each part, the time to reach an error is proportional to the square of that sum.

    error, time : (rows of tiles, columns of tiles), the error of one sample, and the time of one sample per pixel.
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
    """Return two numbers at most .05 apart, by bisection: `holds` is false at the first and true at the second.

    `holds` is assumed to be false at `low` and true at `high`; this is not tested.
    """
    while high - low > 0.05:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return low, high


def _power_of_two_below(samples: float) -> int:
    """Return the largest power of two that is at most `samples`."""
    return 1 << (int(samples).bit_length() - 1)
