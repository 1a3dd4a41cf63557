"""Renderers without a renderer: a known picture, with noise of a known variance and a known cost."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from lookdev.asset import Asset
from lookdev.bench.matrix import MatrixBenchmark
from lookdev.bench.measure import Candidate
from lookdev.bench.options import BenchOptions, Cell
from lookdev.bench.reference import TimedPicture
from lookdev.errors import RenderError
from lookdev.metrics import EPSILON
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.task import FrameTask

SIDE = 64


def store_references(folder: Path, patch: pytest.MonkeyPatch) -> None:
    """Let references be stored in a folder; lights and looks are those of the run's cache."""

    def cache_dir(*parts: str) -> Path:
        target = folder.joinpath("cache", *parts)
        target.mkdir(parents=True, exist_ok=True)
        return target

    patch.setattr("lookdev.bench.reference.cache_dir", cache_dir)


def quiet(text: str) -> None:
    """Report nothing."""


def triangle_count(asset: Asset) -> int:
    """Return the number of triangles of an asset, over all instances."""
    return sum(int((asset.meshes[instance.mesh].face_sizes - 2).sum()) for instance in asset.instances)


def truth() -> tuple[np.ndarray, np.ndarray]:
    """Return a picture (SIDE, SIDE, 3) and its coverage: a third of it shows nothing."""
    rng = np.random.default_rng(1)
    image = rng.uniform(0.05, 2.0, (SIDE, SIDE, 3))
    alpha = np.ones((SIDE, SIDE))
    image[: SIDE // 3], alpha[: SIDE // 3] = 0.0, 0.0
    return image, alpha


@dataclass
class FakeRenderer:
    """Renders `truth` times `gain`, with noise of variance ``scale^2 / samples``; records its calls.

    A denoised picture has a quarter of the variance, and takes a tenth of a second more. With a target error, samples
    double until it is reached. `fails_after` so many calls it cannot render.
    """

    name: str = "exact"
    scale: float = 0.1
    gain: float = 1.0
    fixed: float = 0.01
    rate: float = 0.001
    calls: list[tuple[str, int, int]] = field(default_factory=list)
    ends_after: int | None = None
    fails_after: int | None = None

    def __call__(self, samples: int, seed: int, *, denoise: str = "off", error: float | None = None) -> TimedPicture:
        if self.ends_after is not None and len(self.calls) >= self.ends_after:
            raise KeyboardInterrupt
        if self.fails_after is not None and len(self.calls) >= self.fails_after:
            raise RenderError(f"{self.name} has no more ink")
        self.calls.append((self.name, samples, seed))
        image, alpha = truth()
        gain = 0.5 if denoise == "measured" else 1.0
        if error is not None:
            samples = next((n for n in (1 << k for k in range(20)) if gain**2 * self.relmse(n) <= error), samples)
        noise = np.random.default_rng([samples, seed, *self.name.encode()]).normal(size=image.shape) * alpha[..., None]
        noise *= self.scale / np.sqrt(samples)
        seconds = self.fixed + self.rate * samples

        def shot(gain: float, seconds: float, raw: TimedPicture | None = None) -> TimedPicture:
            picture = (self.gain * image + gain * noise).astype(np.float32)
            figures = 1_000_000, f"fake {self.name}", samples, gain**2 * self.relmse(samples)
            return TimedPicture(picture, alpha.astype(np.float32), seconds, *figures, raw)

        return shot(1.0, seconds) if gain == 1.0 else shot(gain, seconds + 0.1, shot(1.0, seconds))

    def relmse(self, samples: int) -> float:
        """Return the relMSE that a render of so many samples has on average."""
        image, alpha = truth()
        covered = alpha > 0.0
        variance = self.scale**2 / samples
        squares = variance + ((self.gain - 1.0) * image[covered]) ** 2
        return float((squares / (image[covered] ** 2 + EPSILON)).mean())


class FakeBackends:
    """Gives ``exact`` and ``principled`` for each cell; the second has twice the noise and half the cost a sample.

    The first has skips, more of them under the city. ``mitsuba`` is as the first at half the cost a sample, and
    ``mitsuba-principled`` has the noise of the second.
    """

    def __init__(self, ends_after: int | None = None, **fails_after: int) -> None:
        self.calls: list[tuple[str, int, int]] = []
        self.closed = 0
        noise_and_cost = {"exact": (0.1, 0.001), "principled": (0.2, 0.0005)}
        noise_and_cost |= {"mitsuba": (0.1, 0.0005), "mitsuba-principled": (0.2, 0.001)}
        self._renderers = {
            name: FakeRenderer(
                name, scale, rate=rate, calls=self.calls, ends_after=ends_after, fails_after=fails_after.get(name)
            )
            for name, (scale, rate) in noise_and_cost.items()
        }

    @contextmanager
    def __call__(self, cell: Cell, options: BenchOptions) -> Iterator[list[Candidate]]:
        try:
            skips = ("bounces (convex asset)", *(["light samples (for show)"] if cell.ibl == "city" else []))
            yield [
                Candidate(name, f"{cell} {name}", self._renderers[name], skips if name == "exact" else (), True)
                for name in options.backends_of(cell)
            ]
        finally:
            self.closed += 1


def run_matrix(options: BenchOptions, folder: Path, backends: object = None) -> MatrixBenchmark:
    """Measure a matrix by fakes."""
    benchmark = MatrixBenchmark(options=options, report=quiet, open_candidates=backends or FakeBackends())
    benchmark.run(folder)
    return benchmark


@dataclass
class FakeProcesses:
    """Opens renderers of black frames that take `seconds` of a task; memory grows by a byte a frame of one process.

    After `ends_after` frames comes Ctrl-C; a look named `fails` cannot be rendered.
    """

    seconds: Callable[[FrameTask], float]
    ends_after: int | None = None
    fails: str = ""
    open: int = 0
    tasks: list[FrameTask] = field(default_factory=list)

    @contextmanager
    def __call__(self) -> Iterator[Callable[[FrameTask], WorkerFrame]]:
        self.open += 1
        done = 0

        def render(task: FrameTask) -> WorkerFrame:
            nonlocal done
            done += 1
            if len(self.tasks) == self.ends_after:
                raise KeyboardInterrupt
            self.tasks.append(task)
            if self.fails in [shader.name for shader in task.scene.shaders]:
                raise RenderError("no ink")
            width, height = task.scene.resolution
            black = np.zeros((height, width, 3), np.float32)
            samples = task.scene.sampling.samples
            seconds = self.seconds(task)
            return WorkerFrame(black, black, black[..., 0], samples, seconds, 0.0, blender="fake", memory=100 + done)

        yield render
        self.open -= 1


def measured(calls: list[tuple[str, int, int]], first_seed: int) -> list[tuple[str, int, int]]:
    """Return the calls without references and warm-ups."""
    return [call for call in calls if call[2] < first_seed]
