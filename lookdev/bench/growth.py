"""The cost of a frame over the frames before it, pixels, looks, lights, layers and triangles."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

from lookdev.asset import Asset
from lookdev.bench.assets import make_boulder
from lookdev.bench.backends import PATIENCE, POSE, bench_asset, bench_light, bench_scene
from lookdev.bench.looks import LOOKS, MOST_LAYERS, different, layered
from lookdev.bench.matrix import MILLION, QUARTERS, SCENES, Options
from lookdev.bench.rigs import rectangles
from lookdev.errors import LookdevError
from lookdev.light import Light
from lookdev.material import Look
from lookdev.rendering.backends import BACKENDS, WORKER_COMMAND
from lookdev.rendering.results import Rendered
from lookdev.rendering.task import FrameTask, SceneTask, frame_task
from lookdev.rendering.worker import open_renderer
from lookdev.scene import Pose

PIXELS = (64, 128, 256, 512)
LOOK_COUNTS = (1, 2, 4, 8, 16, 32)
LIGHTS = (1, 3, 10, 30, 100)
LAYERS = (1, 2, 4, MOST_LAYERS)
TRIANGLES = (MILLION // 100, MILLION // 10, MILLION)

_SCENE, _LOOK, _IBL = "shaderball", "plastic", "studio"
_SIDE = 96
_SAMPLES = 16
_REPEATS = 3

OpenRenderer = Callable[[], AbstractContextManager[Callable[[FrameTask], Rendered]]]
open_process: OpenRenderer = partial(open_renderer, PATIENCE)
Report = Callable[[str], None]


@dataclass(frozen=True)
class GrowthRow:
    """Seconds of a frame of one size: median, and extremes; the peak memory of its process in bytes."""

    size: int
    seconds: float
    low: float
    high: float
    memory: int


@dataclass(frozen=True)
class Growth:
    """Cost over one quantity; for frames, the size is the number of the last frame of a quarter of the sequence."""

    of: str
    backend: str
    rows: tuple[GrowthRow, ...]


@dataclass(frozen=True)
class Quantity:
    """What a frame's cost may grow with."""

    help: str
    measure: Callable[[Sequence[str], Options, OpenRenderer], Iterator[Growth]]


def measure_growth(
    backends: Sequence[str], options: Options, report: Report, opened: OpenRenderer = open_process
) -> Iterator[Growth | str]:
    """Measure all quantities, one after another, each for the backends that can show it.

    `opened` makes a renderer in a new process. Where a quantity cannot be measured, yields why.
    """
    for of, quantity in QUANTITIES.items():
        report(f"growth: {of}: {quantity.help}")
        try:
            yield from quantity.measure(backends, options, opened)
        except (LookdevError, OSError) as error:
            yield f"growth with {of}: {error}"


def _scene(
    backend: str,
    *,
    asset: Asset | None = None,
    look: Look | None = None,
    lights: tuple[Light, ...] | None = None,
    side: int = _SIDE,
) -> SceneTask:
    asset, look = asset or bench_asset(_SCENE), look or LOOKS[_LOOK].make()
    return bench_scene(asset, look, lights or (bench_light(_IBL),), side, SCENES[_SCENE].bounces, backend)


def _frames(backends: Sequence[str], options: Options, opened: OpenRenderer) -> Iterator[Growth]:
    """Measure a sequence of frames, by quarters: each is a whole turn, so that all have the same poses."""
    frames = options.frames
    ends = [frames * quarter // QUARTERS for quarter in range(QUARTERS + 1)]
    # The bench's worker of Mitsuba builds a scene for each pose.
    for backend in (each for each in backends if BACKENDS[each].command == WORKER_COMMAND):
        scene, shots = _scene(backend), []
        with opened() as render:
            render(_task(scene, POSE, 0))  # warms up
            for number in range(frames):
                turn = 360.0 * QUARTERS * number / frames
                shots.append(render(_task(scene, Pose(turn % 360.0, 0.0), number)))
        quarters = ((shots[start:end], end) for start, end in pairwise(ends))
        rows = (_row(end, [each.seconds for each in quarter], quarter[-1]) for quarter, end in quarters)
        yield Growth("frames", backend, tuple(rows))


def _looks(backends: Sequence[str], options: Options, opened: OpenRenderer) -> Iterator[Growth]:
    """Measure a frame of each of many looks in turn: wall time, with the changes of scene, over the first so many."""
    for backend in backends:
        scenes = [_scene(backend, look=different(number)) for number in range(max(LOOK_COUNTS))]
        means: dict[int, list[float]] = {count: [] for count in LOOK_COUNTS}
        last: dict[int, Rendered] = {}
        for repeat in range(_REPEATS):
            with opened() as render:
                render(_task(_scene(backend), POSE, 0))  # warms up, in another look
                started = time.perf_counter()
                for count, scene in enumerate(scenes, start=1):
                    rendered = render(_task(scene, POSE, repeat))
                    if count in means:
                        means[count].append((time.perf_counter() - started) / count)
                        last[count] = rendered
        yield Growth("looks", backend, tuple(_row(count, means[count], last[count]) for count in LOOK_COUNTS))


def _sizes(
    of: str, make: Callable[[str], Mapping[int, SceneTask]], able: Callable[[str], bool] = lambda backend: True
) -> Callable[[Sequence[str], Options, OpenRenderer], Iterator[Growth]]:
    """Return a measurement of scenes of increasing size, interleaved, each in a separate process."""

    def measure(backends: Sequence[str], options: Options, opened: OpenRenderer) -> Iterator[Growth]:
        for backend in (each for each in backends if able(each)):
            scenes = make(backend)
            shots: dict[int, list[Rendered]] = {size: [] for size in scenes}
            with ExitStack() as stack:
                renders = {size: stack.enter_context(opened()) for size in scenes}
                for size, scene in scenes.items():
                    renders[size](_task(scene, POSE, 0))  # warms up
                for repeat in range(_REPEATS):
                    for size, scene in scenes.items():
                        shots[size].append(renders[size](_task(scene, POSE, repeat)))
            rows = (_row(size, [each.seconds for each in found], found[-1]) for size, found in shots.items())
            yield Growth(of, backend, tuple(rows))

    return measure


def _pixels(backend: str) -> dict[int, SceneTask]:
    return {side * side: _scene(backend, side=side) for side in PIXELS}


def _lights(backend: str) -> dict[int, SceneTask]:
    asset = bench_asset(_SCENE)
    return {count: _scene(backend, lights=rectangles(count).around(asset)) for count in LIGHTS}


def _layers(backend: str) -> dict[int, SceneTask]:
    return {count: _scene(backend, look=layered(count)) for count in LAYERS}


def _triangles(backend: str) -> dict[int, SceneTask]:
    return {count: _scene(backend, asset=make_boulder(count)) for count in TRIANGLES}


def _lit_by_rectangles(backend: str) -> bool:
    record = BACKENDS[backend]
    return record.any_light or not record.cannot_light(rectangles(1).make())


def _layered(backend: str) -> bool:
    return BACKENDS[backend].cannot_show(layered(MOST_LAYERS)) is None


QUANTITIES: dict[str, Quantity] = {
    "pixels": Quantity("frames of 64 x 64 to 512 x 512 pixels", _sizes("pixels", _pixels)),
    "looks": Quantity("a frame in each of 1 to 32 looks, in turn", _looks),
    "lights": Quantity("1 to 100 rectangles", _sizes("lights", _lights, _lit_by_rectangles)),
    "layers": Quantity("1 to 8 layers, their masks textures", _sizes("layers", _layers, _layered)),
    "triangles": Quantity("boulders of 10,000 to a million triangles", _sizes("triangles", _triangles)),
    "frames": Quantity("a sequence, by its quarters", _frames),
}
"""What is measured, by its name, in the order of the report."""


def _row(size: int, seconds: Sequence[float], last: Rendered) -> GrowthRow:
    return GrowthRow(size, statistics.median(seconds), min(seconds), max(seconds), last.memory)


def _task(scene: SceneTask, pose: Pose, seed: int) -> FrameTask:
    return frame_task(scene, pose, f"{pose.element}.{seed}", samples=_SAMPLES, error=None, seed=seed)
