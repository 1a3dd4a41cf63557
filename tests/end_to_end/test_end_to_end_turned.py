"""Turns of an asset or a light that is the same all around: one frame with many names, which shows each pose."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import batches
import pytest
from stage import difference

from lookdev.batch.prepare import prepare_job
from lookdev.render.task import FrameTask
from lookdev.render.worker import renderer
from lookdev.scene import Pose

pytestmark = [pytest.mark.cycles, pytest.mark.proof]

JOB = """
output = "out"
asset = { builtin = "sphere" }
look = [{ name = "red", material = "red.usda" }]
ibl = [{ name = "city", builtin = "city", rotation = 40 }]
turntable = [{ kind = "element", frames = 5 }]
render = { resolution = [64, 64], samples = 1024 }
"""


@pytest.fixture
def job(tmp_path: Path) -> Path:
    """Return a job of a plain sphere, five poses 72 degrees apart."""
    batches.write_look(tmp_path, "red", "0.7, 0.1, 0.1")
    look = tmp_path / "red.usda"
    metal = look.read_text().replace("roughness = 1", "roughness = 0.4").replace("specular = 0", "metallic = 1")
    look.write_text(metal)
    path = tmp_path / "job.toml"
    path.write_text(JOB)
    return path


def differences(task: FrameTask, same: list[Pose], other: Pose) -> tuple[list[float], float]:
    """Return the differences of a task's frame from those of poses with the same picture, and of one other."""
    with renderer() as render:
        shown, *others = (render(replace(task, pose=pose, digest=str(pose))) for pose in (task.pose, *same, other))
    *ratios, wrong = (difference(shown, each) for each in others)
    return ratios, wrong


def test_five_poses_are_one_frame_of_five_files(job: Path) -> None:
    plan = prepare_job(job).plan
    assert [str(skip) for skip in plan.skips][-1] == "4 of 5 frames (same all around)"
    (task,) = plan.pending()
    assert task.files == tuple(job.parent / f"out/red/city/element.000{number}.exr" for number in range(1, 6))
    assert "1 of 1 frames are done, 1 of them rendered now." in batches.render(job)
    assert len(set(batches.frames(job).values())) == 1
    assert len(batches.frames(job)) == 5
    assert "1 of 1 frames are done, 0 of them rendered now." in batches.render(job)
    (job.parent / "out/red/city/element.0003.exr").unlink()
    assert "1 of 1 frames are done, 0 of them rendered now." in batches.render(job)
    assert len(set(batches.frames(job).values())) == 1
    assert len(batches.frames(job)) == 5


def test_every_pose_has_that_picture(job: Path) -> None:
    (task,) = prepare_job(job).plan.pending()
    assert task.pose == Pose(0.0, 40.0)
    ratios, wrong = differences(task, [Pose(72.0 * number, 40.0) for number in range(1, 5)], Pose(72.0, 41.0))
    # 1 would be noise. Relative to the camera, asset and light are the same, and the directions drawn from the light:
    # most of the noise is. Directions drawn from a BSDF that reads no tangent start from any one.
    assert max(ratios) < 0.3, ratios
    assert wrong > 5.0, wrong


def test_a_white_light_that_turns_is_one_frame(tmp_path: Path) -> None:
    batches.write_look(tmp_path, "red", "0.7, 0.1, 0.1")
    path = tmp_path / "job.toml"
    path.write_text(
        JOB.replace('"sphere"', '"suzanne"').replace('"city"', '"white"').replace('"element"', '"lighting"')
    )
    plan = prepare_job(path).plan
    assert [str(skip) for skip in plan.skips][-1] == "4 of 5 frames (constant light)"
    (task,) = plan.pending()
    assert task.pose == Pose(0.0, 0.0)
    assert [file.name for file in task.files] == [f"lighting.000{number}.exr" for number in range(1, 6)]
    ratios, wrong = differences(task, [Pose(0.0, 40.0 + 72.0 * number) for number in range(3)], Pose(1.0, 0.0))
    # Relative to the camera the samples are the same, and their light too, but for its interpolation in float32.
    assert max(ratios) < 1e-9, ratios
    assert wrong > 0.3, wrong
