"""The converged picture of a backend, with its own error, and the error of renders against it.

A reference is the mean of independent parts, whose spread is an unbiased estimate of its own variance, pixel by pixel.
The squared difference of a render from it contains that variance, which is subtracted. So a reference of a few times
the samples is sufficient. Errors that are too uncertain because of its noise are not reported.
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

FIRST_SEED = 1 << 17  # references use the upper half of the seeds that a shader takes; `measure` uses the lower half
_VERSION = 1
_MIN_STANDARD_ERRORS = 4.0  # an error below the reference's own is reported if it has this many standard errors


@dataclass(frozen=True, eq=False)
class TimedPicture:
    """One render in a warm process; if it is denoised, `raw` is the render before denoising, in less time."""

    image: Floats32  # (H, W, 3), premultiplied
    alpha: Floats32  # (H, W)
    seconds: float
    memory: int  # peak of the process, bytes
    renderer: str
    samples: int  # per pixel
    estimate: float | None = None  # of its own relMSE
    raw: TimedPicture | None = None


RenderFrame = Callable[[FrameTask], WorkerFrame]
ReportProgress = Callable[[str], None]
RenderPicture = Callable[..., TimedPicture]
"""Renders with samples per pixel and a seed; keywords are other fields of a `Sampling`."""


def timed_picture(rendered: WorkerFrame) -> TimedPicture:
    """Return the mean of a frame's halves, with its figures."""

    def shot(image: Floats32, seconds: float, estimate: float | None, raw: TimedPicture | None = None) -> TimedPicture:
        error = None if estimate is None or math.isnan(estimate) else estimate
        figures = rendered.memory, rendered.blender, rendered.samples
        return TimedPicture(image, rendered.alpha, seconds, *figures, error, raw)

    raw = None
    if rendered.raw is not None and rendered.raw_seconds is not None:
        raw = shot(rendered.raw, rendered.raw_seconds, rendered.raw_relmse)
    return shot((rendered.a + rendered.b) * np.float32(0.5), rendered.seconds, rendered.relmse, raw)


def picture_renderer(render: RenderFrame, scene: SceneTask, pose: Pose = POSE) -> RenderPicture:
    """Return a function that renders a scene, without denoising unless its arguments request it."""

    def shoot(samples: int, seed: int, **sampling: Any) -> TimedPicture:
        fields = {"samples": samples, "seed": seed, "error": None, "denoise": "off", **sampling}
        return timed_picture(render(frame_task(scene, pose, f"{samples}.{seed}", **fields)))

    return shoot


@dataclass(frozen=True)
class MeasuredError:
    """The error of a render against a reference."""

    relmse: float | None  # without the reference's own error; None where that leaves it too uncertain
    bias: float  # relative difference of the mean over the asset
    bias_error: float  # its standard error


class Reference:
    """The mean of independent renders ("parts") of equally many samples."""

    def __init__(self, samples: int) -> None:
        self.part_samples = samples
        self.parts = 0
        self.mean: Floats = np.zeros(())
        self.alpha: Floats = np.zeros(())
        self._squares: Floats = np.zeros(())

    def add(self, shot: TimedPicture) -> None:
        """Add a part (Welford 1962, without cancellation)."""
        image = shot.image.astype(np.float64)
        self.parts += 1
        delta = image - self.mean
        self.mean = self.mean + delta / self.parts
        self._squares = self._squares + delta * (image - self.mean)
        self.alpha = self.alpha + (shot.alpha - self.alpha) / self.parts

    @property
    def samples(self) -> int:
        """Samples of all parts."""
        return self.parts * self.part_samples

    @property
    def own_relmse(self) -> float:
        """Its own error as relMSE."""
        return self._relative(self._variance())

    def relmse(self, image: Floats) -> float:
        """Return the relMSE of a picture (H, W, 3) minus the reference's own; it may be below 0."""
        return self._relative((image - self.mean) ** 2) - self.own_relmse

    def measure_error(self, *shots: TimedPicture) -> MeasuredError:
        """Return the mean relMSE of renders of equally many samples, and the bias of their mean.

        The standard error of the bias is from the spread of the difference over pixels, which contains the noise of
        the renders and of the reference.
        """
        images = [shot.image.astype(np.float64) for shot in shots]
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
        """Return the variance of the mean (H, W, 3)."""
        return np.asarray(self._squares / (self.parts * (self.parts - 1)))

    def _uncertainty(self, squares: Floats) -> float:
        """Return the standard error of a relMSE that the noise of the reference causes.

        Pixels are independent, channels are not. With m without noise, x a render and r this reference, the variance of
        ``(x - r)^2 - var(r)`` over r, for normal noise, is ``4 (x - m)^2 var(r) + 2 var(r)^2``, and the estimated
        variance adds as much as the last term over the parts but one.
        """
        variance = self._variance()
        excess = np.maximum(squares - variance, 0.0)
        spread = 4.0 * excess * variance + 2.0 * variance**2 * self.parts / (self.parts - 1)
        of_pixels = (np.sqrt(spread) / (self.mean**2 + EPSILON)).mean(axis=-1)[self.alpha > 0.0]
        return float(np.sqrt((of_pixels**2).sum()) / len(of_pixels))

    def _relative(self, squares: Floats) -> float:
        """Return the mean over the asset of squared errors, relative as `lookdev.metrics.relmse` has it."""
        covered = self.alpha > 0.0
        return float((squares / (self.mean**2 + EPSILON))[covered].mean())

    def needs_part(self, samples: int, enough: float) -> bool:
        """Return whether it needs another part; the spread of fewer than eight parts is too uncertain to end early."""
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
        """Read a saved reference; None where it cannot be read."""
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
    """Return the reference of a picture from the cache, with a key of `picture_key`, and render what it lacks.

    The reference has `parts` of `samples` each; or at least as many samples in four or more parts; or eight or more
    parts, and an own relMSE of at most `enough`. With `fresh` the cache is ignored. Raises LookdevError where the
    picture is black or covers no pixel.
    """
    file = cache_dir("bench") / f"{hashlib.sha256(key.encode()).hexdigest()}.npz"
    reference = None if fresh else Reference.load(file)
    if reference is None or (reference.needs_part(samples * parts, enough) and reference.part_samples < samples):
        reference = Reference(samples)
    while reference.needs_part(samples * parts, enough):
        report(f"reference: part {reference.parts + 1} of {parts}, {reference.part_samples} samples a pixel")
        reference.add(render(reference.part_samples, FIRST_SEED + reference.parts))
        # After every part, so that a run after Ctrl-C continues.
        reference.save(file)
    if not (reference.alpha > 0.0).any() or not reference.mean.any():
        raise LookdevError(f"the reference {file} is black or empty: nothing can be measured on it")
    return reference
