"""Runs of a batch by a fake worker: frames are rendered, tried again and made again, and a killed run is resumed."""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import batch_case as case
import numpy as np
import OpenImageIO as oiio
import pytest

import lookdev
from lookdev.errors import AssetError, JobError, OutputError, WorkerError
from lookdev.output.exr import read_frame, read_header, read_layer
from lookdev.rendering.worker import Worker
from lookdev.run.events import Event, FrameDone, FrameFailed, FrameRetried, Noted, RunJoined, RunStarted, SheetWritten
from lookdev.run.render import background_light, render_job
from lookdev.run.runs import Run

RenderFile = Callable[..., Any]
FRAMES = ["element.0001", "element.0002", "element.0003", "element.0004", "lighting.0002", "lighting.0003"]
FILES = sorted([*FRAMES, "lighting.0001"])
SHEETS = ["element.sheet", "lighting.sheet"]


def frames_folder(folder: Path) -> Path:
    return folder / "out" / "gold" / "city"


def names(folder: Path, suffix: str) -> list[str]:
    return sorted(path.name.removesuffix(suffix) for path in frames_folder(folder).glob("*" + suffix))


def pixels(path: Path) -> np.ndarray:
    return oiio.ImageBuf(str(path)).get_pixels(oiio.UINT8)


def pictures(folder: Path) -> dict[str, bytes]:
    return {path.stem: path.read_bytes() for path in frames_folder(folder).glob("*.png")}


def of_kind(kind: type[Event], events: list[Event]) -> list[Any]:
    return [event for event in events if isinstance(event, kind)]


def test_a_batch_from_nothing_to_sheets(tmp_path: Path) -> None:
    events: list[Event] = []
    result = case.run(tmp_path, report=events.append)
    assert (result.total, result.done, result.rendered, result.exit_code) == (6, 6, 6, 0)
    assert case.requests(tmp_path) == [f"{name}.exr" for name in FRAMES]
    folder = frames_folder(tmp_path)
    assert names(tmp_path, ".exr") == FILES
    assert names(tmp_path, ".png") == sorted([*FILES, *SHEETS])
    assert not list(folder.glob(".*"))
    assert {path.name for path in (tmp_path / "out" / ".lookdev").iterdir()} == {"pictures.json", "worker.log"}
    beauty, alpha = read_frame(folder / "element.0001.exr")
    assert (beauty == 0.25).all()  # (0.25 + 0.75) / 2, one stop down
    assert (alpha == 0.5).all()
    # 0.25 + (1 - 0.5) (0.5, 0.25, 0) in the Raw view
    assert pixels(folder / "element.0001.png")[0, 0].tolist() == [128, 96, 64]
    assert (folder / "element.0001.exr").samefile(folder / "lighting.0001.exr")
    assert of_kind(RunStarted, events) == [RunStarted(total=6, pending=6)]
    assert [event.name for event in of_kind(FrameDone, events)] == [f"gold/city/{name}" for name in FRAMES]
    assert [event.path.name for event in of_kind(SheetWritten, events)] == [f"{name}.png" for name in SHEETS]


def test_a_frame_has_its_origin_and_the_error_of_its_pixels_exposed_as_they_are(finished_once: Path) -> None:
    task = case.make_plan(case.make_job(finished_once)).frames[1].task
    header = read_header(task.files[0])
    assert task.labels.items() <= header.items()
    assert header["digest"] == task.digest
    assert (header["samples"], header["seconds"], header["relmse"]) == ("8", "0.125", "0.01")
    assert header["version.blender"] == "4.5.0 fake"
    assert header["version.lookdev"] == lookdev.__version__
    assert header["version.numpy"] == np.__version__
    assert header["version.python"].startswith(f"{sys.version_info[0]}.{sys.version_info[1]}.")
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", header["time"])
    error = read_layer(task.files[0], "error")
    assert error is not None
    np.testing.assert_array_equal(error, np.float32(0.125))  # the error of 0.25 and 0.75, one stop down
    assert read_layer(task.files[0], "raw") is None


def test_a_second_run_does_nothing_unless_all_is_rendered_again_by_force(finished: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in frames_folder(finished).iterdir()}
    events: list[Event] = []
    result = case.run(finished, report=events.append)
    assert (result.done, result.rendered, result.exit_code) == (6, 0, 0)
    assert (len(case.requests(finished)), len(case.worker_pids(finished))) == (6, 1)
    assert of_kind(RunStarted, events) == [RunStarted(total=6, pending=0)]
    assert [type(event) for event in events] == [RunJoined, RunStarted]
    assert {path: path.stat().st_mtime_ns for path in frames_folder(finished).iterdir()} == before
    sheet = frames_folder(finished) / "element.sheet.png"
    inode = sheet.stat().st_ino
    assert case.run(finished, force=True).rendered == 6
    assert len(case.requests(finished)) == 12
    assert sheet.stat().st_ino != inode


def altered(distance_from_end: int) -> Callable[[bytes], bytes]:
    def alter(content: bytes) -> bytes:
        index = len(content) - distance_from_end
        return content[:index] + bytes([content[index] ^ 1]) + content[index + 1 :]

    return alter


def cut(size: int) -> Callable[[bytes], bytes]:
    return lambda content: content[:size]


PICTURES = ("element.0001.png", "element.sheet.png")


@pytest.mark.parametrize(
    ("name", "harm"),
    [
        ("lighting.0002.exr", None),
        ("element.0003.exr", cut(-20)),
        *(("element.0003.exr", altered(distance)) for distance in (1, 30, 300)),
        ("lighting.0001.png", None),
        ("element.sheet.png", None),
        *((name, harm) for name in PICTURES for harm in (cut(0), cut(100), altered(20))),
    ],
)
def test_what_is_lost_or_damaged_is_made_again_and_no_other_frame(
    finished: Path, name: str, harm: Callable[[bytes], bytes] | None
) -> None:
    file = frames_folder(finished) / name
    whole, frame, before = file.read_bytes(), file.suffix == ".exr", pictures(finished)
    file.unlink() if harm is None else file.write_bytes(harm(whole))
    events: list[Event] = []
    assert case.run(finished, report=events.append).rendered == frame
    assert case.requests(finished)[6:] == [name] * frame
    assert pictures(finished) == before
    if frame:
        assert (read_frame(file)[0] == 0.25).all()
        assert of_kind(Noted, events) == [Noted(f"{file}: was damaged, and is made again")] * (harm is not None)
        sheet = f"{name.partition('.')[0]}.sheet.png"
        assert [event.path.name for event in of_kind(SheetWritten, events)] == [sheet]


def test_a_turntable_added_later_shares_what_is_done(tmp_path: Path) -> None:
    case.run(tmp_path, case.make_job(tmp_path, '[[turntable]]\nkind = "element"\nframes = 4\n'))
    result = case.run(tmp_path)
    assert (result.done, result.rendered) == (6, 2)
    assert case.requests(tmp_path)[4:] == ["lighting.0002.exr", "lighting.0003.exr"]
    assert names(tmp_path, ".exr") == FILES
    assert (frames_folder(tmp_path) / "lighting.0001.png").exists()


@pytest.mark.parametrize(
    ("old", "new", "changed"),
    [
        ('"Raw"', '"ACES 1.0 - SDR Video"', {*FILES, *SHEETS}),
        ('"Raw"', '"Raw"\nviews = { sheet = "lookdev" }', {*SHEETS}),
        ("[0.5, 0.25, 0.0]", "[0.0, 0.25, 0.5]", {*FILES, *SHEETS}),
    ],
)
def test_another_view_or_background_makes_pictures_again_without_rendering(
    finished: Path, old: str, new: str, changed: set[str]
) -> None:
    before = pictures(finished)
    case.run(finished, case.make_job(finished, render=case.RENDER.replace(old, new)))
    after = pictures(finished)
    assert {name for name in before if after[name] != before[name]} == changed
    case.run(finished)
    assert pictures(finished) == before
    assert len(case.requests(finished)) == 6


def test_fewer_frames_that_are_all_done_make_a_new_sheet(finished: Path) -> None:
    sheet = frames_folder(finished) / "element.sheet.png"
    before = pixels(sheet).shape
    assert case.run(finished, case.make_job(finished, '[[turntable]]\nkind = "element"\nframes = 1\n')).rendered == 0
    assert pixels(sheet).shape[1] < before[1]


def test_pictures_only_if_the_job_has_them(tmp_path: Path) -> None:
    job = case.make_job(tmp_path, render=case.RENDER + "png = false\nsheet = false\n")
    case.run(tmp_path, job)
    case.run(tmp_path, job)
    assert names(tmp_path, ".png") == []
    assert names(tmp_path, ".exr") == FILES


def test_a_full_disk_does_not_make_a_finished_frame_pending(finished: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (frames_folder(finished) / "element.0003.png").unlink()

    def write_pixels(path: Path, pixels: object) -> None:
        raise OutputError(f"{path}: cannot write the picture: No space left on device")

    monkeypatch.setattr("lookdev.output.record.write_pixels", write_pixels)
    with pytest.raises(OutputError, match=r"element\.0003\.png: .*No space left"):
        case.run(finished)
    assert len(case.requests(finished)) == 6


def test_a_worker_that_cannot_write_ends_the_batch(tmp_path: Path) -> None:
    case.misbehave(tmp_path, element_0003=["full"])
    with pytest.raises(OutputError, match="/out: No space left on device"):
        case.run(tmp_path)
    assert case.requests(tmp_path) == ["element.0001.exr", "element.0002.exr", "element.0003.exr"]
    assert names(tmp_path, ".exr") == ["element.0001", "element.0002", "lighting.0001"]


@pytest.mark.both_pythons
def test_a_frame_whose_worker_crashes_or_hangs_is_retried_and_the_batch_completes(tmp_path: Path) -> None:
    case.misbehave(tmp_path, element_0002=["die", "garbage", "ok"], element_0003=["hang", "ok"])
    events: list[Event] = []
    result = case.run(tmp_path, timeout=1.0, report=events.append)
    assert (result.done, result.exit_code) == (6, 0)
    assert case.requests(tmp_path).count("element.0002.exr") == 3
    assert len(case.worker_pids(tmp_path)) == 4
    *retries, hung = of_kind(FrameRetried, events)
    assert [(event.attempt, event.attempts) for event in retries] == [(2, 3), (3, 3)]
    assert "SIGKILL" in retries[0].reason
    assert "silent for 1 s" in hung.reason


@pytest.mark.parametrize(
    ("behaviour", "tries", "reason"), [("exit", 3, "exit code 3"), ("failed", 2, "no such attribute 'st2'")]
)
def test_a_frame_that_always_fails_is_listed_and_the_rest_goes_on(
    tmp_path: Path, behaviour: str, tries: int, reason: str
) -> None:
    case.misbehave(tmp_path, element_0002=[behaviour])
    events: list[Event] = []
    result = case.run(tmp_path, report=events.append)
    assert (result.done, result.rendered, result.exit_code) == (5, 5, 1)
    assert case.requests(tmp_path).count("element.0002.exr") == tries
    log = tmp_path / "out" / ".lookdev" / "worker.log"
    assert all(part in result.summary() for part in (reason, "gold/city/element.0002", str(log)))
    assert log.read_text().count("the last line of the fake") == (3 if behaviour == "exit" else 0)  # of every start
    assert [event.name for event in of_kind(FrameFailed, events)] == ["gold/city/element.0002"]
    assert names(tmp_path, ".sheet.png") == ["lighting"]
    (tmp_path / "behaviour.json").unlink()
    assert case.run(tmp_path).rendered == 1
    assert names(tmp_path, ".sheet.png") == ["element", "lighting"]


def test_a_worker_that_never_starts_ends_the_batch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = "open('starts', 'a').write('x'); raise ImportError('libXrender.so.1: cannot open')"
    job = case.make_job(tmp_path)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(WorkerError, match=r"ImportError: libXrender\.so\.1.* 3 times .*lookdev doctor"):
        case.run(tmp_path, job, worker_command=(sys.executable, "-c", program))
    assert (tmp_path / "starts").read_text() == "xxx"


def start_batch(folder: Path) -> subprocess.Popen[str]:
    program = (sys.executable, str(Path(case.__file__)), str(folder))
    return subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_for_the_third(process: subprocess.Popen[str], folder: Path) -> None:
    """Wait until the third frame is being rendered, and the batch has reported the second."""
    assert process.stdout is not None
    while "element.0002" not in process.stdout.readline():
        assert process.poll() is None
    case.wait_until(lambda: "element.0003.exr" in case.requests(folder))


@pytest.mark.both_pythons
def test_ctrl_c_keeps_what_is_done_and_reports_how_to_continue(tmp_path: Path) -> None:
    case.misbehave(tmp_path, element_0003=["hang", "ok"])
    with start_batch(tmp_path) as process:
        wait_for_the_third(process, tmp_path)
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=20)
    assert (process.returncode, errors) == (130, "")
    assert "2 of 6 frames are done" in output
    assert "run the same command again to continue" in output
    assert not any(map(case.is_alive, case.worker_pids(tmp_path)))
    result = case.run(tmp_path)
    assert (result.done, result.rendered) == (6, 4)


@pytest.mark.both_pythons
def test_a_killed_batch_takes_its_worker_along_and_resumes(tmp_path: Path) -> None:
    case.misbehave(tmp_path, element_0003=["hang", "ok"])
    with start_batch(tmp_path) as process:
        wait_for_the_third(process, tmp_path)
        process.kill()
        process.communicate(timeout=20)
    case.wait_until(lambda: not any(map(case.is_alive, case.worker_pids(tmp_path))))
    leftover, foreign = (frames_folder(tmp_path) / name for name in (".element.0003.4711-0123abcd.exr", ".keep"))
    leftover.write_bytes(b"half a frame")
    foreign.touch()
    result = case.run(tmp_path)
    assert (result.done, result.rendered, result.exit_code) == (6, 4, 0)
    assert sorted(case.requests(tmp_path)) == sorted([f"{name}.exr" for name in [*FRAMES, "element.0003"]])
    assert not leftover.exists()
    assert foreign.exists()
    assert not list((tmp_path / "out" / ".lookdev").glob("scratch-*"))


def test_a_run_of_another_version_of_the_job_is_refused(tmp_path: Path, render_file: RenderFile) -> None:
    with Run(tmp_path / "out") as run:
        run.announce_plan("another plan")
        with pytest.raises(OutputError, match=f"process {os.getpid()} on .* another version of this job"):
            render_file()
    assert render_file().exit_code == 0


@pytest.mark.both_pythons
@pytest.mark.parametrize("fails", [False, True])
def test_the_worker_starts_while_the_job_is_prepared(tmp_path: Path, render_file: RenderFile, fails: bool) -> None:
    def wait_for_the_worker() -> None:
        case.wait_until(lambda: len(case.worker_pids(tmp_path)) == 1)
        if fails:
            raise AssetError("damaged")

    with pytest.raises(AssetError, match="damaged") if fails else nullcontext():
        assert render_file(wait_for_the_worker).exit_code == 0
    (pid,) = case.worker_pids(tmp_path)
    case.wait_until(lambda: not case.is_alive(pid))
    assert not list((tmp_path / "out" / ".lookdev").glob("scratch-*"))


def test_nothing_that_reads_files_is_imported_before_the_worker_starts() -> None:
    late = "{'pxr', 'scipy', 'lookdev.plan.prepare'}"
    code = f"import sys, lookdev.run.render, lookdev.run.progress; print(sorted({late} & sys.modules.keys()))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


@pytest.mark.parametrize(("force", "missing", "starts"), [(False, False, 0), (True, False, 1), (False, True, 1)])
def test_the_worker_starts_early_only_where_a_frame_is_missing(
    finished: Path, render_file: RenderFile, monkeypatch: pytest.MonkeyPatch, force: bool, missing: bool, starts: int
) -> None:
    if missing:
        (frames_folder(finished) / f"{FILES[-1]}.exr").unlink()
    launched, launch = [], Worker.launch
    monkeypatch.setattr(Worker, "launch", lambda worker: (launched.append(worker), launch(worker)))
    started: list[int] = []
    assert render_file(lambda: started.append(len(launched)), force=force).exit_code == 0
    assert started == [starts]
    assert bool(launched) == bool(starts)


def test_render_job_reports_faults_before_it_makes_anything(tmp_path: Path) -> None:
    (tmp_path / "job.toml").write_text("outputt = 1")
    with pytest.raises(JobError):
        render_job(tmp_path / "job.toml")
    assert [path.name for path in tmp_path.iterdir()] == ["job.toml"]


def test_pictures_lie_over_the_given_background_and_a_doubtful_frame_is_kept_and_noted(tmp_path: Path) -> None:
    behind = np.zeros((case.HEIGHT, case.WIDTH, 3))
    behind[0] = 1.0
    case.misbehave(tmp_path, element_0003=["empty"])
    events: list[Event] = []
    assert case.run(tmp_path, render_background=lambda task: behind, report=events.append).exit_code == 0
    assert background_light("black")(case.make_plan(case.make_job(tmp_path)).frames[0].task).tolist() == [0, 0, 0]
    picture = pixels(frames_folder(tmp_path) / "element.0002.png")
    assert (picture[0] == 191).all()  # 0.25 + 0.5 * 1
    assert (picture[1:] == 64).all()  # 0.25
    assert [event.text for event in of_kind(Noted, events)] == [
        "gold/city/element.0003: is empty: no part of the asset is in the picture"
    ]


def test_an_output_that_cannot_be_written_is_an_output_error(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "gold").write_text("a file where a folder should be")
    with pytest.raises(OutputError, match="gold"):
        case.run(tmp_path)


def test_a_broken_pipe_of_the_report_is_not_an_output_error(tmp_path: Path) -> None:
    def report(event: object) -> None:
        raise BrokenPipeError

    with pytest.raises(BrokenPipeError):
        case.run(tmp_path, report=report)
