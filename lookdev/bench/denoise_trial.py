"""Compares random denoised frames with converged pictures: is the error as estimated, is none worse than its raw frame?

A cell is an asset, a look, a light and a pose, drawn at random. Each cell has one reference, and a frame with each of
`SAMPLES`. True errors are relMSE against the reference, minus the reference's own.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from lookdev.bench.benchmark import Benchmark, TextTable, write_csv
from lookdev.bench.options import Cell
from lookdev.bench.reference import FIRST_SEED, Reference, obtain_reference, picture_renderer
from lookdev.bench.subjects import IBLS, LOOKS, bench_asset, bench_lights, bench_scene, picture_key
from lookdev.checks.images import flip
from lookdev.material import Look
from lookdev.material.usd import read_look
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.task import SceneTask, frame_task
from lookdev.scene import Pose
from lookdev.shipped import shipped_folder

SAMPLES = (8, 16, 32, 64, 256)
USUAL_RATIO, MIN_RATIO = 1.3, 0.6
"""Most frames shall have a ratio of estimate and truth, either way, of at most the first; all, at least the second."""

_ASSETS = ("sphere", "shaderball", "suzanne")
_LIGHTS = (*IBLS, "studio+3", "lamp")
_FOLDERS = ("", "classic")
_PARTS = 4
_ROUNDING_FACTOR = 1.001  # the raw picture is rounded once more than the mean of the halves


@dataclass(frozen=True)
class Trial:
    """One frame: true and estimated errors, raw and denoised, and the mean FLIP of both."""

    asset: str
    look: str
    light: str
    element: float  # degrees
    lighting: float
    samples: int
    raw: float  # true relMSE
    raw_estimate: float
    denoised: float
    estimate: float
    raw_flip: float
    flip: float
    reference: float  # the reference's own relMSE
    seconds: float  # in the worker

    @property
    def ratio(self) -> float:
        """Return the estimate over the true error."""
        return self.estimate / self.denoised

    @property
    def raw_ratio(self) -> float:
        """Return the raw frame's own estimate over its true error."""
        return self.raw_estimate / self.raw


def trial_looks() -> dict[str, Callable[[], Look]]:
    """Return the looks of a trial by name: those of the benchmark, and the shipped ones with textures and flakes."""
    files = [file for folder in _FOLDERS for file in sorted((shipped_folder() / "materials" / folder).glob("*.usda"))]
    return {name: look.make for name, look in LOOKS.items()} | {file.stem: partial(read_look, file) for file in files}


def draw_cell(seed: int, number: int) -> tuple[Cell, Pose]:
    """Return a cell and a pose of a trial, which depend on the seed and the number alone."""
    rng = np.random.default_rng((seed, number))
    asset, look, light = (str(rng.choice(names)) for names in (_ASSETS, list(trial_looks()), _LIGHTS))
    return Cell(asset, light, look), Pose(*rng.uniform(0.0, 360.0, 2).round(1).tolist())


def cell_scene(cell: Cell, pose: Pose, resolution: int) -> tuple[SceneTask, str]:
    """Return the scene of a cell, and the key of its picture."""
    look, lights = trial_looks()[cell.look](), bench_lights(cell.ibl, bench_asset(cell.scene))
    # References have the same shaders, which can show the features of a denoiser.
    scene = bench_scene(cell.scene, look, lights, resolution, denoise=True)
    return scene, picture_key(scene, look, cell.ibl, pose)


@dataclass(kw_only=True)
class DenoiseTrial(Benchmark):
    """Random denoised frames: is their error as estimated?

    Options: `frames`; `seed` of the random cells (constants are tuned with one seed, and reported with another);
    `resolution`; `reference`, the samples of each reference in multiples of the largest of `SAMPLES`; `fresh`.
    """

    NAME = "denoise-trial"
    FILE = "denoise.csv"
    ROWS = "trials"
    DEFAULTS = {"resolution": 96, "frames": 200}  # noqa: RUF012

    trials: list[Trial] = field(default_factory=list)

    def measure(self) -> Iterator[None]:
        options = self.options
        with self.open_process() as render:
            for number in range(-(-options.frames // len(SAMPLES))):
                cell, pose = draw_cell(options.seed, number)
                scene, key = cell_scene(cell, pose, options.resolution)
                part, shoot = SAMPLES[-1] * options.reference // _PARTS, picture_renderer(render, scene, pose)
                truth = obtain_reference(key, part, _PARTS, shoot, self.report, fresh=options.fresh)
                first = len(SAMPLES) * number
                for seed, samples in enumerate(SAMPLES[: options.frames - first], start=first):
                    name = f"{samples}.{seed}.denoised"
                    task = frame_task(scene, pose, name, samples=samples, error=None, seed=seed % FIRST_SEED)
                    rendered = render(task)
                    self.trials.append(measure_trial(cell, pose, rendered, truth))
                    self.report(_trial_text(self.trials[-1]))
                    yield

    def write(self, folder: Path) -> None:
        """Write a row for each frame."""
        write_csv(folder / self.FILE, Trial, self.trials)

    def blocks(self) -> Iterator[str | TextTable]:
        yield from self.header()
        yield summarize_trials(self.trials)


def measure_trial(cell: Cell, pose: Pose, rendered: WorkerFrame, truth: Reference) -> Trial:
    """Return the errors of a frame."""
    assert rendered.raw is not None
    assert rendered.raw_relmse is not None
    covered = truth.alpha > 0.0
    pictures = (rendered.raw.astype(np.float64), 0.5 * (rendered.a.astype(np.float64) + rendered.b))
    raw, denoised = map(truth.relmse, pictures)
    raw_flip, denoised_flip = (float(flip(picture, truth.mean)[1][covered].mean()) for picture in pictures)
    errors = raw, rendered.raw_relmse, denoised, rendered.relmse, raw_flip, denoised_flip, truth.own_relmse
    drawn = cell.scene, cell.look, cell.ibl, pose.element, pose.lighting
    return Trial(*drawn, rendered.samples, *errors, rendered.seconds)


def _trial_text(trial: Trial) -> str:
    return (
        f"{trial.asset}, {trial.light}, {trial.look}: {trial.samples} samples, raw {trial.raw:.2e} "
        f"(estimate x{trial.raw_ratio:.2f}), denoised {trial.denoised:.2e} (x{trial.ratio:.2f})"
    )


def summarize_trials(trials: Sequence[Trial]) -> str:
    """Return a text on the ratios of estimates to true errors, and on the gain of denoising for each sample count."""
    if not trials:
        return "no frame was measured"
    reference = max(trial.reference for trial in trials)
    lines = [f"{len(trials)} frames, references' own relMSE at most {reference:.1e}"]
    for name, ratios in (
        ("denoised", [trial.ratio for trial in trials]),
        ("raw", [trial.raw_ratio for trial in trials]),
    ):
        within = statistics.fmean(1.0 / USUAL_RATIO <= ratio <= USUAL_RATIO for ratio in ratios)
        low = sum(ratio < MIN_RATIO for ratio in ratios)
        lines.append(
            f"estimate of {name} frames / truth: within {USUAL_RATIO:g} for {within:.0%}, "
            f"least {min(ratios):.2f} ({low} below {MIN_RATIO:g}), median {statistics.median(ratios):.2f}"
        )
    worse = [trial.denoised / trial.raw for trial in trials if trial.denoised > _ROUNDING_FACTOR * trial.raw]
    lines.append(f"worse than raw: {len(worse)}" + (f", at most x{max(worse):.3f}" if worse else ""))
    for samples in sorted({trial.samples for trial in trials}):
        subset = [trial for trial in trials if trial.samples == samples]
        gain = statistics.geometric_mean(trial.raw / trial.denoised for trial in subset)
        raw, denoised = (statistics.fmean(getattr(trial, name) for trial in subset) for name in ("raw_flip", "flip"))
        lines.append(f"{samples} samples: error / {gain:.2f}, FLIP {raw:.4f} raw, {denoised:.4f} denoised")
    return "\n".join(lines)
