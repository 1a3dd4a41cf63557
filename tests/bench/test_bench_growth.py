"""How cost grows, measured on a renderer that only does arithmetic."""

import math
from collections.abc import Iterator
from dataclasses import replace

import pytest
from bench_fakes import FakeProcesses, quiet, triangle_count

from lookdev.asset import read_asset
from lookdev.bench import growth
from lookdev.bench.growth import GrowthRow
from lookdev.bench.matrix import TableBenchmark
from lookdev.bench.options import BenchOptions
from lookdev.bench.subjects import make_boulder, varied_look
from lookdev.errors import RenderError
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.task import FrameTask


def processes() -> FakeProcesses:
    """Return processes whose seconds are pixels / 1000."""
    return FakeProcesses(lambda task: math.prod(task.scene.resolution) / 1000.0)


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes = {"TRIANGLES": (1000, 4000), "LOOK_COUNTS": (1, 2, 4), "LIGHTS": (1, 3), "_SCENE": "sphere", "_IBL": "white"}
    for name, value in sizes.items():
        monkeypatch.setattr(growth, name, value)


OPTIONS = BenchOptions(frames=10)


def measure_growth(fakes: FakeProcesses, *backends: str) -> TableBenchmark:
    table = TableBenchmark(options=replace(OPTIONS, backends=backends), report=quiet, open_process=fakes)
    assert len(list(table.measure_growth())) == len(table.growth)
    return table


@pytest.mark.usefixtures("small")
def test_all_quantities_for_the_backends_that_can_show_them() -> None:
    fakes = processes()
    grown: dict[str, dict[str, tuple[GrowthRow, ...]]] = {}
    for result in measure_growth(fakes, "exact", "principled", "mitsuba-principled").growth:
        grown.setdefault(result.quantity, {})[result.backend] = result.rows
    assert list(grown) == list(growth.QUANTITIES)
    assert fakes.open == 0
    blender = ["exact", "principled"]
    names = {of: list(rows) for of, rows in grown.items()}
    all_three = [*blender, "mitsuba-principled"]
    assert names == {"pixels": all_three, "looks": all_three, "lights": blender, "layers": ["exact"],
                     "triangles": all_three, "frames": blender}  # fmt: skip
    # Quarters of ten frames; the process has rendered one more, to warm up.
    assert [(row.size, row.memory) for row in grown["frames"]["exact"]] == [(2, 103), (5, 106), (7, 108), (10, 111)]
    pixels = [(row.size, row.seconds, row.low, row.high) for row in grown["pixels"]["principled"]]
    assert pixels == [(n * n, *[n * n / 1000.0] * 3) for n in growth.PIXELS]
    assert [row.size for row in grown["layers"]["exact"]] == [1, 2, 4, 8]
    assert [row.size for row in grown["looks"]["principled"]] == [1, 2, 4]
    # Each time in a new process: one frame to warm up, then the four looks.
    assert [row.memory for row in grown["looks"]["principled"]] == [102, 103, 105]


@pytest.mark.usefixtures("small")
def test_what_grows_is_in_the_scene() -> None:
    fakes = processes()

    def tasks(of: str) -> list[FrameTask]:
        fakes.tasks.clear()
        list(growth.QUANTITIES[of].measure("exact", replace(OPTIONS, frames=8), fakes))
        return list(fakes.tasks)

    # Every quarter of the frames is a whole turn: the same sides of the asset.
    assert [task.pose.element for task in tasks("frames")] == [0.0, *(0.0, 180.0) * 4]
    assert {task.scene.resolution[0] for task in tasks("pixels")} == set(growth.PIXELS)
    assert {len(task.scene.lights) for task in tasks("lights")} == set(growth.LIGHTS)
    # Masks are textures: none of the layers folds away.
    assert {len(task.scene.shaders[0].textures) for task in tasks("layers")} == {0, 1, 3, 7}
    assert len({task.scene.shaders[0].digest for task in tasks("looks")}) == 1 + max(growth.LOOK_COUNTS)
    counts = tasks("triangles")
    triangles = sorted({triangle_count(read_asset(task.scene.asset.path)) for task in counts})
    assert triangles == [triangle_count(make_boulder(n)) for n in (1000, 4000)]
    # TurntableFrames are taken: after the warm-up, one of each size, three times.
    sizes = [task.scene.asset for task in counts]
    assert sizes == 4 * sizes[:2]


def test_the_looks_differ_in_more_than_colours() -> None:
    looks = [varied_look(number) for number in range(32)]
    assert len({repr(look.layers[0].inputs) for look in looks}) == 32
    for backend in ("principled", "mitsuba-principled"):
        assert all(BACKENDS[backend].look_gap(look) is None for look in looks)


@pytest.mark.usefixtures("small")
def test_a_quantity_that_fails_is_named_and_the_others_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*arguments: object) -> Iterator[GrowthRow]:
        raise RenderError("no lamp")
        yield

    monkeypatch.setitem(growth.QUANTITIES, "lights", growth.Quantity("lights", fails))
    table = measure_growth(processes(), "exact")
    assert table.failures == ["growth with lights: no lamp"]
    assert {result.quantity for result in table.growth} == set(growth.QUANTITIES) - {"lights"}
