"""How cost grows, measured on a renderer that only does arithmetic."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from bench_fakes import quiet

from lookdev.asset import read_asset
from lookdev.bench import growth
from lookdev.bench.assets import make_boulder, triangle_count
from lookdev.bench.growth import measure_growth
from lookdev.errors import LookdevError
from lookdev.render.task import FrameTask
from lookdev.render.worker import Rendered


class FakeProcesses:
    """Seconds are pixels / 1000, memory grows by a byte a frame of the same process."""

    def __init__(self) -> None:
        self.open = 0
        self.tasks: list[FrameTask] = []

    @contextmanager
    def __call__(self) -> Iterator[Callable[[FrameTask], Rendered]]:
        self.open += 1
        done = 0

        def render(task: FrameTask) -> Rendered:
            nonlocal done
            done += 1
            self.tasks.append(task)
            width, height = task.scene.resolution
            black = np.zeros((height, width, 3), np.float32)
            seconds = width * height / 1000.0
            return Rendered(black, black, black[..., 0], task.scene.sampling.samples, seconds, 0.0, "fake", 100 + done)

        yield render
        self.open -= 1


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(growth, "TRIANGLES", (1000, 4000))
    monkeypatch.setattr(growth, "_SCENE", "sphere")
    monkeypatch.setattr(growth, "_IBL", "white")


@pytest.mark.usefixtures("small")
def test_all_four() -> None:
    processes = FakeProcesses()
    grown = {each.of: each.rows for each in measure_growth(10, quiet, processes)}
    assert list(grown) == ["frames", "pixels", "layers", "triangles"]
    assert processes.open == 0
    # Quarters of ten frames; the process has rendered one more, to warm up.
    assert [(row.size, row.memory) for row in grown["frames"]] == [(2, 103), (5, 106), (7, 108), (10, 111)]
    assert [(row.size, row.seconds) for row in grown["pixels"]] == [(n * n, n * n / 1000.0) for n in growth.PIXELS]
    assert [row.size for row in grown["layers"]] == [1, 2, 4, 8]
    assert [row.size for row in grown["triangles"]] == [1000, 4000]


@pytest.mark.usefixtures("small")
def test_what_grows_is_in_the_scene() -> None:
    processes = FakeProcesses()
    rows = iter(measure_growth(8, quiet, processes))

    def scenes() -> list[FrameTask]:
        processes.tasks.clear()
        next(rows)
        return processes.tasks

    angles = [task.pose.element for task in scenes()]
    # Every quarter of the frames is a whole turn: the same sides of the asset.
    assert angles == [0.0, *(0.0, 180.0) * 4]
    assert {task.scene.resolution[0] for task in scenes()} == set(growth.PIXELS)
    # Masks are textures: none of the layers folds away.
    assert {len(task.scene.shaders[0].textures) for task in scenes()} == {0, 1, 3, 7}
    counts = sorted({triangle_count(read_asset(task.scene.asset.path)) for task in scenes()})
    assert counts == [triangle_count(make_boulder(n)) for n in (1000, 4000)]
    # Turns are taken: after the warm-up, one of each size, three times.
    sizes = [task.scene.asset for task in processes.tasks]
    assert sizes == 4 * sizes[:2]


def test_too_few_frames_are_refused() -> None:
    with pytest.raises(LookdevError, match="3 frames"):
        next(iter(measure_growth(3, quiet, FakeProcesses())))
