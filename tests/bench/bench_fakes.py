"""Renderers without a renderer: a known picture, with noise of a known variance and a known cost."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from lookdev.bench.matrix import Cell, Options
from lookdev.bench.measure import Candidate
from lookdev.bench.reference import Shot
from lookdev.metrics import EPSILON

SIDE = 64


def quiet(text: str) -> None:
    """Report nothing."""


def truth() -> tuple[np.ndarray, np.ndarray]:
    """Return a picture (SIDE, SIDE, 3) and its coverage: a third of it shows nothing."""
    rng = np.random.default_rng(1)
    image = rng.uniform(0.05, 2.0, (SIDE, SIDE, 3))
    alpha = np.ones((SIDE, SIDE))
    image[: SIDE // 3], alpha[: SIDE // 3] = 0.0, 0.0
    return image, alpha


@dataclass
class FakeRenderer:
    """Renders `truth` times `gain`, with noise of variance ``scale^2 / samples``; records its calls."""

    name: str = "exact"
    scale: float = 0.1
    gain: float = 1.0
    fixed: float = 0.01
    rate: float = 0.001
    calls: list[tuple[str, int, int]] = field(default_factory=list)
    ends_after: int | None = None

    def __call__(self, samples: int, seed: int) -> Shot:
        if self.ends_after is not None and len(self.calls) >= self.ends_after:
            raise KeyboardInterrupt
        self.calls.append((self.name, samples, seed))
        image, alpha = truth()
        rng = np.random.default_rng([samples, seed, *self.name.encode()])
        noisy = self.gain * image + rng.normal(size=image.shape) * self.scale / np.sqrt(samples) * alpha[..., None]
        seconds = self.fixed + self.rate * samples
        return Shot(noisy.astype(np.float32), alpha.astype(np.float32), seconds, 1_000_000, f"fake {self.name}")

    def relmse(self, samples: int) -> float:
        """Return the relMSE that a render of so many samples has on average."""
        image, alpha = truth()
        covered = alpha > 0.0
        variance = self.scale**2 / samples
        squares = variance + ((self.gain - 1.0) * image[covered]) ** 2
        return float((squares / (image[covered] ** 2 + EPSILON)).mean())


class FakeBackends:
    """Gives ``exact`` and ``principled`` for each cell; the second has twice the noise and half the cost a sample.

    The first has skips, more of them under the city.
    """

    def __init__(self, ends_after: int | None = None) -> None:
        self.calls: list[tuple[str, int, int]] = []
        self.closed = 0
        self._renderers = {
            "exact": FakeRenderer("exact", 0.1, calls=self.calls, ends_after=ends_after),
            "principled": FakeRenderer("principled", 0.2, rate=0.0005, calls=self.calls, ends_after=ends_after),
        }

    @contextmanager
    def __call__(self, cell: Cell, options: Options) -> Iterator[list[Candidate]]:
        try:
            skips = ("bounces (convex asset)", *(["light samples (for show)"] if cell.ibl == "city" else []))
            yield [
                Candidate(name, f"{cell} {name}", self._renderers[name], skips if name == "exact" else ())
                for name in options.backends_of(cell)
            ]
        finally:
            self.closed += 1


def measured(calls: list[tuple[str, int, int]], first_seed: int) -> list[tuple[str, int, int]]:
    """Return the calls without references and warm-ups."""
    return [each for each in calls if each[2] < first_seed]
