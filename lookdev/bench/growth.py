"""Measures how the time of a frame and the memory grow with the size of a scene, for the table of `lookdev bench`.

The size is a number of pixels, looks, lights, layers or triangles, or the number of frames that one process renders.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from lookdev.bench.benchmark import OpenRenderer, render_in_turn
from lookdev.bench.options import QUARTERS, BenchOptions
from lookdev.bench.subjects import (
    LOOKS,
    MAX_LAYERS,
    MILLION,
    POSE,
    bench_asset,
    bench_light,
    bench_scene,
    layered_look,
    make_boulder,
    rectangles,
    scale_lights,
    varied_look,
)  # fmt: skip
from lookdev.light import Light
from lookdev.rendering.backends import BACKENDS, WORKER_COMMAND
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.task import FrameTask, SceneTask, frame_task
from lookdev.scene import Pose

# The sizes that are measured.
PIXELS = (64, 128, 256, 512)  # sides of the frame
LOOK_COUNTS = (1, 2, 4, 8, 16, 32)
LIGHTS = (1, 3, 10, 30, 100)
LAYERS = (1, 2, 4, MAX_LAYERS)
TRIANGLES = (MILLION // 100, MILLION // 10, MILLION)

# The usual scene. In each measurement, one of the sizes above changes.
_SCENE, _LOOK, _IBL = "shaderball", "plastic", "studio"
_SIDE = 96  # pixels
_SAMPLES = 16  # per pixel
_REPEATS = 3  # the number of times each frame is rendered, except the frames of the quantity "frames"


@dataclass(frozen=True)
class GrowthRow:
    """The cost of a frame at one size.

    `size` is the value of the quantity that grows. `seconds`, `low` and `high` are the median, the least and the most
    seconds of a frame. `memory` is the peak memory of the render process, in bytes.
    """

    size: int
    seconds: float
    low: float
    high: float
    memory: int


@dataclass(frozen=True)
class Growth:
    """The cost of a frame for increasing sizes of one quantity, rendered by one backend.

    `quantity` is the name of the quantity, a key of `QUANTITIES`. The sequence of the quantity "frames" is divided into
    quarters. The size of a row is then the number of frames from the start of the sequence to the end of a quarter.
    """

    quantity: str
    backend: str
    rows: tuple[GrowthRow, ...]


GrowthRows = Iterator[GrowthRow]


@dataclass(frozen=True)
class Quantity:
    """A quantity on which the cost of a frame may depend.

    `measure` takes the name of a backend, the options, and a function that starts a render process. It yields a row for
    each size. `can_show` takes the name of a backend, and returns whether this backend can render the scenes.
    """

    help: str
    measure: Callable[[str, BenchOptions, OpenRenderer], GrowthRows]
    can_show: Callable[[str], bool] = lambda backend: True


def _scene(backend: str, **changes: Any) -> SceneTask:
    """Return the usual scene, with arguments of `bench_scene` replaced by `changes`."""
    usual = {"look": LOOKS[_LOOK].make(), "lights": (bench_light(_IBL),), "resolution": _SIDE}
    return bench_scene(_SCENE, **{**usual, **changes}, backend=backend)


def _task(scene: SceneTask, seed: int, pose: Pose = POSE) -> FrameTask:
    """Return the task to render a scene with `_SAMPLES` samples a pixel."""
    return frame_task(scene, pose, f"{pose.element}.{seed}", samples=_SAMPLES, error=None, seed=seed)


def _row(size: int, seconds: Sequence[float], last: WorkerFrame) -> GrowthRow:
    """Return the row of a size from the seconds of its frames and, for the peak memory, the last frame."""
    return GrowthRow(size, statistics.median(seconds), min(seconds), max(seconds), last.memory)


def _measure_sizes(
    changes: Callable[[], Mapping[int, Mapping[str, Any]]],
) -> Callable[[str, BenchOptions, OpenRenderer], GrowthRows]:
    """Return a measurement of one scene for each size; `changes` returns the arguments of `_scene`, by size.

    Each scene is rendered in a process of its own. The frames of the scenes are interleaved.
    """

    def measure(backend: str, options: BenchOptions, open_process: OpenRenderer) -> GrowthRows:
        scenes = {size: _scene(backend, **change) for size, change in changes().items()}
        frames = zip(*render_in_turn(list(scenes.values()), _task, _REPEATS, open_process), strict=True)
        for size, repeats in zip(scenes, frames, strict=True):
            yield _row(size, [frame.seconds for frame in repeats], repeats[-1])

    return measure


def _measure_frames(backend: str, options: BenchOptions, open_process: OpenRenderer) -> GrowthRows:
    """Measure a sequence of frames in one process, and yield a row for each quarter of the sequence.

    Each quarter turns the asset once by 360 degrees, so that all quarters have the same poses.
    """
    scene, count = _scene(backend), options.frames
    poses = [Pose(360.0 * QUARTERS * number / count % 360.0, 0.0) for number in range(count)]
    with open_process() as render:
        render(_task(scene, 0))  # warms up
        frames = [render(_task(scene, number, pose)) for number, pose in enumerate(poses)]
    for start, end in pairwise(count * quarter // QUARTERS for quarter in range(QUARTERS + 1)):
        yield _row(end, [frame.seconds for frame in frames[start:end]], frames[end - 1])


def _measure_looks(backend: str, options: BenchOptions, open_process: OpenRenderer) -> GrowthRows:
    """Measure one frame in each of many looks, rendered one after the other in one process.

    A row of size n has the mean wall time of the first n frames, including the changes of scene.
    """
    scenes = [_scene(backend, look=varied_look(number)) for number in range(max(LOOK_COUNTS))]
    means: dict[int, list[float]] = {count: [] for count in LOOK_COUNTS}
    last: dict[int, WorkerFrame] = {}
    for repeat in range(_REPEATS):
        with open_process() as render:
            render(_task(_scene(backend), 0))  # warms up, in another look
            started = time.perf_counter()
            for count, scene in enumerate(scenes, start=1):
                last[count] = render(_task(scene, repeat))
                if count in means:
                    means[count].append((time.perf_counter() - started) / count)
    for count, values in means.items():
        yield _row(count, values, last[count])


def _lamps(count: int) -> tuple[Light, ...]:
    """Return rectangle lights around the asset of the usual scene."""
    return scale_lights(rectangles(count), bench_asset(_SCENE))


def _can_render_lamps(backend: str) -> bool:
    return BACKENDS[backend].any_light or not BACKENDS[backend].light_gaps(rectangles(1))


def _can_render_layers(backend: str) -> bool:
    return BACKENDS[backend].look_gap(layered_look(MAX_LAYERS)) is None


def _can_share_scene(backend: str) -> bool:
    """Return whether a backend renders all poses in one scene; `mitsuba_worker` builds a scene for each pose."""
    return BACKENDS[backend].command == WORKER_COMMAND


QUANTITIES: dict[str, Quantity] = {
    "pixels": Quantity(
        "frames of 64 x 64 to 512 x 512 pixels", _measure_sizes(lambda: {n * n: {"resolution": n} for n in PIXELS})
    ),
    "looks": Quantity("a frame in each of 1 to 32 looks, in turn", _measure_looks),
    "lights": Quantity(
        "1 to 100 rectangles", _measure_sizes(lambda: {n: {"lights": _lamps(n)} for n in LIGHTS}), _can_render_lamps
    ),
    "layers": Quantity(
        "1 to 8 layers, their masks textures",
        _measure_sizes(lambda: {n: {"look": layered_look(n)} for n in LAYERS}),
        _can_render_layers,
    ),
    "triangles": Quantity(
        "boulders of 10,000 to a million triangles",
        _measure_sizes(lambda: {n: {"asset": make_boulder(n)} for n in TRIANGLES}),
    ),
    "frames": Quantity("a sequence, by its quarters", _measure_frames, _can_share_scene),
}
"""The quantities that are measured, by name, in the order of the report."""
