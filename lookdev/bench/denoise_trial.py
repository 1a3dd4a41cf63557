"""Benchmark that renders random denoised frames, and compares their estimated errors with their true errors.

The benchmark also counts the denoised frames that have a larger error than the raw frame. An asset, a look, a light and
a pose are drawn at random. A reference, which is a converged picture, and a frame for each number in `SAMPLES` are
rendered. The true error of a frame is its relMSE against the reference, minus the relMSE of the reference itself.
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

SAMPLES = (8, 16, 32, 64, 256)  # per pixel
USUAL_RATIO, MIN_RATIO = 1.3, 0.6
"""Bounds of the ratio of estimated error to true error.

The ratio should be within 1 / `USUAL_RATIO` and `USUAL_RATIO` for most frames, and at least `MIN_RATIO` for all.
"""

_ASSETS = ("sphere", "shaderball", "suzanne")
_LIGHTS = (*IBLS, "studio+3", "lamp")
_FOLDERS = ("", "classic")  # folders of the shipped materials
_PARTS = 4  # a reference is the mean of this number of independent renders
# A denoised frame is worse than its raw frame if its error is larger by more than this factor. The denoised picture is
# the mean of two halves. The raw picture is rounded once more than this mean, so that the two errors differ a little
# even if denoising changes nothing.
_ROUNDING_FACTOR = 1.001


@dataclass(frozen=True)
class Trial:
    """One frame: the true error, the estimated error and the mean FLIP, of its raw and of its denoised picture."""

    asset: str
    look: str
    light: str
    element: float  # rotation of the asset, degrees
    lighting: float  # rotation of the light, degrees
    samples: int  # per pixel
    raw_relmse: float  # true relMSE of the raw picture
    raw_estimate: float  # estimated relMSE of the raw picture
    denoised_relmse: float  # true relMSE of the denoised picture
    denoised_estimate: float  # estimated relMSE of the denoised picture
    raw_flip: float  # mean FLIP of the raw picture
    denoised_flip: float  # mean FLIP of the denoised picture
    reference_relmse: float  # relMSE of the reference itself
    seconds: float  # measured in the worker

    @property
    def ratio(self) -> float:
        """The estimated error over the true error of the denoised picture."""
        return self.denoised_estimate / self.denoised_relmse

    @property
    def raw_ratio(self) -> float:
        """The estimated error over the true error of the raw picture."""
        return self.raw_estimate / self.raw_relmse


def trial_looks() -> dict[str, Callable[[], Look]]:
    """Return a function for each look of a trial, by name: the looks of the benchmark and the shipped materials.

    The shipped materials add textures and flakes.
    """
    files = [file for folder in _FOLDERS for file in sorted((shipped_folder() / "materials" / folder).glob("*.usda"))]
    return {name: look.make for name, look in LOOKS.items()} | {file.stem: partial(read_look, file) for file in files}


def draw_cell(seed: int, number: int) -> tuple[Cell, Pose]:
    """Return a random cell (asset, light and look) and a random pose, which depend on the seed and the number alone."""
    rng = np.random.default_rng((seed, number))
    asset, look, light = (str(rng.choice(names)) for names in (_ASSETS, list(trial_looks()), _LIGHTS))
    return Cell(asset, light, look), Pose(*rng.uniform(0.0, 360.0, 2).round(1).tolist())


def cell_scene(cell: Cell, pose: Pose, resolution: int) -> tuple[SceneTask, str]:
    """Return the scene of a cell, and the key of its picture, which names its reference in the cache."""
    look, lights = trial_looks()[cell.look](), bench_lights(cell.ibl, bench_asset(cell.scene))
    # `denoise` makes shaders that also render the features that guide a denoiser. References use the same shaders.
    scene = bench_scene(cell.scene, look, lights, resolution, denoise=True)
    return scene, picture_key(scene, look, cell.ibl, pose)


@dataclass(kw_only=True)
class DenoiseTrial(Benchmark):
    """The benchmark that compares estimated and true errors of random denoised frames.

    It uses these options: `frames`, the number of frames; `seed`, which determines the random cells (the constants of
    the denoiser are tuned with one seed and reported with another); `resolution`; `reference`, the samples of each
    reference in multiples of the largest of `SAMPLES`; and `fresh`.
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
                part_samples, renderer = (
                    SAMPLES[-1] * options.reference // _PARTS,
                    picture_renderer(render, scene, pose),
                )
                truth = obtain_reference(key, part_samples, _PARTS, renderer, self.report, fresh=options.fresh)
                first = len(SAMPLES) * number
                for seed, samples in enumerate(SAMPLES[: options.frames - first], start=first):
                    name = f"{samples}.{seed}.denoised"
                    # Frames take seeds below `FIRST_SEED`; references take the seeds from there on.
                    task = frame_task(scene, pose, name, samples=samples, error=None, seed=seed % FIRST_SEED)
                    rendered = render(task)
                    self.trials.append(measure_trial(cell, pose, rendered, truth))
                    self.report(_trial_text(self.trials[-1]))
                    yield

    def write(self, folder: Path) -> None:
        """Write a CSV file with a row for each frame."""
        write_csv(folder / self.FILE, Trial, self.trials)

    def blocks(self) -> Iterator[str | TextTable]:
        yield from self.header()
        yield summarize_trials(self.trials)


def measure_trial(cell: Cell, pose: Pose, rendered: WorkerFrame, truth: Reference) -> Trial:
    """Return the errors of a denoised frame, and of its raw picture, against the reference `truth`."""
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
        f"{trial.asset}, {trial.light}, {trial.look}: {trial.samples} samples, raw {trial.raw_relmse:.2e} "
        f"(estimate x{trial.raw_ratio:.2f}), denoised {trial.denoised_relmse:.2e} (x{trial.ratio:.2f})"
    )


def summarize_trials(trials: Sequence[Trial]) -> str:
    """Return a text with the ratios of estimated to true errors, and the gain of denoising for each sample count.

    The gain is the geometric mean, over the frames, of the raw picture's true error over the denoised picture's.
    """
    if not trials:
        return "no frame was measured"
    reference = max(trial.reference_relmse for trial in trials)
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
    worse = [
        trial.denoised_relmse / trial.raw_relmse
        for trial in trials
        if trial.denoised_relmse > _ROUNDING_FACTOR * trial.raw_relmse
    ]
    lines.append(f"worse than raw: {len(worse)}" + (f", at most x{max(worse):.3f}" if worse else ""))
    for samples in sorted({trial.samples for trial in trials}):
        subset = [trial for trial in trials if trial.samples == samples]
        gain = statistics.geometric_mean(trial.raw_relmse / trial.denoised_relmse for trial in subset)
        raw, denoised = (
            statistics.fmean(getattr(trial, name) for trial in subset) for name in ("raw_flip", "denoised_flip")
        )
        lines.append(f"{samples} samples: error / {gain:.2f}, FLIP {raw:.4f} raw, {denoised:.4f} denoised")
    return "\n".join(lines)
