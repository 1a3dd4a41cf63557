"""The real worker: progress, log, errors and temporary files."""

import os
import subprocess
from pathlib import Path

import pytest
from stage import Stage

from lookdev.asset import Asset
from lookdev.asset.builtin import make_sphere
from lookdev.errors import OutputError
from lookdev.light import load_environment
from lookdev.material import Layer, Look
from lookdev.rendering.backends import WORKER_COMMAND
from lookdev.rendering.results import ProgressMessage, WorkerFrame
from lookdev.scene import Camera

pytestmark = pytest.mark.cycles

LOOK = Look("grey", (Layer("Grey", "disney", {"roughness": 1.0, "specular": 0.0}),))
CAMERA = Camera(fov=40.0, elevation=20.0, target=(0.0, 0.0, 0.0), distance=3.5)


@pytest.fixture(scope="module")
def ball() -> Asset:
    return make_sphere(segments=32, rings=16)


def render(stage: Stage, ball: Asset, reported: list[ProgressMessage], samples: int = 16) -> WorkerFrame:
    light = load_environment(builtin="white")
    return stage.render(ball, LOOK, light, CAMERA, samples=samples, progress=reported.append)


def test_progress_is_reported_within_the_halves_too(stage: Stage, ball: Asset) -> None:
    reported: list[ProgressMessage] = []
    render(stage, ball, reported)
    samples = [progress.samples for progress in reported]
    assert samples == sorted(samples)
    assert {progress.of for progress in reported} == {16}
    assert {8, 16} < set(samples)
    assert any(0 < done < 8 for done in samples)
    assert [progress.relmse for progress in reported if progress.samples < 16] == [None] * (
        len(reported) - samples.count(16)
    )
    assert reported[-1].relmse is not None


def test_a_result_that_cannot_be_written_fails_the_frame_and_not_the_worker(
    stage: Stage, ball: Asset, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage.worker.start()
    scratch = stage.worker.log.parent
    aside = scratch.with_name("aside")
    scratch.rename(aside)
    monkeypatch.setattr(stage.worker, "log", aside / "worker.log")
    try:
        with pytest.raises(OutputError, match="a rendered frame cannot be written: No such file"):
            render(stage, ball, [])
    finally:
        aside.rename(scratch)
        monkeypatch.undo()

    # The log up to the fault is kept, what frames without one add is not, for ever.
    log = stage.worker.log
    kept = log.read_bytes()
    with log.open("ab") as stream:
        stream.write(b"chatter\n" * 2**18)
    assert render(stage, ball, []).samples == 16
    assert log.read_bytes() == kept


def test_a_self_test_leaves_no_temporary_files(tmp_path: Path) -> None:
    environment = os.environ | {"TMPDIR": str(tmp_path)}
    subprocess.run((*WORKER_COMMAND, "--self-test"), env=environment, capture_output=True, check=True)
    assert list(tmp_path.iterdir()) == []
