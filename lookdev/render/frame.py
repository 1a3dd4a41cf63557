"""A frame, of whichever renderer: two independent halves, in rounds until they reach the target, denoised if wanted."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lookdev.metrics import relmse_of_halves
from lookdev.render.adaptive import Half, Region, mean_samples, next_round
from lookdev.render.denoise import Denoised, denoised
from lookdev.render.task import FrameTask

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
    for name in halves[0].parts:
        mean = 0.5 * sum(half.parts[name] / half.samples[..., None] for half in halves)
        passes[name] = np.asarray(mean, np.float32)
    seconds = time.perf_counter() - started
    if result is None:
        return RenderedFrame(*shown, done, seconds, error, passes=passes)
    return RenderedFrame(*shown, done, seconds, error, raw, raw_error, seconds - denoising, passes)
