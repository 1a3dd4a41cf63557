"""The loop that renders a frame: rounds of samples in two independent halves, until the target error is reached.

The workers of all renderers call `render_halves` with a function that renders a region of the frame. The frame is
denoised if the task asks for it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lookdev.arrays import Floats, Floats32
from lookdev.metrics import relmse_of_halves
from lookdev.rendering.adaptive import Half, Region, mean_samples, next_round
from lookdev.rendering.denoise import Denoised, denoise_halves
from lookdev.rendering.task import FrameTask

# Each round of each half has a seed of its own. This number of seeds is reserved for a frame, so that frames with
# neighbouring values of `Sampling.seed` share none.
_SEEDS_PER_FRAME = 64
FEATURE_SAMPLES = 16
"""Samples per pixel of the pictures of albedos and normals that guide a denoiser.

Few suffice, because only edges, lenses and textures make these pictures noisy."""


@dataclass(frozen=True, eq=False)
class RenderedFrame:
    """A frame: its two independent halves, whose mean is the picture, and its passes. Row 0 is the top.

    Colours are linear, premultiplied, and without exposure. Backends `principled` and `mitsuba-principled`, which only
    the bench uses, render a frame once: `a` and `b` are equal, and `relmse` is nan.
    """

    a: Floats32  # (H, W, 3)
    b: Floats32  # (H, W, 3)
    alpha: Floats32  # (H, W)
    samples: int  # per pixel, over both halves
    seconds: float  # the time that the worker took
    relmse: float  # the error of the mean of the halves, estimated from their difference
    raw: Floats32 | None = None  # (H, W, 3), if the frame is denoised: the mean of the halves before denoising
    raw_relmse: float | None = None  # the relMSE of `raw`
    raw_seconds: float | None = None  # `seconds` without denoising and the pictures that guide it
    passes: Mapping[str, Floats32] = field(default_factory=dict)  # (H, W, channels), by the names of arrays
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # the names of objects, by cryptomatte

    def with_passes(
        self, passes: Mapping[str, Floats32], names: Mapping[str, tuple[str, ...]], seconds: float
    ) -> RenderedFrame:
        """Return the frame with further passes and with the names in its mattes; `seconds` is added to its time."""
        raw_seconds = None if self.raw_seconds is None else self.raw_seconds + seconds
        passes = {**self.passes, **passes}
        return replace(self, passes=passes, names=names, seconds=self.seconds + seconds, raw_seconds=raw_seconds)


def half_of_seed(seed: int) -> int:
    """Return the half of a frame, 0 or 1, to which a renderer's seed belongs."""
    return seed % 2


ReportSamples = Callable[[int, int, float | None], None]
"""Called with the samples done, the samples planned, and the relMSE so far."""

RenderRegion = Callable[[int, Region], tuple[Floats32, Floats32] | tuple[Floats32, Floats32, Mapping[str, Floats32]]]
"""Renders a region with a seed. Returns mean colours (h, w, 3), coverage (h, w), and parts of the colours by name."""

Denoiser = Callable[[Floats32], Floats32]
"""Returns the denoised colours of a picture (H, W, 3)."""


CombineHalves = Callable[[Half, Half], tuple[Floats, Floats, Floats]]
"""Returns the colours (H, W, 3) of the first and the second half, and the alpha (H, W) of the frame."""


def combine_halves(first: Half, second: Half) -> tuple[Floats, Floats, Floats]:
    """Return the mean colours of each half, and the mean coverage of both as alpha: the default `CombineHalves`."""
    return first.color, second.color, 0.5 * (first.alpha + second.alpha)


def render_halves(
    task: FrameTask,
    render: RenderRegion,
    denoiser: Callable[[], Denoiser],
    progress: ReportSamples,
    combine: CombineHalves = combine_halves,
) -> RenderedFrame:
    """Render the halves of a frame with different seeds, so that their difference measures the error of their mean.

    render : renders a region with a seed. `half_of_seed` returns the half to which a seed belongs.
    denoiser : renders the albedos and normals of the frame, and returns a denoiser that they guide. It is called only
    if the task asks for denoising.
    progress : is called after each region.
    combine : returns the colours of the halves. The error of the frame is measured from these.
    """
    start = time.perf_counter()
    sampling, (width, height), gain = task.scene.sampling, task.scene.resolution, 2.0**task.exposure
    halves = Half(width, height, gain), Half(width, height, gain)
    a = b = alpha = np.zeros(0)
    error = raw_error = math.inf
    smooth = denoiser() if sampling.denoise != "off" else None
    denoising_seconds = time.perf_counter() - start
    result: Denoised | None = None
    done = rounds = 0
    while any(regions := next_round(sampling, halves, rounds, error)):
        for index, half in enumerate(halves):
            seed = sampling.seed * _SEEDS_PER_FRAME + 2 * rounds + index
            for region in regions[index]:
                half.add(region, *render(seed, region))
            done = round(2.0 * mean_samples(halves))
            progress(done, sampling.samples, error if rounds else None)
        rounds += 1
        a, b, alpha = combine(*halves)
        error = raw_error = relmse_of_halves(a * gain, b * gain, alpha)
        if smooth is not None:
            denoise_start = time.perf_counter()
            result = denoise_halves(a * gain, b * gain, alpha, smooth)
            error = result.relmse
            denoising_seconds += time.perf_counter() - denoise_start
        progress(done, sampling.samples, error)
    raw = None if result is None else (0.5 * (a + b)).astype(np.float32)
    if result is not None:
        a, b = result.a / gain, result.b / gain
    pixels = (a.astype(np.float32), b.astype(np.float32), alpha.astype(np.float32))
    passes: dict[str, Floats32] = {}
    if "samples" in sampling.passes:
        passes["samples"] = (halves[0].samples + halves[1].samples).astype(np.float32)[..., None]
    for name in dict.fromkeys((*halves[0].parts, *halves[1].parts)):
        passes[name] = _mean_part(name, halves)
    seconds = time.perf_counter() - start
    if result is None:
        return RenderedFrame(*pixels, done, seconds, error, passes=passes)
    return RenderedFrame(*pixels, done, seconds, error, raw, raw_error, seconds - denoising_seconds, passes)


def _mean_part(name: str, halves: Sequence[Half]) -> Floats32:
    """Return a part of the light of a frame, (H, W, 3), not denoised: the mean of both halves.

    If only one half has recorded the part, the result is its share of that half's light, times the light of the frame.
    This result has half the bias of a quotient of two means. The bias decreases with the number of samples.
    """
    recorded = [half for half in halves if name in half.parts]
    means = [half.parts[name] / half.samples[..., None] for half in recorded]
    if len(recorded) == len(halves):
        return np.asarray(0.5 * (means[0] + means[1]), np.float32)
    recorded_beauty, beauty = recorded[0].color, 0.5 * (halves[0].color + halves[1].color)
    return np.asarray(
        beauty * np.divide(means[0], recorded_beauty, out=np.zeros_like(recorded_beauty), where=recorded_beauty > 0.0),
        np.float32,
    )
