import threading
from collections.abc import Iterator
from pathlib import Path

import batch_case as case
import pytest

from lookdev.errors import LookdevError, WorkerError
from lookdev.rendering.executors.protocol import Finished, WorkerFiles
from lookdev.rendering.executors.warm import WarmExecutor, WarmServer, start, stop
from lookdev.rendering.task import FrameTask

pytestmark = pytest.mark.both_pythons


@pytest.fixture
def tasks(tmp_path: Path) -> list[FrameTask]:
    return [frame.task for frame in case.make_plan(case.make_job(tmp_path)).frames]


@pytest.fixture
def warm_socket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Serve a fake renderer at a socket, in a thread, until it is asked to stop or the socket is removed."""
    monkeypatch.setattr("lookdev.rendering.executors.warm._POLL", 0.05)
    (tmp_path / "scratch").mkdir()
    server = WarmServer(tmp_path / "s", case.command(tmp_path), 60.0, tmp_path / "scratch")
    thread = threading.Thread(target=server.serve, daemon=True)
    thread.start()
    case.wait_until(lambda: len(case.worker_pids(tmp_path)) == 1)
    yield tmp_path / "s"
    stop(tmp_path / "s")
    thread.join(20.0)
    assert not thread.is_alive()


def make_executor(path: Path, folder: Path, command: tuple[str, ...] | None = None) -> WarmExecutor:
    (folder / "scratch").mkdir(exist_ok=True)
    files = WorkerFiles(folder / "scratch", lambda name: folder / f"{name}.log", command or case.command(folder), 20.0)
    return WarmExecutor(files, path)


def finished(run: WarmExecutor, tasks: list[FrameTask]) -> list[Finished]:
    return [event for event in run.render(tasks, lambda task: True) if isinstance(event, Finished)]


def test_runs_share_one_renderer(warm_socket: Path, tmp_path: Path, tasks: list[FrameTask]) -> None:
    for task in tasks[:3]:
        with make_executor(warm_socket, tmp_path) as run:
            run.launch()
            run.prepare(task.scene)
            (frame,) = finished(run, [task])
        assert (frame.rendered.a == 0.25).all()
    assert case.requests(tmp_path) == [task.files[0].name for task in tasks[:3]]
    (pid,) = case.worker_pids(tmp_path)
    assert case.is_alive(pid)


def test_a_renderer_that_dies_or_owes_a_frame_is_replaced(
    warm_socket: Path, tmp_path: Path, tasks: list[FrameTask]
) -> None:
    case.misbehave(tmp_path, element_0001=["die", "ok"], element_0002=["hang", "ok"])
    with make_executor(warm_socket, tmp_path) as run:
        assert len(finished(run, tasks[:1])) == 1
    with make_executor(warm_socket, tmp_path) as run:
        next(iter(run.render(tasks[1:2], lambda task: True)))
        case.wait_until(lambda: "element.0002.exr" in case.requests(tmp_path))
    case.wait_until(lambda: len(case.worker_pids(tmp_path)) == 3)
    with make_executor(warm_socket, tmp_path) as run:
        assert len(finished(run, tasks[1:2])) == 1
    assert [case.is_alive(pid) for pid in case.worker_pids(tmp_path)] == [False, False, True]


def test_a_run_of_another_program_is_refused(warm_socket: Path, tmp_path: Path, tasks: list[FrameTask]) -> None:
    with (
        make_executor(warm_socket, tmp_path, ("other",)) as run,
        pytest.raises(WorkerError, match=r"is of another backend.*stop"),
    ):
        finished(run, tasks[:1])


def test_a_server_is_started_once_and_ends_when_asked(tmp_path: Path) -> None:
    at = tmp_path / "s"
    with pytest.raises(WorkerError, match=f"no worker is kept at {at}.*start one: lookdev warm start"):
        make_executor(at, tmp_path)
    assert not stop(at)
    start(at, "mitsuba-principled", idle=60)  # a renderer that starts soon, or not at all
    assert at.stat().st_mode & 0o077 == 0
    with pytest.raises(LookdevError, match="kept there already"):
        start(at, "exact")
    assert stop(at)
    assert not at.exists()


def test_a_socket_that_cannot_be_is_refused(tmp_path: Path) -> None:
    for name, backend, message in (("s" * 120, "exact", "shorter"), ("s", "exakt", "known: exact")):
        with pytest.raises(LookdevError, match=message):
            start(tmp_path / name, backend)


def test_a_server_ends_with_its_socket(warm_socket: Path, tmp_path: Path) -> None:
    warm_socket.unlink()
    case.wait_until(lambda: not case.is_alive(case.worker_pids(tmp_path)[0]))
