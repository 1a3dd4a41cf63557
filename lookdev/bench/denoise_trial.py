"""Denoised frames at random, against converged pictures: is the error as measured, is none worse than its raw frame?

A trial is of cells: an asset, a look, a light and a pose, drawn at random. Of each there is one reference, and a frame
with each of `SAMPLES`. True errors are relMSE against the reference, without its own.
"""

from __future__ import annotations

import csv
import hashlib
import json
import statistics
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, astuple, dataclass, fields, replace
from functools import partial
from pathlib import Path

import numpy as np

from lookdev.bench.backends import PATIENCE, bench_asset, bench_environment, bench_lights, shot_of
from lookdev.bench.looks import LOOKS
from lookdev.bench.matrix import IBLS, SCENES
from lookdev.bench.reference import FIRST_SEED, Reference, Shot, obtain
from lookdev.bench.rigs import RIGS
from lookdev.cache import atomic_path
from lookdev.checks.images import flip
from lookdev.material import Look
from lookdev.material.usd import read_look
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.results import Rendered
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import FrameTask, SceneTask, frame_task
from lookdev.rendering.worker import open_renderer
from lookdev.scene import Pose, Sampling, Scene
from lookdev.shipped import shipped_folder

SAMPLES = (8, 16, 32, 64, 256)
SIDE = 96
"""Pixels of a frame's side, where nothing else is wanted."""
WITHIN, LEAST = 1.3, 0.6
"""The ratio of estimate and truth, either way, within which most frames shall be; the least that any shall have."""

CSV_FILE = "denoise.csv"

_ASSETS = ("sphere", "shaderball", "suzanne")
_LIGHTS = (*IBLS, "studio+3", "lamp")
_FOLDERS = ("", "classic")
_PARTS = 4
_SAME = 1.001  # the raw picture that comes beside the halves is rounded once more than their mean

OpenRenderer = Callable[[], AbstractContextManager[Callable[[FrameTask], Rendered]]]
_open_exact: OpenRenderer = partial(open_renderer, PATIENCE)


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


@dataclass(frozen=True)
class Cell:
    """What the frames of a cell show."""

    asset: str
    look: str
    light: str
    pose: Pose


def looks() -> dict[str, Callable[[], Look]]:
    """Return the looks of a trial by name: those of the benchmark, and the shipped ones with textures and flakes."""
    files = [file for folder in _FOLDERS for file in sorted((shipped_folder() / "materials" / folder).glob("*.usda"))]
    return {name: look.make for name, look in LOOKS.items()} | {file.stem: partial(read_look, file) for file in files}


def draw_cell(seed: int, number: int) -> Cell:
    """Return a cell of a trial, which depends on the seed and the number alone."""
    rng = np.random.default_rng((seed, number))
    asset, look, light = (str(rng.choice(names)) for names in (_ASSETS, list(looks()), _LIGHTS))
    element, lighting = rng.uniform(0.0, 360.0, 2).round(1).tolist()
    return Cell(asset, look, light, Pose(element, lighting))


def cell_scene(cell: Cell, resolution: int) -> tuple[SceneTask, str]:
    """Return the scene of a cell, and a key of its picture whatever its sampling."""
    asset, look = bench_asset(cell.asset), looks()[cell.look]()
    lights = bench_lights(cell.light, asset)
    scene = replace(Scene.of_look(asset, look, lights[0], (resolution, resolution)), lights=lights)
    # References are of the same shaders, which can show what a denoiser is guided by.
    task = scene_task(scene, Sampling(bounces=SCENES[cell.asset].bounces, denoise="measured"), "exact")
    light = [each.digest for each in task.lights] if cell.light in RIGS else bench_environment(cell.light).digest
    parts = {
        "asset": task.asset.digest,
        "light": light,
        "camera": asdict(task.camera),
        "pose": asdict(cell.pose),
        "resolution": resolution,
        "bounces": task.sampling.bounces,
        "look": hashlib.sha256(repr(look).encode()).hexdigest(),
        "version": BACKENDS["exact"].version(),
    }
    return task, json.dumps(parts, sort_keys=True)


def run_trial(
    frames: int,
    folder: Path,
    report: Callable[[str], None],
    *,
    seed: int = 0,
    resolution: int = SIDE,
    reference: int = 8,
    fresh: bool = False,
    opened: OpenRenderer = _open_exact,
) -> list[Trial]:
    """Render so many frames and measure them; ``denoise.csv`` is written after every frame, also before Ctrl-C.

    Parameters
    ----------
    seed
        Chooses the cells: constants are tuned on those of one seed, and reported on those of another.
    reference
        Samples of each reference, in multiples of the largest of `SAMPLES`.
    fresh
        Render references anew; otherwise they come from the cache, by content.
    """
    folder.mkdir(parents=True, exist_ok=True)
    trials: list[Trial] = []
    with opened() as render:
        try:
            for trial in _measured(frames, render, report, seed, resolution, reference, fresh):
                trials.append(trial)
                _write(trials, folder / CSV_FILE)
                report(
                    f"{trial.asset}, {trial.light}, {trial.look}: {trial.samples} samples, raw {trial.raw:.2e} "
                    f"(estimate x{trial.raw_ratio:.2f}), denoised {trial.denoised:.2e} (x{trial.ratio:.2f})"
                )
        except KeyboardInterrupt:
            report(f"interrupted: {len(trials)} of {frames} frames")
    return trials


def _measured(
    frames: int,
    render: Callable[[FrameTask], Rendered],
    report: Callable[[str], None],
    seed: int,
    resolution: int,
    reference: int,
    fresh: bool,
) -> Iterator[Trial]:
    for number in range(-(-frames // len(SAMPLES))):
        cell = draw_cell(seed, number)
        scene, key = cell_scene(cell, resolution)

        def shoot(samples: int, at: int, scene: SceneTask = scene, pose: Pose = cell.pose) -> Shot:
            name = f"{samples}.{at}"
            return shot_of(render(frame_task(scene, pose, name, samples=samples, error=None, seed=at, denoise="off")))

        truth = obtain(key, SAMPLES[-1] * reference // _PARTS, _PARTS, shoot, fresh=fresh, report=report)
        for place, samples in enumerate(SAMPLES[: frames - number * len(SAMPLES)]):
            at = (len(SAMPLES) * number + place) % FIRST_SEED
            task = frame_task(scene, cell.pose, f"{samples}.{at}.denoised", samples=samples, error=None, seed=at)
            yield _trial(cell, samples, render(task), truth)


def _trial(cell: Cell, samples: int, rendered: Rendered, truth: Reference) -> Trial:
    assert rendered.raw is not None
    assert rendered.raw_relmse is not None
    covered = truth.alpha > 0.0
    pictures = (rendered.raw.astype(np.float64), 0.5 * (rendered.a.astype(np.float64) + rendered.b))
    raw, denoised = map(truth.relmse, pictures)
    raw_flip, denoised_flip = (float(flip(picture, truth.mean)[1][covered].mean()) for picture in pictures)
    return Trial(
        cell.asset,
        cell.look,
        cell.light,
        cell.pose.element,
        cell.pose.lighting,
        samples,
        raw,
        rendered.raw_relmse,
        denoised,
        rendered.relmse,
        raw_flip,
        denoised_flip,
        truth.own_relmse,
        rendered.seconds,
    )


def summary(trials: Sequence[Trial]) -> str:
    """Return what a trial shows: how far estimates are from truth, and what denoising gains by samples."""
    if not trials:
        return "no frame was measured"
    lines = [f"{len(trials)} frames, references' own relMSE at most {max(each.reference for each in trials):.1e}"]
    for name, ratios in (
        ("denoised", [each.ratio for each in trials]),
        ("raw", [each.raw_ratio for each in trials]),
    ):
        within = sum(1.0 / WITHIN <= ratio <= WITHIN for ratio in ratios) / len(ratios)
        low = sum(ratio < LEAST for ratio in ratios)
        lines.append(
            f"estimate of {name} frames / truth: within {WITHIN:g} for {within:.0%}, "
            f"least {min(ratios):.2f} ({low} below {LEAST:g}), median {statistics.median(ratios):.2f}"
        )
    worse = [each.denoised / each.raw for each in trials if each.denoised > _SAME * each.raw]
    lines.append(f"worse than raw: {len(worse)}" + (f", at most x{max(worse):.3f}" if worse else ""))
    for samples in sorted({each.samples for each in trials}):
        some = [each for each in trials if each.samples == samples]
        gain = statistics.geometric_mean(each.raw / each.denoised for each in some)
        raw, denoised = (statistics.fmean(values) for values in zip(*((e.raw_flip, e.flip) for e in some), strict=True))
        lines.append(f"{samples} samples: error / {gain:.2f}, FLIP {raw:.4f} raw, {denoised:.4f} denoised")
    return "\n".join(lines)


def _write(trials: Sequence[Trial], file: Path) -> None:
    with atomic_path(file) as path, path.open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream)
        table.writerow(field.name for field in fields(Trial))
        table.writerows(astuple(each) for each in trials)
