"""A batch of the real program: every backend by the command line, resuming, and robustness against kills."""

import os
import signal
from dataclasses import replace
from pathlib import Path

import batches
import numpy as np
import pytest
from batch_case import is_alive, wait_until

from lookdev.cli import app
from lookdev.output.exr import read_frame, read_header
from lookdev.plan.prepare import prepare_job
from lookdev.rendering.backends import job_backends
from lookdev.run.render import render_job, run_plan

pytestmark = pytest.mark.cycles

# Frames that take some tenths of a second, so that a kill hits the batch in the middle.
LONG = {
    "turntable": '[{ kind = "element", frames = 12 }, { kind = "lighting", frames = 2 }]',
    "look": '[{ name = "red", material = "red.usda" }]',
    "render": "{ resolution = [80, 80], samples = 64, bounces = 0 }",
}


@pytest.mark.usefixtures("warm")
def test_a_batch_is_rendered_once_and_again_only_where_a_look_changed(tmp_path: Path, capfd) -> None:
    job = batches.write_job(tmp_path)
    app(["render", str(job)], standalone_mode=False)
    assert "6 of 6 frames are done, 6 of them rendered now." in capfd.readouterr().out
    first = batches.files(job)
    expected = {f"{look}/studio/{kind}.{n:04d}.exr" for look in ("red", "blue") for kind in ("element", "lighting")
                for n in (1, 2)}  # fmt: skip
    assert first.keys() == expected
    assert batches.leftovers(job) == []
    for look in ("red", "blue"):  # the pose that both turntables show is one file under two names
        assert first[f"{look}/studio/element.0001.exr"] == first[f"{look}/studio/lighting.0001.exr"]
        assert (tmp_path / f"out/{look}/studio/element.sheet.png").exists()
        assert (tmp_path / f"out/{look}/studio/lighting.0002.png").exists()

    header = read_header(tmp_path / "out/red/studio/lighting.0002.exr")
    assert header["job"] == str(job)
    assert (header["look"], header["ibl"], header["asset"]) == ("red", "studio", "suzanne")
    assert (header["pose.element"], header["pose.lighting"], header["exposure"]) == ("0.0", "180.0", "-1.0")
    assert header["samples"] == "4"
    assert 0.0 < float(header["relmse"]) < 1.0
    assert 0.0 < float(header["seconds"]) < 60.0
    assert {"digest", "time", "version.blender", "version.lookdev", "version.python", "version.numpy"} <= header.keys()

    assert render_job(job).rendered == 0
    assert batches.files(job) == first

    batches.write_look(tmp_path, "blue", (0.1, 0.7, 0.1))
    result = render_job(job)
    assert (result.done, result.rendered) == (6, 3)
    second = batches.files(job)
    changed = {name for name in first if first[name] != second[name]}
    assert changed == {name for name in first if name.startswith("blue/")}
    beauty, _ = read_frame(tmp_path / "out/blue/studio/element.0002.exr")
    red, green, blue = beauty.mean(axis=(0, 1))
    assert green > 3.0 * max(red, blue)


@pytest.mark.both_pythons
@pytest.mark.usefixtures("warm")
@pytest.mark.parametrize(
    "backend", [pytest.param(name, marks=[pytest.mark.mitsuba] * (name == "mitsuba")) for name in job_backends()]
)
def test_the_command_line_renders_a_job_with_each_backend(backend: str, tmp_path: Path) -> None:
    render = f'{{ backend = "{backend}", resolution = [16, 16], samples = 64, bounces = 0 }}'
    job = batches.write_job(tmp_path, turntable='[{ kind = "element", frames = 1 }]', render=render)
    app(["render", str(job)], standalone_mode=False)
    beauties = [read_frame(tmp_path / f"out/{look}/studio/element.0001.exr")[0] for look in ("red", "blue")]
    red, blue = (beauty.mean(axis=(0, 1)) for beauty in beauties)
    # Of the looks' reflectances, 0.7 and 0.1. A relMSE of 5e-4 is 2.2 % of a pixel, which no mean exceeds.
    np.testing.assert_allclose(red / blue, (7.0, 1.0, 1 / 7), rtol=0.03)
    assert 0.05 < red[0] < 0.5


@pytest.mark.usefixtures("warm")
@pytest.mark.both_pythons
def test_a_batch_goes_on_after_a_kill_of_its_worker_and_ctrl_c(tmp_path: Path) -> None:
    """A kill of the batch itself is in tests/batch, and of its Blender with it in tests/cli."""
    job = batches.write_job(tmp_path, **LONG)
    batch = batches.start(job)
    wait_until(lambda: len(batches.files(job)) >= 1)
    first = batches.worker_of(batch)
    os.kill(first, signal.SIGKILL)
    killed = batches.files(job)
    wait_until(lambda: len(batches.files(job)) >= len(killed) + 2)
    worker = batches.worker_of(batch)
    assert worker != first
    os.kill(batch.pid, signal.SIGINT)
    output = batches.finish(batch, 130, retries=1)
    assert output.count("the render worker died of SIGKILL") == 1
    assert "Interrupted; run the same command again to continue." in output
    assert "Traceback" not in output
    assert not is_alive(worker)
    assert batches.leftovers(job) == []
    interrupted = batches.files(job)
    assert len(interrupted) < 14

    result = render_job(job)
    assert (result.exit_code, result.done) == (0, 13)
    assert result.rendered < 13 - len(interrupted) / 2
    done = batches.files(job)
    assert len(done) == 14
    # Only a second name of a frame may be new: its file is the one that was there.
    assert {name: done[name] for name in interrupted} == interrupted
    assert {name: interrupted[name] for name in killed} == killed
    assert batches.leftovers(job) == []


@pytest.mark.usefixtures("warm")
def test_frames_that_blender_cannot_render_are_listed_and_the_others_are_done(tmp_path: Path) -> None:
    prepared = prepare_job(batches.write_job(tmp_path, turntable='[{ kind = "element", frames = 2 }]'))
    frames = []
    for frame in prepared.plan.frames:
        task = frame.task
        if task.labels["look"] == "red":
            shader = replace(task.scene.shaders[0], osl="shader broken( {")
            task = replace(task, scene=replace(task.scene, shaders=(shader,)))
        frames.append(replace(frame, task=task))
    result = run_plan(replace(prepared.plan, frames=tuple(frames)), prepared.job.outputs)
    assert result.exit_code == 1
    assert {failure.name for failure in result.failures} == {"red/studio/element.0001", "red/studio/element.0002"}
    assert all("RenderError" in failure.reason for failure in result.failures)
    assert (result.done, result.rendered) == (2, 2)
    again = run_plan(prepare_job(prepared.job.file).plan, prepared.job.outputs)
    assert (again.exit_code, again.done, again.rendered) == (0, 4, 2)
