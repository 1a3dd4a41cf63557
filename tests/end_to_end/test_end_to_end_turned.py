"""Turns of an asset or a light that is the same all around: one frame with many names, which shows each pose."""

from dataclasses import replace
from pathlib import Path

import batches
import pytest
from stage import difference

from lookdev.batch.prepare import prepare_job
from lookdev.batch.run import render_job
from lookdev.render.task import FrameTask
from lookdev.render.worker import Worker
from lookdev.scene import Pose

pytestmark = [pytest.mark.cycles, pytest.mark.proof, pytest.mark.usefixtures("warm")]


def write_job(folder: Path, **keys: str) -> Path:
    """Write a job of a plain sphere, five poses 72 degrees apart."""
    given = {
        "asset": '{ builtin = "sphere" }',
        "look": '[{ name = "red", material = "red.usda" }]',
        "ibl": '[{ name = "city", builtin = "city", rotation = 40 }]',
        "turntable": '[{ kind = "element", frames = 5 }]',
        "render": "{ resolution = [64, 64], samples = 1024 }",
    }
    job = batches.write_job(folder, **given | keys)
    batches.write_look(folder, "red", (0.7, 0.1, 0.1), roughness=0.4, specular=0.5, metallic=1)
    return job


def differences(worker: Worker, task: FrameTask, same: list[Pose], other: Pose) -> tuple[list[float], float]:
    """Return the differences of a task's frame from those of poses with the same picture, and of one other."""
    worker.start()
    shown, *others = (
        worker.render(replace(task, pose=pose, digest=str(pose)), lambda progress: None)
        for pose in (task.pose, *same, other)
    )
    *ratios, wrong = (difference(shown, each) for each in others)
    return ratios, wrong


def test_five_poses_are_one_frame_of_five_files_with_the_picture_of_each(tmp_path: Path, cycles_worker: Worker) -> None:
    job = write_job(tmp_path)
    plan = prepare_job(job).plan
    assert [str(skip) for skip in plan.skips][-1] == "4 of 5 frames (same all around)"
    (task,) = plan.pending()
    assert task.files == tuple(tmp_path / f"out/red/city/element.000{number}.exr" for number in range(1, 6))
    for rendered in (1, 0, 0):
        result = render_job(job)
        assert (result.done, result.total, result.rendered) == (1, 1, rendered)
        assert len(set(batches.files(job).values())) == 1
        assert len(batches.files(job)) == 5
        (tmp_path / "out/red/city/element.0003.exr").unlink()
    assert task.pose == Pose(0.0, 40.0)
    poses = [Pose(72.0 * number, 40.0) for number in range(1, 5)]
    ratios, wrong = differences(cycles_worker, task, poses, Pose(72.0, 41.0))
    # 1 would be noise. Relative to the camera, asset and light are the same, and the directions drawn from the light:
    # most of the noise is. Directions drawn from a BSDF that reads no tangent start from any one.
    assert max(ratios) < 0.3, ratios
    assert wrong > 5.0, wrong


def test_a_white_light_that_turns_is_one_frame(tmp_path: Path, cycles_worker: Worker) -> None:
    job = write_job(
        tmp_path,
        asset='{ builtin = "suzanne" }',
        ibl='[{ name = "white", builtin = "white", rotation = 40 }]',
        turntable='[{ kind = "lighting", frames = 5 }]',
    )
    plan = prepare_job(job).plan
    assert [str(skip) for skip in plan.skips][-1] == "4 of 5 frames (constant light)"
    (task,) = plan.pending()
    assert task.pose == Pose(0.0, 0.0)
    assert [file.name for file in task.files] == [f"lighting.000{number}.exr" for number in range(1, 6)]
    poses = [Pose(0.0, 40.0 + 72.0 * number) for number in range(3)]
    ratios, wrong = differences(cycles_worker, task, poses, Pose(1.0, 0.0))
    # Relative to the camera the samples are the same, and their light too, but for its interpolation in float32.
    assert max(ratios) < 1e-9, ratios
    assert wrong > 0.3, wrong
