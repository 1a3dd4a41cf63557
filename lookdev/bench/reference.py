"""References, which are converged pictures of a backend: they measure the error of the benchmark's renders.

A reference is the mean of several independent renders, called its parts. In each pixel, the spread of the parts is an
unbiased estimate of the variance of their mean. The squared difference of a render from the reference contains this
variance, so it is subtracted. A reference with a few times the samples of the render is therefore sufficient. An error
is not reported if the noise of the reference makes it too uncertain.
"""

from __future__ import annotations

import hashlib
import math
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lookdev.arrays import Floats, Floats32
from lookdev.bench.subjects import POSE
from lookdev.cache import atomic_path, cache_dir
from lookdev.errors import LookdevError
from lookdev.metrics import EPSILON
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.task import FrameTask, SceneTask, frame_task
from lookdev.scene import Pose

# The first seed of references. Shaders take seeds below twice this number: references use the upper half, and the
# measured renders the lower half.
FIRST_SEED = 1 << 17
_VERSION = 1  # the version of the files of references: increase it with any change of their content
# A measured error that is below the reference's own error is reported only if it is at least this number of its
# standard errors.
_MIN_STANDARD_ERRORS = 4.0


@dataclass(frozen=True, eq=False)
class TimedPicture:
    """One render in a process that has rendered before, with its time and memory.

    If the picture is denoised, `raw` is the same render before denoising. Its `seconds` are without denoising.
    """

    image: Floats32  # (H, W, 3), premultiplied
    alpha: Floats32  # (H, W)
    seconds: float
    memory: int  # peak memory of the process, bytes
    renderer: str  # name and version
    samples: int  # per pixel
    estimate: float | None = None  # the relMSE that the renderer estimates of this picture
    raw: TimedPicture | None = None


RenderFrame = Callable[[FrameTask], WorkerFrame]
ReportProgress = Callable[[str], None]
"""Shows a line of progress."""

RenderPicture = Callable[..., TimedPicture]
"""Renders a scene; its arguments are the samples per pixel, a seed and, by keyword, other fields of a `Sampling`."""


def timed_picture(rendered: WorkerFrame) -> TimedPicture:
    """Return the picture of a frame, which is the mean of its halves, with its time, memory and estimated error."""

    def make_picture(
        image: Floats32, seconds: float, estimate: float | None, raw: TimedPicture | None = None
    ) -> TimedPicture:
        error = None if estimate is None or math.isnan(estimate) else estimate
        figures = rendered.memory, rendered.blender, rendered.samples
        return TimedPicture(image, rendered.alpha, seconds, *figures, error, raw)

    raw = None
    if rendered.raw is not None and rendered.raw_seconds is not None:
        raw = make_picture(rendered.raw, rendered.raw_seconds, rendered.raw_relmse)
    return make_picture((rendered.a + rendered.b) * np.float32(0.5), rendered.seconds, rendered.relmse, raw)


def picture_renderer(render: RenderFrame, scene: SceneTask, pose: Pose = POSE) -> RenderPicture:
    """Return a function that renders a scene; it denoises only if its arguments request that."""

    def render_picture(samples: int, seed: int, **sampling: Any) -> TimedPicture:
        fields = {"samples": samples, "seed": seed, "error": None, "denoise": "off", **sampling}
        return timed_picture(render(frame_task(scene, pose, f"{samples}.{seed}", **fields)))

    return render_picture


@dataclass(frozen=True)
class MeasuredError:
    """The error of a render, or of several, against a reference."""

    relmse: float | None  # without the reference's own error; None if the reference's noise makes it too uncertain
    bias: float  # mean of (render - reference) over the asset, divided by the mean of the reference
    bias_error: float  # the standard error of `bias`


class Reference:
    """The mean of independent renders. These renders are its parts, and all have the same number of samples.

    Attributes
    ----------
    part_samples
        The samples per pixel of one part.
    parts
        The number of parts so far.
    mean : (H, W, 3)
        The mean of the parts, premultiplied.
    alpha : (H, W)
        The mean coverage.
    """

    def __init__(self, samples: int) -> None:
        self.part_samples = samples
        self.parts = 0
        self.mean: Floats = np.zeros(())
        self.alpha: Floats = np.zeros(())
        self._squares: Floats = np.zeros(())  # sums of squared deviations from the mean, (H, W, 3)

    def add(self, part: TimedPicture) -> None:
        """Add a part to the mean and the sum of squared deviations, without cancellation (Welford 1962)."""
        image = part.image.astype(np.float64)
        self.parts += 1
        delta = image - self.mean
        self.mean = self.mean + delta / self.parts
        self._squares = self._squares + delta * (image - self.mean)
        self.alpha = self.alpha + (part.alpha - self.alpha) / self.parts

    @property
    def samples(self) -> int:
        """The samples per pixel of all parts together."""
        return self.parts * self.part_samples

    @property
    def own_relmse(self) -> float:
        """The estimated relMSE of the reference itself."""
        return self._relative(self._variance())

    def relmse(self, image: Floats) -> float:
        """Return the relMSE of a picture (H, W, 3) minus `own_relmse`; noise can make the result negative."""
        return self._relative((image - self.mean) ** 2) - self.own_relmse

    def measure_error(self, *pictures: TimedPicture) -> MeasuredError:
        """Return the mean relMSE of renders with the same number of samples, and the bias of their mean.

        The standard error of the bias follows from the spread of the difference over pixels. That spread contains the
        noise of the renders and of the reference.
        """
        images = [picture.image.astype(np.float64) for picture in pictures]
        relmse = float(np.mean([self.relmse(image) for image in images]))
        squares = np.mean([(image - self.mean) ** 2 for image in images], axis=0)
        certain = relmse >= min(self.own_relmse, _MIN_STANDARD_ERRORS * self._uncertainty(squares))
        covered = self.alpha > 0.0
        difference = (np.mean(images, axis=0) - self.mean)[covered].mean(axis=-1)
        brightness = float(self.mean[covered].mean())
        spread = float(difference.std(ddof=1)) / np.sqrt(len(difference))
        return MeasuredError(
            relmse if certain else None, float(difference.mean()) / brightness, float(spread / brightness)
        )

    def _variance(self) -> Floats:
        """Return the estimated variance of `mean` in each pixel and channel, (H, W, 3)."""
        return np.asarray(self._squares / (self.parts * (self.parts - 1)))

    def _uncertainty(self, squares: Floats) -> float:
        """Return the standard error of a relMSE that the noise of the reference causes.

        `squares` has the squared differences of a render from the reference, (H, W, 3). Pixels are independent,
        channels are not. Let x be the render, r this reference, and m the picture without noise. If the noise is
        normal, the variance of ``(x - r)^2 - var(r)`` over r is ``4 (x - m)^2 var(r) + 2 var(r)^2``. Since var(r) is
        itself estimated from the parts, ``2 var(r)^2 / (parts - 1)`` is added.
        """
        variance = self._variance()
        excess = np.maximum(squares - variance, 0.0)
        spread = 4.0 * excess * variance + 2.0 * variance**2 * self.parts / (self.parts - 1)
        of_pixels = (np.sqrt(spread) / (self.mean**2 + EPSILON)).mean(axis=-1)[self.alpha > 0.0]
        return float(np.sqrt((of_pixels**2).sum()) / len(of_pixels))

    def _relative(self, squares: Floats) -> float:
        """Return the mean over the asset of squared errors (H, W, 3), each divided as in `lookdev.metrics.relmse`."""
        covered = self.alpha > 0.0
        return float((squares / (self.mean**2 + EPSILON))[covered].mean())

    def needs_part(self, samples: int, enough: float) -> bool:
        """Return whether the reference needs another part.

        Its parts suffice if they have `samples` samples in all, or if its own relMSE is at most `enough`. A reference
        has at least four parts. The relMSE counts from eight parts on: the spread of fewer parts is too uncertain.
        """
        if self.parts < 4:
            return True
        return self.samples < samples and (self.parts < 8 or self.own_relmse > enough)

    def save(self, file: Path) -> None:
        """Write the reference, whole or not at all."""
        numbers = np.array([_VERSION, self.part_samples, self.parts])
        with atomic_path(file) as path:
            np.savez(path, numbers=numbers, mean=self.mean, alpha=self.alpha, squares=self._squares)

    @classmethod
    def load(cls, file: Path) -> Reference | None:
        """Read a saved reference; return None if it cannot be read or has another version."""
        try:
            with file.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
                version, samples, parts = stored["numbers"].tolist()
                if version != _VERSION:
                    return None
                reference = cls(samples)
                reference.parts = parts
                reference.mean, reference.alpha = stored["mean"], stored["alpha"]
                reference._squares = stored["squares"]
        except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile):
            return None
        return reference


def obtain_reference(
    key: str,
    samples: int,
    parts: int,
    render: RenderPicture,
    report: ReportProgress,
    *,
    enough: float = 0.0,
    fresh: bool = False,
) -> Reference:
    """Return the reference of a picture from the cache, and render the parts that it lacks.

    `key` is the picture's `picture_key`. A complete reference has `parts` parts of `samples` samples each. A reference
    also counts as complete if it has four or more parts with at least as many samples in all, or if it has eight or
    more parts and its own relMSE is at most `enough`. With `fresh`, the cache is ignored. Raises LookdevError if the
    picture is black or covers no pixel.
    """
    file = cache_dir("bench") / f"{hashlib.sha256(key.encode()).hexdigest()}.npz"
    reference = None if fresh else Reference.load(file)
    if reference is None or (reference.needs_part(samples * parts, enough) and reference.part_samples < samples):
        reference = Reference(samples)
    while reference.needs_part(samples * parts, enough):
        report(f"reference: part {reference.parts + 1} of {parts}, {reference.part_samples} samples a pixel")
        reference.add(render(reference.part_samples, FIRST_SEED + reference.parts))
        # Saved after every part, so that a run that Ctrl-C ends can be continued.
        reference.save(file)
    if not (reference.alpha > 0.0).any() or not reference.mean.any():
        raise LookdevError(f"the reference {file} is black or empty: nothing can be measured on it")
    return reference
