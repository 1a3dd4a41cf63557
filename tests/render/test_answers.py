"""Answers of a worker that renders nothing and prints text, as the parent reads them."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lookdev.errors import OutputError, RenderError
from lookdev.render.answers import save_arrays
from lookdev.render.results import Progress
from lookdev.render.task import SceneTask, one_frame
from lookdev.render.worker import Worker
from lookdev.scene import Pose

# Frames with an exposure fail; others allocate and free 300 MB.
WORKER = """
import os, sys
import numpy as np
from lookdev.errors import OutputError, RenderError
from lookdev.render.answers import Answers, save_arrays
from lookdev.render.wire import decode

answers = Answers()
print("chatter of Python", flush=True)
os.write(1, b"chatter of C\\n")
answers.ready("none 1.0")
for line in sys.stdin:
    task = decode(line)
    if task.exposure:
        answers.failed(task.digest, (RenderError if task.exposure < 0 else OutputError)("too dark"))
        continue
    answers.progress(task.digest, 2, 8, None)
    np.ones(300_000_000, np.uint8)
    image = np.arange(48 * 64 * 3, dtype=np.float32).reshape(48, 64, 3)
    arrays = save_arrays(image, 2 * image, image[..., 0])
    answers.done(task.digest, arrays, samples=8, seconds=0.5, relmse=float("nan"))
"""


def test_answers_are_read(scene: SceneTask, tmp_path: Path) -> None:
    task = one_frame(scene, Pose(0.0, 0.0), "d16e57")
    reported: list[Progress] = []
    log, scratch = tmp_path / "worker.log", tmp_path / "scratch"
    scratch.mkdir()
    with Worker((sys.executable, "-c", WORKER), log, scratch, 60.0) as worker:
        worker.start()
        for exposure, error, message in (
            (-1.0, RenderError, "^RenderError: too dark$"),
            (1.0, OutputError, "^too dark$"),
        ):
            with pytest.raises(error, match=message):
                worker.render(replace(task, exposure=exposure), reported.append)
        assert reported == []
        rendered = worker.render(task, reported.append)
    assert reported == [Progress(type="progress", digest="d16e57", samples=2, of=8, relmse=None)]
    image = np.arange(48 * 64 * 3, dtype=np.float32).reshape(48, 64, 3)
    for found, expected in ((rendered.a, image), (rendered.b, 2 * image), (rendered.alpha, image[..., 0])):
        np.testing.assert_array_equal(found, expected)
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
        save_arrays(image, image, image[..., 0])
