"""Tasks reach the worker with every bit, and answers come back, separate from other output."""

import _thread
import signal
import struct
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lookdev.codegen.source import NodeLink, NodeSource
from lookdev.errors import OutputError, RenderError, WorkerError
from lookdev.rendering.answers import save_arrays
from lookdev.rendering.results import ProgressMessage
from lookdev.rendering.task import FrameTask, SceneTask, frame_task
from lookdev.rendering.wire import FrameCancelled, TaskQueue, decode_frame_task, decode_task, encode_cancel, encode_task
from lookdev.rendering.worker import Worker
from lookdev.scene import Pose

# Frames with an exposure fail; others allocate and free 300 MB.
WORKER = """
import os, sys
import numpy as np
from lookdev.errors import OutputError, RenderError
from lookdev.rendering.answers import AnswerStream
from lookdev.rendering.frame import RenderedFrame
from lookdev.rendering.wire import decode_frame_task

answers = AnswerStream()
print("chatter of Python", flush=True)
os.write(1, b"chatter of C\\n")
answers.send_ready("none 1.0")
for line in sys.stdin:
    task = decode_frame_task(line)
    if task.exposure:
        answers.send_failure(task.digest, (RenderError if task.exposure < 0 else OutputError)("too dark"))
        continue
    answers.send_progress(task.digest, 2, 8, None)
    np.ones(300_000_000, np.uint8)
    image = np.arange(48 * 64 * 3, dtype=np.float32).reshape(48, 64, 3)
    answers.send_frame(task.digest, RenderedFrame(image, 2 * image, image[..., 0], 8, 0.5, float("nan")))
"""


@pytest.fixture
def task(scene: SceneTask) -> FrameTask:
    scene = replace(scene, sampling=replace(scene.sampling, error=1e-3))
    files = (Path("/out/a b.0001.exr"), Path("/out/\u00fc.0001.exr"))
    return FrameTask(scene, Pose(0.1, 359.99999999999994), -0.3, "d16e57", files, {"look": 'a "b"\n\u2028'})


def test_a_task_is_one_line_and_comes_back_equal(task: FrameTask) -> None:
    line = encode_task(task)
    assert {"\n", "\r"} & {*line} == set()
    assert decode_frame_task(line) == decode_frame_task(line + "\n") == task


def test_native_nodes_come_back_as_they_were(task: FrameTask, node_source: NodeSource) -> None:
    shaders = node_source, replace(node_source, digest="1")
    scene = replace(task.scene, backend="nodes", shaders=shaders, slot_shaders=(0, 1, 0))
    back = decode_frame_task(encode_task(replace(task, scene=scene))).scene
    assert back == scene
    for source in back.shaders:
        assert isinstance(source, NodeSource)
        mix = source.trees[0].nodes[-1]
        assert [type(mix.properties[name]) for name in ("clamp_factor", "clamp_result")] == [bool, bool]
        assert [type(mix.inputs[name]) for name in ("B_Color", "A_Color")] == [NodeLink, tuple]


def test_a_scene_is_told_from_a_frame(task: FrameTask) -> None:
    assert decode_task(encode_task(task)) == task
    assert decode_task(encode_task(task.scene)) == task.scene
    with pytest.raises(WorkerError, match="a scene task, not a frame task; this worker takes only frame tasks"):
        decode_frame_task(encode_task(task.scene))


def test_floats_survive_exactly(task: FrameTask) -> None:
    # Random bit patterns reach every exponent, subnormals too, and all 17 digits.
    bits = np.random.default_rng(7).integers(0, 2**64, 500, dtype=np.uint64)
    values = [value for value in bits.view(np.float64).tolist() if np.isfinite(value)]
    for value in [*values, 5e-324, 1.7976931348623157e308, -0.0]:
        back = decode_frame_task(encode_task(replace(task, exposure=value))).exposure
        assert struct.pack("d", back) == struct.pack("d", value)


@pytest.mark.parametrize("line", ["", "{}", "[1]", '{"scene": 3}', '{"scene": {"backend": "x", "shaders": []}}'])
def test_another_line_is_refused(line: str) -> None:
    with pytest.raises(WorkerError, match="frame task"):
        decode_frame_task(line)


def test_a_frame_that_is_cancelled_is_known_before_the_tasks_ahead_of_it(task: FrameTask) -> None:
    requests = TaskQueue()
    requests.read_lines([encode_task(task), encode_cancel("d16e57").decode()])
    with pytest.raises(FrameCancelled):
        requests.check_cancelled("d16e57")
    requests.check_cancelled("another")
    assert requests.next() == task


@pytest.mark.both_pythons
def test_a_signal_that_does_not_end_a_wait_is_seen_soon(task: FrameTask) -> None:
    """`interrupt_main` does not wake a wait, as a signal that arrives just before the wait."""
    requests = TaskQueue()
    late = threading.Timer(20.0, lambda: requests.read_lines([encode_task(task)]))
    soon = threading.Timer(0.2, _thread.interrupt_main)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        for timer in (late, soon):
            timer.start()
        with pytest.raises(KeyboardInterrupt):
            requests.next()
        assert late.is_alive(), "the next task ended the wait"
    finally:
        late.cancel()
        signal.signal(signal.SIGINT, before)


def test_answers_are_read(scene: SceneTask, tmp_path: Path) -> None:
    task = frame_task(scene, Pose(0.0, 0.0), "d16e57")
    reported: list[ProgressMessage] = []
    log, scratch = tmp_path / "worker.log", tmp_path / "scratch"
    scratch.mkdir()
    with Worker((sys.executable, "-c", WORKER), log, scratch, 60.0) as worker:
        worker.start()
        with pytest.raises(RenderError, match=r"^RenderError: too dark$"):
            worker.render(replace(task, exposure=-1.0), reported.append)
        with pytest.raises(OutputError, match=r"^too dark$"):
            worker.render(replace(task, exposure=1.0), reported.append)
        assert reported == []
        rendered = worker.render(task, reported.append)
    assert reported == [ProgressMessage(type="progress", digest="d16e57", samples=2, of=8, relmse=None)]
    image = np.arange(48 * 64 * 3, dtype=np.float32).reshape(48, 64, 3)
    for array, expected in ((rendered.a, image), (rendered.b, 2 * image), (rendered.alpha, image[..., 0])):
        np.testing.assert_array_equal(array, expected)
    assert (rendered.samples, rendered.seconds, rendered.blender) == (8, 0.5, "none 1.0")
    assert np.isnan(rendered.relmse)
    assert 300e6 < rendered.memory < 900e6
    # Each task that is sent is named in the log, here three.
    assert log.read_text().count("lookdev: frame d16e57") == 3
    chatter = [line for line in log.read_text().splitlines() if not line.startswith("lookdev: frame")]
    assert chatter == ["chatter of Python", "chatter of C"]
    assert list(scratch.iterdir()) == []


def test_arrays_that_cannot_be_written_are_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path / "none"))
    image = np.zeros((4, 4, 3), np.float32)
    with pytest.raises(OutputError, match="none: a rendered frame cannot be written: No such file or directory"):
        save_arrays({"a": image})
