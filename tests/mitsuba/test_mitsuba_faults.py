"""What Mitsuba's worker does where memory, a GPU or patience ends."""

from __future__ import annotations

import ctypes
import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from frames import POSE, orbit_camera
from looks import LOOKS
from painted import painted

from lookdev.asset import load_asset
from lookdev.batch.run import render_job
from lookdev.cache import Content
from lookdev.errors import RenderError
from lookdev.material import Layer, Look
from lookdev.render import wire
from lookdev.render.backends import BACKENDS
from lookdev.render.llvm import check_device
from lookdev.render.scene import scene_task
from lookdev.render.task import FrameTask, one_frame
from lookdev.scene import Film, Sampling, Scene

pytestmark = pytest.mark.mitsuba

MATERIALS = Path(__file__).parents[2] / "materials"


def task_of(light: Any, layers: tuple[Layer, ...] = LOOKS["coated"], **given: Any) -> FrameTask:
    asset = load_asset(builtin="suzanne")
    camera = orbit_camera(asset.center, asset.radius)
    scene = Scene(asset, {slot.path: Look("l", layers) for slot in asset.slots}, (light,), camera, Film((16, 16)))
    return one_frame(scene_task(scene, Sampling(**{"samples": 32, "bounces": 1} | given), "mitsuba"), POSE, "frame")


def test_launches_shrink_where_memory_ends_until_nothing_is_left(drjit: Any, light_of: Any) -> None:
    """The frame is the same; where not even one pixel fits, the error says what would be right."""
    from lookdev.mitsuba.load import load_mitsuba
    from lookdev.mitsuba.render import MitsubaScene

    task = task_of(light_of("city"))
    scene = MitsubaScene(load_mitsuba("cpu"), task.scene)
    whole = scene.render(task, lambda *progress: None)
    of_scene, widths = scene._pixels, []

    def within(most: int) -> Callable[..., Any]:
        def pixels(view: Any, place: Any, lane: Any, *numbers: Any) -> Any:
            widths.append(drjit.width(lane))
            if drjit.width(lane) > most:
                raise RuntimeError("record(): see above") from RuntimeError("jit_malloc(): out of memory! 9 bytes")
            return of_scene(view, place, lane, *numbers)

        return pixels

    scene._pixels = within(64)
    less = scene.render(task, lambda *progress: None)
    assert max(widths) > 64
    np.testing.assert_array_equal(less.a, whole.a)
    np.testing.assert_array_equal(less.b, whole.b)
    scene._pixels = within(0)
    with pytest.raises(RenderError, match="out of memory, even with the 16 samples of a single pixel"):
        scene.render(task, lambda *progress: None)

    def other(*arguments: Any) -> Any:
        raise RuntimeError("something else")

    scene._pixels = other
    with pytest.raises(RuntimeError, match="something else"):
        scene.render(task, lambda *progress: None)


def test_a_missing_gpu_is_named_before_rendering(monkeypatch: pytest.MonkeyPatch, llvm: str, tmp_path: Path) -> None:
    check_device("cpu")

    def none(name: str) -> Any:
        raise OSError(name)

    monkeypatch.setattr(ctypes, "CDLL", none)
    with pytest.raises(RenderError, match=r'device = "cuda": no driver of an NVIDIA GPU .* device = "cpu" would be'):
        check_device("cuda")
    empty = SimpleNamespace(cuInit=lambda flags: 0, cuDeviceGetCount=lambda count: 0)
    monkeypatch.setattr(ctypes, "CDLL", lambda name: empty)
    with pytest.raises(RenderError, match="the driver finds no NVIDIA GPU here"):
        check_device("cuda")
    job = tmp_path / "job.toml"
    job.write_text(
        f"""output = "out"
asset = {{ builtin = "sphere" }}
look = [{{ name = "paint", material = "{MATERIALS / "car_paint.usda"}" }}]
ibl = [{{ name = "city", builtin = "city" }}]
turntable = [{{ kind = "element", frames = 1 }}]
render = {{ backend = "mitsuba", device = "cuda" }}
"""
    )
    with pytest.raises(
        RenderError, match=r'device = "cuda": the driver finds no NVIDIA GPU .* device = "cpu" would be'
    ):
        render_job(job)
    assert not list((tmp_path / "out").rglob("*.exr"))


def test_the_worker_ends_at_once_in_the_middle_of_a_frame(llvm: str, light_of: Any) -> None:
    """As after Ctrl-C, which reaches it too: it leaves the rest to the end of its input."""
    task = task_of(light_of("city"), samples=1 << 22)
    with subprocess.Popen(
        BACKENDS["mitsuba"].command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        assert process.stdin
        assert process.stdout
        assert "ready" in process.stdout.readline()
        print(wire.encode(task), file=process.stdin, flush=True)
        while '"progress"' not in (line := process.stdout.readline()):
            assert line, "the worker died"
        started = time.perf_counter()
        process.send_signal(signal.SIGINT)
        process.stdin.close()
        process.wait(timeout=60.0)
        # A launch takes .2 s on an idle machine.
        assert time.perf_counter() - started < 5.0


def test_an_interrupted_worker_ends_and_reports_no_leaks(llvm: str, light_of: Any, tmp_path: Path) -> None:
    """With its input still open. What it keeps from collection has OpenImageIO's types, which nanobind would miss."""
    good = task_of(light_of("city"), layers=painted(tmp_path), samples=4)
    bad = replace(good, digest="bad", scene=replace(good.scene, asset=Content("none", ".npz")))
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # as a shell does for what it starts in the background
    started = subprocess.Popen(
        BACKENDS["mitsuba"].command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    signal.signal(signal.SIGINT, before)
    with started as process:
        assert process.stdin
        assert process.stdout
        assert process.stderr
        for task, end in ((good, '"done"'), (bad, '"failed"'), (good, '"done"')):
            print(wire.encode(task), file=process.stdin, flush=True)
            while end not in (line := process.stdout.readline()):
                assert line, "the worker died"
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60.0) == 1
        said = process.stderr.read()
    assert "KeyboardInterrupt" in said
    assert "leaked" not in said
