"""A batch with the real worker: its files, resuming, and robustness against kills."""

from __future__ import annotations

import os
import signal
from dataclasses import replace
from pathlib import Path

import batches
import pytest
from batch_case import is_alive, wait_until

from lookdev.batch.prepare import prepare_job
from lookdev.batch.run import run_plan
from lookdev.output.exr import read_frame, read_header

pytestmark = pytest.mark.cycles

# Frames that take some tenths of a second, so that a kill hits the batch in the middle.
LONG = {"frames": 4, "size": 80, "samples": 64}


def test_a_batch_is_rendered_once_and_again_only_where_a_look_changed(tmp_path: Path) -> None:
    job = batches.write_job(tmp_path, light="studio")
    assert "6 of 6 frames are done, 6 of them rendered now." in batches.render(job)
    first = batches.frames(job)
    expected = {f"{look}/studio/{kind}.{n:04d}.exr" for look in ("red", "blue") for kind in ("element", "lighting")
                for n in (1, 2)}  # fmt: skip
    assert first.keys() == expected
    assert batches.leftovers(job) == []
    for look in ("red", "blue"):  # the pose that both turntables show is one file under two names
        assert first[f"{look}/studio/element.0001.exr"] == first[f"{look}/studio/lighting.0001.exr"]
        assert (tmp_path / f"out/{look}/studio/element.sheet.png").exists()
        assert (tmp_path / f"out/{look}/studio/lighting.0002.png").exists()

    header = read_header(tmp_path / "out/red/studio/lighting.0002.exr")
    assert header is not None
    assert header["job"] == str(job)
    assert (header["look"], header["ibl"], header["asset"]) == ("red", "studio", "suzanne")
    assert (header["pose.element"], header["pose.lighting"], header["exposure"]) == ("0.0", "180.0", "-1.0")
    assert header["samples"] == "4"
    assert 0.0 < float(header["relmse"]) < 1.0
    assert 0.0 < float(header["seconds"]) < 60.0
    assert {"digest", "time", "version.blender", "version.lookdev", "version.python", "version.numpy"} <= header.keys()

    assert "0 of them rendered now" in batches.render(job)
    assert batches.frames(job) == first

    batches.write_look(tmp_path, "blue", "0.1, 0.7, 0.1")
    assert "6 of 6 frames are done, 3 of them rendered now." in batches.render(job)
    second = batches.frames(job)
    changed = {name for name in first if first[name] != second[name]}
    assert changed == {name for name in first if name.startswith("blue/")}
    beauty, _ = read_frame(tmp_path / "out/blue/studio/element.0002.exr")
    red, green, blue = beauty.mean(axis=(0, 1))
    assert green > 3.0 * max(red, blue)


def test_a_worker_killed_in_a_frame_costs_a_retry(tmp_path: Path) -> None:
    job = batches.write_job(tmp_path, **LONG)
    batch = batches.start(job)
    wait_until(lambda: batches.frames(job))
    os.kill(batches.worker_of(batch), signal.SIGKILL)
    output = batches.finish(batch, 0, retries=1)
    assert output.count("the render worker died of SIGKILL") == 1
    assert "8 of 8 frames are done, 8 of them rendered now." in output
    assert batches.leftovers(job) == []


def test_a_killed_batch_leaves_no_worker_and_goes_on_where_it_stopped(tmp_path: Path) -> None:
    job = batches.write_job(tmp_path, **LONG)
    batch = batches.start(job)
    wait_until(lambda: len(batches.frames(job)) >= 4)
    worker = batches.worker_of(batch)
    batch.kill()
    batches.finish(batch, -signal.SIGKILL)
    wait_until(lambda: not is_alive(worker), seconds=5.0)
    before = batches.frames(job)
    assert len(before) < 12

    output = batches.render(job)
    after = batches.frames(job)
    assert "8 of 8 frames are done" in output
    assert "8 of them rendered now" not in output
    assert len(after) == 12
    # Only a second name of a frame may be new: its file is the one that was there.
    assert {name: after[name] for name in before} == before
    assert batches.leftovers(job) == []


def test_ctrl_c_ends_a_batch_tidily(tmp_path: Path) -> None:
    # So many frames that a busy machine is not done when the signal arrives.
    job = batches.write_job(tmp_path, **LONG | {"frames": 20})
    batch = batches.start(job)
    wait_until(lambda: batches.frames(job))
    worker = batches.worker_of(batch)
    os.kill(batch.pid, signal.SIGINT)
    output = batches.finish(batch, 130)
    assert "Interrupted; run the same command again to continue." in output
    assert "Traceback" not in output
    assert not is_alive(worker)
    assert batches.leftovers(job) == []
    assert 0 < len(prepare_job(job).plan.pending()) < 40


def test_frames_that_blender_cannot_render_are_listed_and_the_others_are_done(tmp_path: Path) -> None:
    prepared = prepare_job(batches.write_job(tmp_path))
    frames = []
    for frame in prepared.plan.frames:
        task = frame.task
        if task.labels["look"] == "red":
            shader = replace(task.scene.shaders[0], osl="shader broken( {")
            task = replace(task, scene=replace(task.scene, shaders=(shader,)))
        frames.append(replace(frame, task=task))
    result = run_plan(replace(prepared.plan, frames=tuple(frames)), prepared.job.outputs)
    assert result.exit_code == 1
    assert {failure.name for failure in result.failures} == {"red/white/element.0001", "red/white/element.0002"}
    assert all("RenderError" in failure.reason for failure in result.failures)
    assert (result.done, result.rendered) == (2, 2)
    again = run_plan(prepare_job(prepared.job.file).plan, prepared.job.outputs)
    assert (again.exit_code, again.done, again.rendered) == (0, 4, 2)
