"""A frame, of whichever renderer: two independent halves, in rounds until they reach the target, denoised if wanted."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lookdev.metrics import relmse_of_halves
from lookdev.rendering.adaptive import Half, Region, mean_samples, next_round
from lookdev.rendering.denoise import Denoised, denoised
from lookdev.rendering.task import FrameTask

Floats = NDArray[np.float64]
Image = NDArray[np.float32]

# Seeds of one frame's rounds and halves: those of neighbouring `seed` values never coincide.
_SEEDS_PER_FRAME = 64
FEATURE_SAMPLES = 16
"""Samples of the pictures that guide a denoiser: they have no noise but that of edges, lenses and textures."""


@dataclass(frozen=True)
class RenderedFrame:
    """Half renders (H, W, 3), coverage (H, W), rows top-down, exposure not applied; samples over both halves.

    A frame as a user of Cycles would have it is one render: `a` and `b` are equal, and `relmse` is nan. `raw` is the
    mean of the halves before they were denoised, `raw_relmse` its error, `raw_seconds` what it took. `passes` are
    (H, W, channels) by the names of their arrays, `names` those that are in each matte.
    """

    a: Image
    b: Image
    alpha: Image
    samples: int
    seconds: float
    relmse: float
    raw: Image | None = None
    raw_relmse: float | None = None
    raw_seconds: float | None = None
    passes: Mapping[str, Image] = field(default_factory=dict)
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def half_of(seed: int) -> int:
    """Return which half of a frame a renderer's seed belongs to, 0 or 1."""
    return seed % 2


Progress = Callable[[int, int, float | None], None]
"""Called with the samples done, the samples planned, and the relMSE so far."""

Renderer = Callable[[int, Region], tuple[Image, Image] | tuple[Image, Image, Mapping[str, Image]]]
"""Renders a region with a seed: returns the mean colours (h, w, 3), coverage (h, w), and parts of colours by name."""

Denoiser = Callable[[Image], Image]


Pictures = Callable[[Half, Half], tuple[Floats, Floats, Floats]]
"""Returns the colours of both halves, and the alpha of the frame."""


def plain_pictures(first: Half, second: Half) -> tuple[Floats, Floats, Floats]:
    """Return the colours of both halves and their mean coverage."""
    return first.color, second.color, 0.5 * (first.alpha + second.alpha)


def render_halves(
    task: FrameTask,
    render: Renderer,
    denoiser: Callable[[], Denoiser],
    progress: Progress,
    pictures: Pictures = plain_pictures,
) -> RenderedFrame:
    """Render the halves of a frame, by seeds of their own, so that their difference measures the error of their mean.

    `denoiser` makes one that is guided by the features of the frame, if the task wants it. `pictures` are what the
    halves show, by which the frame is measured.
    """
    started = time.perf_counter()
    sampling, (width, height), gain = task.scene.sampling, task.scene.resolution, 2.0**task.exposure
    halves = Half(width, height, gain), Half(width, height, gain)
    a = b = alpha = np.zeros(0)
    error = raw_error = math.inf
    smooth = denoiser() if sampling.denoise != "off" else None
    denoising = time.perf_counter() - started
    result: Denoised | None = None
    done = number = 0
    while any(regions := next_round(sampling, halves, number, error)):
        for which, half in enumerate(halves):
            seed = sampling.seed * _SEEDS_PER_FRAME + 2 * number + which
            for region in regions[which]:
                half.add(region, *render(seed, region))
            done = round(2.0 * mean_samples(halves))
            progress(done, sampling.samples, error if number else None)
        number += 1
        a, b, alpha = pictures(*halves)
        error = raw_error = relmse_of_halves(a * gain, b * gain, alpha)
        if smooth is not None:
            before = time.perf_counter()
            result = denoised(a * gain, b * gain, alpha, smooth)
            error = result.relmse
            denoising += time.perf_counter() - before
        progress(done, sampling.samples, error)
    raw = None if result is None else (0.5 * (a + b)).astype(np.float32)
    if result is not None:
        a, b = result.a / gain, result.b / gain
    shown = (a.astype(np.float32), b.astype(np.float32), alpha.astype(np.float32))
    passes: dict[str, Image] = {}
    if "samples" in sampling.passes:
        passes["samples"] = (halves[0].samples + halves[1].samples).astype(np.float32)[..., None]
    for name in dict.fromkeys((*halves[0].parts, *halves[1].parts)):
        passes[name] = _part(name, halves)
    seconds = time.perf_counter() - started
    if result is None:
        return RenderedFrame(*shown, done, seconds, error, passes=passes)
    return RenderedFrame(*shown, done, seconds, error, raw, raw_error, seconds - denoising, passes)


def _part(name: str, halves: Sequence[Half]) -> Image:
    """Return a part of the light (H, W, 3) of the mean of both halves, raw.

    Of a part that one half has recorded, the share in that half's light is the share in the frame's. It is biased by
    half of what a quotient of means is, which falls with the samples.
    """
    having = [half for half in halves if name in half.parts]
    means = [half.parts[name] / half.samples[..., None] for half in having]
    if len(having) == len(halves):
        return np.asarray(0.5 * (means[0] + means[1]), np.float32)
    own, beauty = having[0].color, 0.5 * (halves[0].color + halves[1].color)
    return np.asarray(beauty * np.divide(means[0], own, out=np.zeros_like(own), where=own > 0.0), np.float32)
