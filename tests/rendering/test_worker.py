import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from batch_case import command, is_alive, make_job, make_plan, misbehave, requests, wait_until, worker_pids

from lookdev.errors import RenderError, WorkerError
from lookdev.rendering.task import FrameTask, SceneTask
from lookdev.rendering.worker import Worker, last_line

pytestmark = pytest.mark.both_pythons

FRAME = "element_0001"


def ignore(progress: object) -> None:
    """Ignore the progress of a frame."""


@pytest.fixture
def task(tmp_path: Path) -> FrameTask:
    return make_plan(make_job(tmp_path)).frames[0].task


@pytest.fixture
def worker(tmp_path: Path) -> Iterator[Worker]:
    (tmp_path / "scratch").mkdir()
    with Worker(command(tmp_path), tmp_path / "worker.log", tmp_path / "scratch") as worker:
        yield worker


def test_a_frame_comes_back_with_its_progress(worker: Worker, task: FrameTask, tmp_path: Path) -> None:
    reported = []
    worker.start()
    rendered = worker.render(task, reported.append)
    assert (rendered.a == 0.25).all()
    assert (rendered.b == 0.75).all()
    assert (rendered.alpha.shape, rendered.a.dtype) == ((6, 8), np.float32)
    assert (rendered.samples, rendered.seconds, rendered.relmse) == (8, 0.125, 0.01)
    assert rendered.blender == "4.5.0 fake"
    assert [(progress.samples, progress.of, progress.relmse) for progress in reported] == [(4, 8, None), (8, 8, 0.01)]
    assert list((tmp_path / "scratch").iterdir()) == []


def test_a_launched_worker_is_started_once(worker: Worker, task: FrameTask, tmp_path: Path) -> None:
    for count in (1, 2):
        worker.launch()
        worker.launch()
        worker.start()
        worker.start()
        assert worker.render(task, ignore).blender == "4.5.0 fake"
        assert len(worker_pids(tmp_path)) == count
        worker.kill()


def test_a_worker_does_not_see_the_config_of_a_studio(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OCIO", "/nowhere/config.ocio")
    monkeypatch.setenv("OTHER", "kept")
    seen = tmp_path / "seen"
    program = f"import os; open({str(seen)!r}, 'w').write(str((os.environ.get('OCIO'), os.environ['OTHER'])))"
    with Worker((sys.executable, "-c", program), tmp_path / "worker.log", tmp_path) as worker:
        worker.launch()
        wait_until(lambda: seen.exists() and seen.read_text() == "(None, 'kept')")


def long_scene(task: FrameTask, size: int = 1 << 20) -> SceneTask:
    """Return the scene of a task with a shader of a given length, by default longer than a pipe's buffer."""
    (source,) = task.scene.shaders
    return replace(task.scene, shaders=(replace(source, osl=size * "x"),))


@pytest.mark.parametrize("size", [10, 1 << 20])
def test_a_scene_is_sent_ahead_of_its_frames_without_an_answer(
    worker: Worker, task: FrameTask, tmp_path: Path, size: int
) -> None:
    scene = long_scene(task, size)
    worker.prepare(scene)  # to nobody
    worker.launch()
    worker.prepare(scene)
    worker.prepare(scene)
    worker.start()
    worker.prepare(scene)  # too late
    assert (worker.render(task, ignore).a == 0.25).all()
    assert requests(tmp_path) == ["scene", "element.0001.exr"]


def test_a_worker_that_dies_before_it_reads_a_scene_is_reported_by_its_start(task: FrameTask, tmp_path: Path) -> None:
    with Worker((sys.executable, "-c", "raise SystemExit(3)"), tmp_path / "worker.log", tmp_path) as worker:
        worker.launch()
        worker.prepare(long_scene(task))
        with pytest.raises(WorkerError, match="exit code 3"):
            worker.start()


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("die", "died of SIGKILL"),
        ("exit", "exit code 3"),
        ("half", "exit code 0"),
        ("garbage", "invalid message: 'Fra:1 Mem"),
        ("flood", "invalid message: 'xxx"),
        ("ready", "answered 'ready' in the middle"),
        ("other", "answered for frame 000000000000"),
        ("missing", "result cannot be read.*nowhere.npz"),
        ("truncated", "cannot be read"),
        ("lack", "cannot be read.*alpha"),
        ("shape", r"'b' is \(5, 8, 3\), should be \(6, 8, 3\)"),
        ("nan", "'a' has pixels that are not finite"),
    ],
)
def test_a_misbehaving_worker_is_killed_and_can_start_again(
    worker: Worker, task: FrameTask, tmp_path: Path, fault: str, message: str
) -> None:
    misbehave(tmp_path, **{FRAME: [fault, "ok"]})
    worker.start()
    with pytest.raises(WorkerError, match=message):
        worker.render(task, ignore)
    assert not is_alive(worker_pids(tmp_path)[0])
    worker.start()
    assert worker.render(task, ignore).samples == 8


def test_a_silent_worker_is_killed_with_its_children(worker: Worker, task: FrameTask, tmp_path: Path) -> None:
    misbehave(tmp_path, **{FRAME: ["child"]})
    worker.start()
    worker._timeout = 1.0  # now: a start may take longer
    with pytest.raises(WorkerError, match="silent for 1 s"):
        worker.render(task, ignore)
    child = int((tmp_path / "child.txt").read_text())
    wait_until(lambda: not is_alive(child))


def test_a_worker_that_takes_no_request_is_killed(task: FrameTask, tmp_path: Path) -> None:
    deaf = 'import time; print(\'{"type": "ready", "blender": "4"}\', flush=True); time.sleep(60)'
    with Worker((sys.executable, "-c", deaf), tmp_path / "worker.log", tmp_path) as worker:
        worker.start()
        worker._timeout = 0.3
        with pytest.raises(WorkerError, match=r"silent for 0\.3 s"):
            worker.render(replace(task, scene=long_scene(task)), ignore)


def test_a_clean_failure_leaves_the_worker_alive(worker: Worker, task: FrameTask, tmp_path: Path) -> None:
    misbehave(tmp_path, **{FRAME: ["failed", "ok"]})
    with pytest.raises(WorkerError, match="start it first"):
        worker.render(task, ignore)
    worker.start()
    with pytest.raises(RenderError, match="no such attribute 'st2'"):
        worker.render(task, ignore)
    worker.render(task, ignore)
    assert (len(worker_pids(tmp_path)), len(requests(tmp_path))) == (1, 2)


def test_an_error_in_the_callers_progress_leaves_no_worker_behind(
    worker: Worker, task: FrameTask, tmp_path: Path
) -> None:
    worker.start()
    with pytest.raises(KeyboardInterrupt):
        worker.render(task, Mock(side_effect=KeyboardInterrupt))
    assert not is_alive(worker_pids(tmp_path)[0])


def test_a_worker_that_does_not_get_ready(tmp_path: Path) -> None:
    failed = 'print(\'{"type": "failed", "digest": "d", "message": "m"}\')'
    for program, message in (
        (("/nowhere/blender",), "/nowhere/blender cannot be started"),
        ((sys.executable, "-c", "import sys; sys.exit('libXi.so.6: cannot open')"), "exit code 1"),
        ((sys.executable, "-c", failed), "answered 'failed' before it was ready"),
    ):
        with Worker(program, tmp_path / "worker.log", tmp_path) as worker, pytest.raises(WorkerError, match=message):
            worker.start()


def test_last_words_are_the_last_line_with_text(tmp_path: Path) -> None:
    log = tmp_path / "worker.log"
    for content, line in ((b"Traceback\nImportError: \xff no\n\n", "ImportError: \ufffd no"), (b"", "")):
        log.write_bytes(content)
        assert last_line(log) == line
