"""The cost of a frame of ``exact`` over the frames before it, pixels, layers and triangles."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

from lookdev.asset import Asset
from lookdev.bench.assets import make_boulder
from lookdev.bench.backends import PATIENCE, POSE, bench_asset, bench_light, bench_scene
from lookdev.bench.looks import LOOKS, MOST_LAYERS, layered
from lookdev.bench.matrix import MILLION, SCENES
from lookdev.errors import LookdevError
from lookdev.material import Look
from lookdev.render.task import FrameTask, SceneTask, one_frame
from lookdev.render.worker import Rendered, renderer
from lookdev.scene import Pose

PIXELS = (64, 128, 256, 512)
LAYERS = (1, 2, 4, MOST_LAYERS)
TRIANGLES = (MILLION // 100, MILLION // 10, MILLION)

_SCENE, _LOOK, _IBL = "shaderball", "plastic", "studio"
_SIDE = 128
_SAMPLES = 16
_REPEATS = 3
_QUARTERS = 4

OpenRenderer = Callable[[], AbstractContextManager[Callable[[FrameTask], Rendered]]]
_open_exact: OpenRenderer = partial(renderer, PATIENCE)


@dataclass(frozen=True)
class GrowthRow:
    """Median seconds of a frame of one size, and the peak memory of its process in bytes."""

    size: int
    seconds: float
    memory: int


@dataclass(frozen=True)
class Growth:
    """Cost over one quantity; for frames, the size is the number of the last frame of a quarter of the sequence."""

    of: str
    rows: tuple[GrowthRow, ...]


def measure_growth(frames: int, report: Callable[[str], None], opened: OpenRenderer = _open_exact) -> Iterator[Growth]:
    """Measure all four, one after another; `opened` makes a renderer in a new process.

    Raises LookdevError where the sequence has fewer than four frames.
    """
    if frames < _QUARTERS:
        raise LookdevError(f"{frames} frames: their first quarter needs at least {_QUARTERS}")
    report(f"growth: {frames} frames")
    yield Growth("frames", _frame_rows(_scene(), frames, opened))
    for of, scenes in (
        ("pixels", {side * side: _scene(side=side) for side in PIXELS}),
        ("layers", {layers: _scene(look=layered(layers)) for layers in LAYERS}),
        ("triangles", {count: _scene(make_boulder(count)) for count in TRIANGLES}),
    ):
        report(f"growth: {', '.join(f'{size:,}' for size in scenes)} {of}")
        yield Growth(of, _rows(scenes, opened))


def _scene(asset: Asset | None = None, look: Look | None = None, side: int = _SIDE) -> SceneTask:
    asset, look = asset or bench_asset(_SCENE), look or LOOKS[_LOOK].make()
    return bench_scene(asset, look, (bench_light(_IBL),), side, SCENES[_SCENE].bounces)


def _frame_rows(scene: SceneTask, frames: int, opened: OpenRenderer) -> tuple[GrowthRow, ...]:
    seconds, memory = [], []
    with opened() as render:
        render(_task(scene, POSE, 0))  # warms up
        for number in range(frames):
            # Each quarter is a whole turn, so that all quarters have the same poses.
            turn = 360.0 * _QUARTERS * number / frames
            rendered = render(_task(scene, Pose(turn % 360.0, 0.0), number))
            seconds.append(rendered.seconds)
            memory.append(rendered.memory)
    ends = [frames * quarter // _QUARTERS for quarter in range(_QUARTERS + 1)]
    return tuple(
        GrowthRow(end, statistics.median(seconds[start:end]), memory[end - 1]) for start, end in pairwise(ends)
    )


def _rows(scenes: Mapping[int, SceneTask], opened: OpenRenderer) -> tuple[GrowthRow, ...]:
    """Measure scenes of increasing size, interleaved, each in a separate process."""
    shots: dict[int, list[Rendered]] = {size: [] for size in scenes}
    with ExitStack() as stack:
        renders = {size: stack.enter_context(opened()) for size in scenes}
        for size, scene in scenes.items():
            renders[size](_task(scene, POSE, 0))  # warms up
        for repeat in range(_REPEATS):
            for size, scene in scenes.items():
                shots[size].append(renders[size](_task(scene, POSE, repeat)))
    return tuple(
        GrowthRow(size, statistics.median(each.seconds for each in taken), max(each.memory for each in taken))
        for size, taken in shots.items()
    )


def _task(scene: SceneTask, pose: Pose, seed: int) -> FrameTask:
    return one_frame(scene, pose, f"growth {seed}", samples=_SAMPLES, error=None, seed=seed)
