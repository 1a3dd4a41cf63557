"""A frame of any renderer: two independent halves in rounds until the target error is reached, denoised on request."""

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

# The number of seeds for a frame's rounds and halves: so frames of neighbouring `seed` values never share one.
_SEEDS_PER_FRAME = 64
FEATURE_SAMPLES = 16
"""Samples of the pictures that guide a denoiser: only edges, lenses and textures make these noisy."""


@dataclass(frozen=True, eq=False)
class RenderedFrame:
    """Independent halves (H, W, 3) and their coverage, rows top-down, premultiplied, without exposure.

    A frame of the bench's Principled backends is a single render: `a` and `b` are equal, and `relmse` is nan.
    """

    a: Floats32
    b: Floats32
    alpha: Floats32  # (H, W)
    samples: int  # per pixel, over both halves
    seconds: float  # of the worker's time
    relmse: float  # estimated from the halves
    raw: Floats32 | None = None  # of a denoised frame: the mean of the halves before denoising
    raw_relmse: float | None = None
    raw_seconds: float | None = None  # without the denoiser's features and denoising
    passes: Mapping[str, Floats32] = field(default_factory=dict)  # (H, W, channels), by the names of arrays
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # the names in each matte

    def with_passes(
        self, passes: Mapping[str, Floats32], names: Mapping[str, tuple[str, ...]], seconds: float
    ) -> RenderedFrame:
        """Return the frame with further passes and the names in its mattes, after further seconds."""
        raw_seconds = None if self.raw_seconds is None else self.raw_seconds + seconds
        passes = {**self.passes, **passes}
        return replace(self, passes=passes, names=names, seconds=self.seconds + seconds, raw_seconds=raw_seconds)


def half_of_seed(seed: int) -> int:
    """Return the half of a frame, 0 or 1, to which a renderer's seed belongs."""
    return seed % 2


ReportSamples = Callable[[int, int, float | None], None]
"""Called with the samples done, the samples planned, and the relMSE so far."""

RenderRegion = Callable[[int, Region], tuple[Floats32, Floats32] | tuple[Floats32, Floats32, Mapping[str, Floats32]]]
"""Renders a region with a seed: returns mean colours (h, w, 3), coverage (h, w), and parts of the colours by name."""

Denoiser = Callable[[Floats32], Floats32]


CombineHalves = Callable[[Half, Half], tuple[Floats, Floats, Floats]]
"""Returns the colours of both halves, and the alpha of the frame."""


def combine_halves(first: Half, second: Half) -> tuple[Floats, Floats, Floats]:
    """Return the colours of both halves and their mean coverage."""
    return first.color, second.color, 0.5 * (first.alpha + second.alpha)


def render_halves(
    task: FrameTask,
    render: RenderRegion,
    denoiser: Callable[[], Denoiser],
    progress: ReportSamples,
    combine: CombineHalves = combine_halves,
) -> RenderedFrame:
    """Render the halves of a frame with different seeds, so that their difference measures the error of their mean.

    `denoiser` returns a denoiser with the features of the frame; it is called if the task is denoised. `combine`
    returns the colours of the halves, from which the error of the frame is measured.
    """
    start = time.perf_counter()
    sampling, (width, height), gain = task.scene.sampling, task.scene.resolution, 2.0**task.exposure
    halves = Half(width, height, gain), Half(width, height, gain)
    a = b = alpha = np.zeros(0)
    error = raw_error = math.inf
    smooth = denoiser() if sampling.denoise != "off" else None
    denoising_seconds = time.perf_counter() - start
    result: Denoised | None = None
    done = number = 0
    while any(regions := next_round(sampling, halves, number, error)):
        for index, half in enumerate(halves):
            seed = sampling.seed * _SEEDS_PER_FRAME + 2 * number + index
            for region in regions[index]:
                half.add(region, *render(seed, region))
            done = round(2.0 * mean_samples(halves))
            progress(done, sampling.samples, error if number else None)
        number += 1
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
    """Return a part of the light (H, W, 3), the mean of both halves, not denoised.

    If only one half has recorded the part, this is the part's share of that half's light, times the light of the frame.
    Its bias is half that of a quotient of means, and falls with the samples.
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
