"""Mitsuba's worker without enough memory, without a GPU, and interrupted."""

import ctypes
import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import batches
import numpy as np
import pytest
from frames import POSE
from looks import LOOKS
from mitsuba_scenes import scene_with_look
from painted import painted

from lookdev.cache import Content
from lookdev.errors import RenderError
from lookdev.material import Layer
from lookdev.rendering import wire
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.llvm import check_device
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import FrameTask, frame_task
from lookdev.run.render import render_job
from lookdev.scene import Sampling

pytestmark = pytest.mark.mitsuba


def task_of(light: Any, layers: tuple[Layer, ...] = LOOKS["diffuse"], **sampling: Any) -> FrameTask:
    scene = scene_with_look("suzanne", layers, light, size=16)
    return frame_task(scene_task(scene, Sampling(**{"samples": 32, "bounces": 1} | sampling), "mitsuba"), POSE, "frame")


def start_worker(**pipes: int) -> subprocess.Popen[str]:
    """Start a worker that ignores SIGINT, as a shell starts background processes."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE} | pipes
    process = subprocess.Popen(BACKENDS["mitsuba"].command, **pipes, text=True, start_new_session=True)
    signal.signal(signal.SIGINT, before)
    return process


def ask(process: subprocess.Popen[str], task: FrameTask, answer: str) -> None:
    """Send a task, and wait for an answer."""
    assert process.stdin
    assert process.stdout
    print(wire.encode_task(task), file=process.stdin, flush=True)
    while answer not in (line := process.stdout.readline()):
        assert line, "the worker died"


def test_launches_shrink_where_memory_ends_until_nothing_is_left(drjit: Any, light_of: Any) -> None:
    """The frame does not change; where one pixel is too much, the error says what would be right."""
    from lookdev.mitsuba.load import load_mitsuba
    from lookdev.mitsuba.render import MitsubaScene

    task = task_of(light_of("city"))
    scene = MitsubaScene(load_mitsuba("cpu"), task.scene)
    whole = scene.render(task, lambda *progress: None)
    all_pixels, widths = scene._render_pixels, []

    def limited_to(limit: int) -> Callable[..., Any]:
        def pixels(view: Any, rectangle: Any, lane: Any, *numbers: Any) -> Any:
            widths.append(drjit.width(lane))
            if drjit.width(lane) > limit:
                raise RuntimeError("record(): see above") from RuntimeError("jit_malloc(): out of memory! 9 bytes")
            return all_pixels(view, rectangle, lane, *numbers)

        return pixels

    scene._render_pixels = limited_to(64)
    limited = scene.render(task, lambda *progress: None)
    assert max(widths) > 64
    np.testing.assert_array_equal(limited.a, whole.a)
    np.testing.assert_array_equal(limited.b, whole.b)
    scene._render_pixels = limited_to(0)
    with pytest.raises(RenderError, match="out of memory, even with the 16 samples of a single pixel"):
        scene.render(task, lambda *progress: None)

    scene._render_pixels = Mock(side_effect=RuntimeError("something else"))
    with pytest.raises(RuntimeError, match="something else"):
        scene.render(task, lambda *progress: None)


def test_a_missing_gpu_is_named_before_rendering(monkeypatch: pytest.MonkeyPatch, llvm: str, tmp_path: Path) -> None:
    check_device("cpu")

    monkeypatch.setattr(ctypes, "CDLL", Mock(side_effect=OSError("none")))
    with pytest.raises(RenderError, match=r'device = "cuda": no driver of an NVIDIA GPU .* device = "cpu" would be'):
        check_device("cuda")
    empty = SimpleNamespace(cuInit=lambda flags: 0, cuDeviceGetCount=lambda count: 0)
    monkeypatch.setattr(ctypes, "CDLL", lambda name: empty)
    with pytest.raises(RenderError, match="the driver finds no NVIDIA GPU here"):
        check_device("cuda")
    job = batches.write_job(tmp_path, render='{ backend = "mitsuba", device = "cuda" }')
    with pytest.raises(RenderError, match=r'device = "cuda": the driver finds no NVIDIA GPU .* = "cpu" would be'):
        render_job(job)
    assert not list((tmp_path / "out").rglob("*.exr"))


@pytest.mark.both_pythons
def test_the_worker_ends_at_once_in_the_middle_of_a_frame(llvm: str, light_of: Any) -> None:
    """Ctrl-C reaches the worker too: it ignores the signal, and ends with its input."""
    with start_worker() as process:
        ask(process, task_of(light_of("city"), samples=1 << 22), '"progress"')
        before = time.perf_counter()
        process.send_signal(signal.SIGINT)
        process.stdin.close()
        process.wait(timeout=60.0)
        # A launch takes .2 s on an idle machine.
        assert time.perf_counter() - before < 5.0


@pytest.mark.both_pythons
def test_an_interrupted_worker_ends_and_reports_no_leaks(llvm: str, light_of: Any, tmp_path: Path) -> None:
    """Its input is open. Objects that it froze have types of OpenImageIO, which nanobind could report as leaked."""
    good = task_of(light_of("city"), layers=painted(tmp_path), samples=4)
    bad = replace(good, digest="bad", scene=replace(good.scene, asset=Content("none", ".npz")))
    with start_worker(stderr=subprocess.PIPE) as process:
        for task, answer in ((good, '"done"'), (bad, '"failed"'), (good, '"done"')):
            ask(process, task, answer)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60.0) == 1
        output = process.stderr.read()
    assert "KeyboardInterrupt" in output
    assert "leaked" not in output
