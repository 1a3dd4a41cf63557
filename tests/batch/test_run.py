from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import batch_case as case
import numpy as np
import OpenImageIO as oiio
import pytest

import lookdev
from lookdev.batch.events import Event, FrameDone, FrameFailed, FrameRetried, Noted, RunStarted, SheetWritten
from lookdev.batch.run import background_light, render_job
from lookdev.batch.runs import Run
from lookdev.errors import AssetError, JobError, OutputError, WorkerError
from lookdev.job import Job
from lookdev.output.exr import read_frame, read_header, read_layer
from lookdev.render.backends import BACKENDS
from lookdev.render.worker import Worker

FRAMES = ["element.0001", "element.0002", "element.0003", "element.0004", "lighting.0002", "lighting.0003"]
FILES = sorted([*FRAMES, "lighting.0001"])


def place(folder: Path) -> Path:
    return folder / "out" / "gold" / "city"


def names(folder: Path, suffix: str) -> list[str]:
    return sorted(path.name.removesuffix(suffix) for path in place(folder).glob("*" + suffix))


def pixels(path: Path) -> np.ndarray:
    return oiio.ImageBuf(str(path)).get_pixels(oiio.UINT8)


def of(kind: type[Event], events: list[Event]) -> list[Any]:
    return [event for event in events if isinstance(event, kind)]


def test_a_batch_from_nothing_to_sheets(tmp_path: Path) -> None:
    events: list[Event] = []
    result = case.run(tmp_path, report=events.append)
    assert (result.total, result.done, result.rendered, result.exit_code) == (6, 6, 6, 0)
    assert case.requests(tmp_path) == [f"{name}.exr" for name in FRAMES]
    assert names(tmp_path, ".exr") == FILES
    assert names(tmp_path, ".png") == sorted([*FILES, "element.sheet", "lighting.sheet"])
    assert not list(place(tmp_path).glob(".*"))
    state = {path.name for path in (tmp_path / "out" / ".lookdev").iterdir()}
    assert state == {"pictures.json", "worker.log"}

    beauty, alpha = read_frame(place(tmp_path) / "element.0001.exr")
    assert (beauty == 0.25).all()  # (0.25 + 0.75) / 2, one stop down
    assert (alpha == 0.5).all()
    # 0.25 + (1 - 0.5) (0.5, 0.25, 0) in the Raw view
    assert pixels(place(tmp_path) / "element.0001.png")[0, 0].tolist() == [128, 96, 64]
    same = [place(tmp_path) / f"{name}.0001.exr" for name in ("element", "lighting")]
    assert same[0].samefile(same[1])

    assert events[0] == RunStarted(total=6, pending=6)
    assert [event.name for event in of(FrameDone, events)] == [f"gold/city/{n}" for n in FRAMES]
    assert [event.path.name for event in of(SheetWritten, events)] == ["element.sheet.png", "lighting.sheet.png"]


def test_the_header_has_the_origin_of_a_frame(tmp_path: Path) -> None:
    case.run(tmp_path)
    task = case.make_plan(case.make_job(tmp_path)).frames[1].task
    header = read_header(task.files[0])
    assert task.labels.items() <= header.items()
    assert header["digest"] == task.digest
    assert (header["samples"], header["seconds"], header["relmse"]) == ("8", "0.125", "0.01")
    assert header["version.blender"] == "4.5.0 fake"
    assert header["version.lookdev"] == lookdev.__version__
    assert header["version.numpy"] == np.__version__
    assert header["version.python"].startswith(f"{sys.version_info[0]}.{sys.version_info[1]}.")
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", header["time"])


def test_a_second_run_does_nothing(tmp_path: Path) -> None:
    case.run(tmp_path)
    before = {path: path.stat().st_mtime_ns for path in place(tmp_path).iterdir()}
    events: list[Event] = []
    result = case.run(tmp_path, report=events.append)
    assert (result.done, result.rendered, result.exit_code) == (6, 0, 0)
    assert len(case.requests(tmp_path)) == 6
    assert len(case.worker_pids(tmp_path)) == 1
    assert events == [RunStarted(total=6, pending=0)]
    assert {path: path.stat().st_mtime_ns for path in place(tmp_path).iterdir()} == before


def test_force_renders_everything_again(tmp_path: Path) -> None:
    case.run(tmp_path)
    sheet = (place(tmp_path) / "element.sheet.png").stat()
    assert case.run(tmp_path, force=True).rendered == 6
    assert len(case.requests(tmp_path)) == 12
    assert (place(tmp_path) / "element.sheet.png").stat().st_ino != sheet.st_ino


def test_a_lost_frame_alone_is_rendered_again_and_its_sheet_remade(tmp_path: Path) -> None:
    case.run(tmp_path)
    (place(tmp_path) / "lighting.0002.exr").unlink()
    events: list[Event] = []
    assert case.run(tmp_path, report=events.append).rendered == 1
    assert [event.path.name for event in of(SheetWritten, events)] == ["lighting.sheet.png"]


def test_a_turntable_added_later_shares_what_is_done(tmp_path: Path) -> None:
    element = '[[turntable]]\nkind = "element"\nframes = 4\n'
    job = case.make_job(tmp_path, element)
    case.run(tmp_path, job)
    result = case.run(tmp_path)
    assert (result.done, result.rendered) == (6, 2)
    assert case.requests(tmp_path)[4:] == ["lighting.0002.exr", "lighting.0003.exr"]
    assert names(tmp_path, ".exr") == FILES
    assert (place(tmp_path) / "lighting.0001.png").exists()


def test_lost_pictures_are_made_without_rendering(tmp_path: Path) -> None:
    case.run(tmp_path)
    png, sheet = place(tmp_path) / "lighting.0001.png", place(tmp_path) / "element.sheet.png"
    before = pixels(png), pixels(sheet)
    png.unlink()
    sheet.unlink()
    case.run(tmp_path)
    assert len(case.requests(tmp_path)) == 6
    assert (pixels(png) == before[0]).all()
    assert (pixels(sheet) == before[1]).all()


@pytest.mark.parametrize(("old", "new"), [("Raw", "ACES 1.0 - SDR Video"), ("[0.5, 0.25, 0.0]", "[0.0, 0.25, 0.5]")])
def test_another_view_or_background_remakes_pictures_and_sheets_without_rendering(
    tmp_path: Path, old: str, new: str
) -> None:
    case.run(tmp_path)
    paths = sorted(place(tmp_path).glob("*.png"))
    before = [pixels(path) for path in paths]
    job = case.make_job(tmp_path, render=case.RENDER.replace(old, new))
    case.run(tmp_path, job)
    assert len(case.requests(tmp_path)) == 6
    assert all((pixels(path) != seen).any() for path, seen in zip(paths, before, strict=True))


def test_fewer_frames_that_are_all_done_make_a_new_sheet(tmp_path: Path) -> None:
    case.run(tmp_path)
    job = case.make_job(tmp_path, '[[turntable]]\nkind = "element"\nframes = 1\n')
    sheet = place(tmp_path) / "element.sheet.png"
    before = pixels(sheet).shape
    case.run(tmp_path, job)
    assert len(case.requests(tmp_path)) == 6
    assert pixels(sheet).shape[1] < before[1]


def test_pictures_only_if_the_job_has_them(tmp_path: Path) -> None:
    job = case.make_job(tmp_path, render=case.RENDER + "png = false\nsheet = false\n")
    case.run(tmp_path, job)
    case.run(tmp_path, job)
    assert names(tmp_path, ".png") == []
    assert names(tmp_path, ".exr") == FILES


def test_a_frame_cut_short_on_disk_is_rendered_again(tmp_path: Path) -> None:
    case.run(tmp_path)
    frame = place(tmp_path) / "element.0003.exr"
    os.truncate(frame, frame.stat().st_size - 20)
    frame.with_suffix(".png").unlink()
    assert case.run(tmp_path).rendered == 1
    read_frame(frame)


@pytest.mark.parametrize("place_from_end", [1, 30, 300])
def test_an_altered_frame_is_rendered_again_with_a_note(tmp_path: Path, place_from_end: int) -> None:
    case.run(tmp_path)
    frame = place(tmp_path) / "element.0003.exr"
    content = bytearray(frame.read_bytes())
    content[-place_from_end] ^= 1
    frame.write_bytes(content)
    events: list[Event] = []
    assert case.run(tmp_path, report=events.append).rendered == 1
    assert events[0] == Noted(f"{frame}: was damaged, and is made again")
    read_frame(frame)


def test_an_altered_picture_is_made_again_without_rendering(tmp_path: Path) -> None:
    case.run(tmp_path)
    for name in ("element.0003.png", "element.sheet.png"):
        picture = place(tmp_path) / name
        whole = picture.read_bytes()
        picture.write_bytes(whole[:-20] + bytes([whole[-20] ^ 1]) + whole[-19:])
        assert case.run(tmp_path).rendered == 0
        assert picture.read_bytes() == whole


def test_a_full_disk_does_not_make_a_finished_frame_pending(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case.run(tmp_path)
    (place(tmp_path) / "element.0003.png").unlink()

    def write_pixels(path: Path, pixels: object) -> None:
        raise OutputError(f"{path}: cannot write the picture: No space left on device")

    monkeypatch.setattr("lookdev.output.record.write_pixels", write_pixels)
    with pytest.raises(OutputError, match=r"element\.0003\.png: .*No space left"):
        case.run(tmp_path)
    assert len(case.requests(tmp_path)) == 6


def test_a_worker_that_cannot_write_ends_the_batch(tmp_path: Path) -> None:
    case.misbehave(tmp_path, element_0003=["full"])
    with pytest.raises(OutputError, match="/out: No space left on device"):
        case.run(tmp_path)
    assert case.requests(tmp_path) == ["element.0001.exr", "element.0002.exr", "element.0003.exr"]
    assert names(tmp_path, ".exr") == ["element.0001", "element.0002", "lighting.0001"]


def test_a_crashed_frame_is_retried_and_the_batch_completes(tmp_path: Path) -> None:
    case.misbehave(tmp_path, element_0002=["die", "garbage", "ok"])
    events: list[Event] = []
    result = case.run(tmp_path, report=events.append)
    assert (result.done, result.exit_code) == (6, 0)
    assert case.requests(tmp_path).count("element.0002.exr") == 3
    assert len(case.worker_pids(tmp_path)) == 3
    retries = of(FrameRetried, events)
    assert [(event.attempt, event.attempts) for event in retries] == [(2, 3), (3, 3)]
    assert "SIGKILL" in retries[0].reason


def test_a_hung_frame_is_retried(tmp_path: Path) -> None:
    case.misbehave(tmp_path, element_0002=["hang", "ok"])
    events: list[Event] = []
    assert case.run(tmp_path, patience=3.0, report=events.append).exit_code == 0
    assert ["silent for 3 s" in event.reason for event in of(FrameRetried, events)] == [True]


@pytest.mark.parametrize(
    ("what", "tries", "reason"), [("exit", 3, "exit code 3"), ("failed", 2, "no such attribute 'st2'")]
)
def test_a_frame_that_always_fails_is_listed_and_the_rest_goes_on(
    tmp_path: Path, what: str, tries: int, reason: str
) -> None:
    case.misbehave(tmp_path, element_0002=[what])
    events: list[Event] = []
    result = case.run(tmp_path, report=events.append)
    assert (result.done, result.rendered, result.exit_code) == (5, 5, 1)
    assert case.requests(tmp_path).count("element.0002.exr") == tries
    assert reason in result.summary()
    assert "gold/city/element.0002" in result.summary()
    assert str(tmp_path / "out" / ".lookdev" / "worker.log") in result.summary()
    assert [event.name for event in of(FrameFailed, events)] == ["gold/city/element.0002"]
    assert names(tmp_path, ".sheet.png") == ["lighting"]

    (tmp_path / "behaviour.json").unlink()
    assert case.run(tmp_path).rendered == 1
    assert names(tmp_path, ".sheet.png") == ["element", "lighting"]


def test_the_worker_log_keeps_the_output_of_every_start(tmp_path: Path) -> None:
    case.misbehave(tmp_path, element_0002=["exit"])
    case.run(tmp_path)
    assert (tmp_path / "out/.lookdev/worker.log").read_text().count("the last line of the fake") == 3


def test_a_worker_that_never_starts_ends_the_batch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = "open('starts', 'a').write('x'); raise ImportError('libXrender.so.1: cannot open')"
    job = case.make_job(tmp_path)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(WorkerError, match=r"ImportError: libXrender\.so\.1.* 3 times .*lookdev doctor"):
        case.run(tmp_path, job, worker_command=(sys.executable, "-c", program))
    assert (tmp_path / "starts").read_text() == "xxx"


def wait_for_the_third(folder: Path) -> None:
    """Wait until the third frame is being rendered, and the second is written, as is what comes after it."""
    case.wait_until(lambda: "element.0003.exr" in case.requests(folder))
    case.wait_until(lambda: (place(folder) / "element.0002.png").exists())
    time.sleep(0.2)


def batch(folder: Path) -> subprocess.Popen[str]:
    program = (sys.executable, str(Path(case.__file__)), str(folder))
    return subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_ctrl_c_keeps_what_is_done_and_reports_how_to_continue(tmp_path: Path) -> None:
    case.misbehave(tmp_path, element_0003=["hang", "ok"])
    with batch(tmp_path) as process:
        wait_for_the_third(tmp_path)
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=20)
    assert (process.returncode, errors) == (130, "")
    assert "2 of 6 frames are done" in output
    assert "run the same command again to continue" in output
    assert not any(map(case.is_alive, case.worker_pids(tmp_path)))
    result = case.run(tmp_path)
    assert (result.done, result.rendered) == (6, 4)


def test_a_killed_batch_takes_its_worker_along_and_resumes(tmp_path: Path) -> None:
    case.misbehave(tmp_path, element_0003=["hang", "ok"])
    with batch(tmp_path) as process:
        wait_for_the_third(tmp_path)
        process.kill()
        process.communicate(timeout=20)
    case.wait_until(lambda: not any(map(case.is_alive, case.worker_pids(tmp_path))))
    leftover = place(tmp_path) / ".element.0003.4711-0123abcd.exr"
    leftover.write_bytes(b"half a frame")
    own = place(tmp_path) / ".keep"
    own.touch()
    result = case.run(tmp_path)
    assert (result.done, result.rendered, result.exit_code) == (6, 4, 0)
    assert sorted(case.requests(tmp_path)) == sorted([f"{name}.exr" for name in [*FRAMES, "element.0003"]])
    assert not leftover.exists()
    assert own.exists()
    assert not list((tmp_path / "out" / ".lookdev").glob("scratch-*"))


def test_a_batch_killed_again_and_again_completes(tmp_path: Path) -> None:
    case.misbehave(tmp_path, **{name.replace(".", "_"): ["slow"] for name in FRAMES})
    kills = 0
    while True:
        with batch(tmp_path) as process:
            try:
                # Later and later, so that kills fall into start, rendering and writing, and it ends at last.
                output, errors = process.communicate(timeout=0.5 + 0.13 * kills)
                break
            except subprocess.TimeoutExpired:
                process.kill()
                kills += 1
    assert (process.returncode, errors) == (0, "")
    assert "6 of 6 frames are done" in output
    assert kills > 0
    assert len(case.requests(tmp_path)) <= len(FRAMES) + kills
    for name in FILES:
        assert (read_frame(place(tmp_path) / f"{name}.exr")[0] == 0.25).all()
    assert names(tmp_path, ".png") == sorted([*FILES, "element.sheet", "lighting.sheet"])
    assert not list(place(tmp_path).glob(".*"))
    assert case.run(tmp_path).rendered == 0


def test_a_run_of_another_version_of_the_job_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given = case.make_job(tmp_path)
    (tmp_path / "job.toml").write_text(case.JOB + case.TURNTABLES)
    monkeypatch.setitem(BACKENDS, "exact", replace(BACKENDS["exact"], command=case.command(tmp_path)))

    def prepare(job: Job, ahead: object) -> Any:
        return SimpleNamespace(job=job, notes=(), plan=case.make_plan(job))

    with Run(given.output) as run:
        run.renders("another plan")
        with pytest.raises(OutputError, match=f"process {os.getpid()} on .* another version of this job"):
            render_job(tmp_path / "job.toml", prepare=prepare)
    assert render_job(tmp_path / "job.toml", prepare=prepare).exit_code == 0


@pytest.mark.parametrize("fails", [False, True])
def test_the_worker_starts_while_the_job_is_prepared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fails: bool
) -> None:
    case.make_job(tmp_path)
    (tmp_path / "job.toml").write_text(case.JOB + case.TURNTABLES)
    record = replace(BACKENDS["exact"], command=case.command(tmp_path))
    monkeypatch.setitem(BACKENDS, "exact", record)

    def prepare(job: Job, ahead: object) -> Any:
        case.wait_until(lambda: len(case.worker_pids(tmp_path)) == 1)
        if fails:
            raise AssetError("damaged")
        return SimpleNamespace(job=job, notes=(), plan=case.make_plan(job))

    if fails:
        with pytest.raises(AssetError, match="damaged"):
            render_job(tmp_path / "job.toml", prepare=prepare)
    else:
        assert render_job(tmp_path / "job.toml", prepare=prepare).exit_code == 0
    (pid,) = case.worker_pids(tmp_path)
    case.wait_until(lambda: not case.is_alive(pid))
    assert not list((tmp_path / "out" / ".lookdev").glob("scratch-*"))


def test_nothing_that_reads_files_is_imported_before_the_worker_starts() -> None:
    late = "{'pxr', 'scipy', 'lookdev.batch.prepare'}"
    code = f"import sys, lookdev.batch.run, lookdev.batch.progress; print(sorted({late} & sys.modules.keys()))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


@pytest.mark.parametrize(("force", "missing", "starts"), [(False, False, 0), (True, False, 1), (False, True, 1)])
def test_the_worker_starts_early_only_where_a_frame_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, force: bool, missing: bool, starts: int
) -> None:
    (tmp_path / "job.toml").write_text(case.JOB + case.TURNTABLES + case.RENDER)
    case.run(tmp_path)
    if missing:
        (place(tmp_path) / f"{FILES[-1]}.exr").unlink()
    launched, launch = [], Worker.launch
    monkeypatch.setattr(Worker, "launch", lambda worker: (launched.append(worker), launch(worker)))
    monkeypatch.setitem(BACKENDS, "exact", replace(BACKENDS["exact"], command=case.command(tmp_path)))

    def prepare(job: Job, ahead: object) -> Any:
        assert len(launched) == starts
        return SimpleNamespace(job=job, notes=(), plan=case.make_plan(job))

    assert render_job(tmp_path / "job.toml", prepare=prepare, force=force).exit_code == 0
    assert bool(launched) == bool(starts)


def test_render_job_reports_faults_before_it_makes_anything(tmp_path: Path) -> None:
    (tmp_path / "job.toml").write_text("outputt = 1")
    with pytest.raises(JobError):
        render_job(tmp_path / "job.toml")
    assert [path.name for path in tmp_path.iterdir()] == ["job.toml"]


@pytest.mark.parametrize(("value", "color"), [('"black"', [0, 0, 0]), ("[0.5, 0.25, 0.0]", [0.5, 0.25, 0])])
def test_the_background_is_that_of_the_job(tmp_path: Path, value: str, color: list[float]) -> None:
    job = case.make_job(tmp_path, render=f"[render]\nbackground = {value}\n")
    task = case.make_plan(job).frames[0].task
    assert background_light(job.render.background)(task).tolist() == color


def test_pictures_lie_over_the_given_background(tmp_path: Path) -> None:
    behind = np.zeros((case.HEIGHT, case.WIDTH, 3))
    behind[0] = 1.0
    case.run(tmp_path, behind=lambda task: behind)
    shown = pixels(place(tmp_path) / "element.0002.png")
    assert (shown[0] == 191).all()  # 0.25 + 0.5 * 1
    assert (shown[1:] == 64).all()  # 0.25


def test_an_output_that_cannot_be_written_is_an_output_error(tmp_path: Path) -> None:
    job = case.make_job(tmp_path)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "gold").write_text("a file where a folder should be")
    with pytest.raises(OutputError, match="gold"):
        case.run(tmp_path, job)


def test_a_broken_pipe_of_the_report_is_not_an_output_error(tmp_path: Path) -> None:
    def report(event: object) -> None:
        raise BrokenPipeError

    with pytest.raises(BrokenPipeError):
        case.run(tmp_path, report=report)


def test_a_doubtful_frame_is_kept_and_noted(tmp_path: Path) -> None:
    case.misbehave(tmp_path, element_0002=["empty"])
    events: list[Event] = []
    result = case.run(tmp_path, report=events.append)
    assert result.exit_code == 0
    assert [each.text for each in of(Noted, events)] == [
        "gold/city/element.0002: is empty: no part of the asset is in the picture"
    ]


def test_a_frame_has_the_error_of_its_pixels_exposed_as_they_are(tmp_path: Path) -> None:
    case.run(tmp_path)
    frame = tmp_path / "out" / "gold" / "city" / "element.0001.exr"
    beauty, _ = read_frame(frame)
    np.testing.assert_array_equal(beauty, np.float32(0.25))  # the mean of 0.25 and 0.75, a stop darker
    error = read_layer(frame, "error")
    assert error is not None
    np.testing.assert_array_equal(error, np.float32(0.125))
    assert read_layer(frame, "raw") is None
