"""Workers of Dask with the fake renderer; their cache is not that of this process."""

import os
import signal
import socket
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import batch_case as case
import pytest

from lookdev.cache import Content
from lookdev.errors import LookdevError, OutputError, WorkerError
from lookdev.light import Dome
from lookdev.output.exr import read_frame
from lookdev.plan import Plan
from lookdev.rendering.executors.choice import ExecutorOptions, open_executor
from lookdev.rendering.executors.dask import DaskExecutor, _Chunk
from lookdev.rendering.executors.protocol import ExecutorNote, Finished, GivenUp, Retried, WorkerFiles
from lookdev.rendering.task import files_of_task
from lookdev.run.frame_file import store_frame
from lookdev.run.render import run_plan

pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning"),
    pytest.mark.both_pythons,
]


LOOPBACK = {"threads_per_worker": 1, "dashboard_address": "127.0.0.1:0", "host": "127.0.0.1"}


@pytest.fixture(scope="module")
def worker_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The cache of the workers."""
    return tmp_path_factory.mktemp("there")


@pytest.fixture(scope="module")
def cluster(worker_cache: Path) -> Iterator[Any]:
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, env={"LOOKDEV_CACHE": str(worker_cache)}, **LOOPBACK) as cluster:
        yield cluster


@pytest.fixture
def plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Plan:
    """Return a plan whose files are in the cache of this process."""
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "here"))
    plan = case.make_plan(case.make_job(tmp_path))
    maps = [Content.store_bytes(part.encode(), ".exr") for part in "rpsb"]
    scene = plan.frames[0].task.scene
    scene = replace(scene, asset=Content.store_bytes(os.urandom(99), ".npz"), lights=(Dome(*maps, 64, 32, "119147"),))
    return replace(plan, frames=tuple(replace(frame, task=replace(frame.task, scene=scene)) for frame in plan.frames))


@pytest.fixture
def executor(cluster: Any, tmp_path: Path, plan: Plan) -> Iterator[DaskExecutor]:
    with make_executor(cluster.scheduler_address, tmp_path) as executor:
        # One that a test killed is started again.
        case.wait_until(lambda: len(executor._addresses()) == 2)
        yield executor


def make_executor(address: str, folder: Path, **options: Any) -> DaskExecutor:
    (folder / "scratch").mkdir(exist_ok=True)
    files = WorkerFiles(folder / "scratch", lambda name: folder / f"{name}.log", (), 60.0)
    return DaskExecutor(files, address, command=case.command(folder), **options)


def render(executor: DaskExecutor, plan: Plan) -> Iterator[Any]:
    return executor.render([frame.task for frame in plan.frames], lambda task: True)


def stems(events: Iterable[Any], kind: type) -> list[str]:
    return sorted(event.task.files[0].stem for event in events if isinstance(event, kind))


ALL = ["element.0001", "element.0002", "element.0003", "element.0004", "lighting.0002", "lighting.0003"]


def test_frames_come_back_and_files_go_there_once(executor: DaskExecutor, plan: Plan, worker_cache: Path) -> None:
    files = files_of_task(plan.frames[0].task.scene)
    assert stems(render(executor, plan), Finished) == ALL
    stored = {content: worker_cache / "content" / f"{content.digest}{content.suffix}" for content in files}
    assert all(file.read_bytes() == content.path.read_bytes() for content, file in stored.items())
    before = {file: file.stat().st_ino for file in stored.values()}
    assert stems(render(executor, plan), Finished) == ALL
    assert {file: file.stat().st_ino for file in stored.values()} == before
    assert not list((worker_cache / "content").glob(".*"))


def test_a_frame_that_fails_is_given_up_and_one_that_lost_its_renderer_is_tried_again(
    executor: DaskExecutor, plan: Plan, tmp_path: Path
) -> None:
    case.misbehave(tmp_path, element_0002=["failed"], element_0003=["die", "ok"])
    events = list(render(executor, plan))
    assert stems(events, Finished) == [name for name in ALL if name != "element.0002"]
    (given_up,) = (event for event in events if isinstance(event, GivenUp))
    assert "no such attribute 'st2' (on tcp://127.0.0.1:" in given_up.reason
    assert stems(events, Retried) == ["element.0002", "element.0003"]


def test_frames_of_a_worker_of_dask_that_is_killed_are_rendered_by_others(
    executor: DaskExecutor, plan: Plan, tmp_path: Path
) -> None:
    case.misbehave(tmp_path, element_0002=["hang", "ok"])
    events, killed, hangs = [], False, tmp_path / "hangs.txt"
    for event in render(executor, plan):
        events.append(event)
        if not killed and hangs.exists() and (renderer := hangs.read_text()):
            worker = int(Path(f"/proc/{renderer}/stat").read_text().rpartition(")")[2].split()[1])
            os.kill(worker, signal.SIGKILL)  # of Dask: the renderer's parent
            killed = True
    assert killed
    assert stems(events, Finished) == ALL


class Late:
    """A future whose result comes at a given call."""

    def __init__(self, questions: float) -> None:
        self.left = questions

    def result(self, timeout: float) -> str:
        self.left -= 1
        if self.left > 0:
            raise TimeoutError
        return "a result"


def test_a_result_that_was_lost_with_its_worker_is_not_waited_for(executor: DaskExecutor) -> None:
    with pytest.raises(TimeoutError, match=r"worker tcp://gone:1 was lost with its result"):
        executor._result_of(_Chunk([], "tcp://gone:1", Late(2)))


def test_a_late_result_is_waited_for(executor: DaskExecutor, monkeypatch: pytest.MonkeyPatch) -> None:
    unfit = executor._addresses()[0]
    executor._unfit[unfit] = "its versions differ"
    for worker in ("", unfit, executor._addresses()[1]):  # "": where Dask chooses one
        assert executor._result_of(_Chunk([], worker, Late(3))) == "a result"
    monkeypatch.setattr("lookdev.rendering.executors.dask._CONNECT_TIMEOUT", 0.0)
    with pytest.raises(TimeoutError, match="does not send a result"):
        executor._result_of(_Chunk([], "", Late(float("inf"))))


def test_ending_early_stops_what_renders_there(executor: DaskExecutor, plan: Plan, tmp_path: Path) -> None:
    case.misbehave(tmp_path, **{name.replace(".", "_"): ["hang"] for name in ALL})
    next(render(executor, plan))
    case.wait_until(lambda: bool(case.requests(tmp_path)))
    executor.__exit__()
    case.wait_until(lambda: not any(map(case.is_alive, case.worker_pids(tmp_path))), 20.0)


def test_a_renderer_that_nobody_asks_for_ends_and_the_next_run_starts_another(
    executor: DaskExecutor, plan: Plan, tmp_path: Path
) -> None:
    idle = "from lookdev.rendering.executors import dask_worker; dask_worker.IDLE_SECONDS = "
    executor._client.run(exec, f"{idle}0.1", {})
    try:
        assert stems(render(executor, plan), Finished) == ALL
        first = case.worker_pids(tmp_path)
        case.wait_until(lambda: not any(map(case.is_alive, first)), 20.0)
        assert stems(render(executor, plan), Finished) == ALL
        assert set(case.worker_pids(tmp_path)) > set(first)
    finally:
        executor._client.run(exec, f"{idle}300.0", {})


def test_workers_write_frames_to_a_folder_that_they_share(cluster: Any, plan: Plan, tmp_path: Path) -> None:
    job = case.make_job(tmp_path)
    with make_executor(cluster.scheduler_address, tmp_path, store=store_frame) as executor:
        result = run_plan(plan, job.outputs, job.render.background, executor=executor)
    assert (result.done, result.rendered, result.exit_code) == (6, 6, 0)
    output = tmp_path / "out" / "gold" / "city"
    assert (read_frame(output / "element.0002.exr")[0] == 0.25).all()
    assert len(list(output.glob("*.png"))) == 9


def test_a_worker_without_the_shared_folder_is_told_what_it_lacks(
    cluster: Any, plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with make_executor(cluster.scheduler_address, tmp_path, store=store_frame) as executor:
        monkeypatch.setattr(executor, "_create_shared_marker", lambda: Path("/nowhere/mark"))
        # A worker waits five seconds for a file to appear, and its next chunk, of the test after this one, for that.
        executor._client.run(
            exec, "from lookdev.rendering.executors import dask_worker; dask_worker._APPEARANCE_TIMEOUT = 0.2", {}
        )
        with pytest.raises(
            WorkerError, match=r"does not see /nowhere: mount the output folder.* or leave out --shared"
        ):
            list(render(executor, plan))


def test_a_worker_that_cannot_write_ends_the_run(executor: DaskExecutor, plan: Plan, tmp_path: Path) -> None:
    case.misbehave(tmp_path, element_0001=["full"])
    with pytest.raises(OutputError, match=r"worker tcp://.*: /out: No space left on device"):
        list(render(executor, plan))


def test_a_file_that_is_nowhere_is_an_error_that_names_it(executor: DaskExecutor, plan: Plan) -> None:
    asset = plan.frames[0].task.scene.asset
    asset.path.unlink()
    with pytest.raises(LookdevError, match=asset.digest):
        list(render(executor, plan))


def test_a_worker_whose_cache_cannot_be_written_is_named(
    executor: DaskExecutor, plan: Plan, worker_cache: Path
) -> None:
    asset = plan.frames[0].task.scene.asset
    # A folder where the part of the file would be written: root may write everywhere.
    pids = executor._client.run(os.getpid).values()
    blocked = [worker_cache / "content" / f".{asset.digest}{asset.suffix}.{pid}.part" for pid in pids]
    for folder in blocked:
        folder.mkdir(parents=True)
    try:
        with pytest.raises(OutputError, match=r"worker tcp://.* cannot keep a file: .*directory"):
            list(render(executor, plan))
    finally:
        for folder in blocked:
            folder.rmdir()


def test_other_versions_are_an_error_that_says_what_to_install(
    executor: DaskExecutor, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    from lookdev.rendering.executors import dask

    ours = dask.package_versions("exact")
    monkeypatch.setattr(dask, "package_versions", lambda backend: ours | {"NumPy": "0.1", "lookdev": "9.9"})
    with pytest.raises(
        WorkerError, match=r"tcp://.* has lookdev 0.1.0, here 9.9; NumPy .*, here 0.1.*Install the same"
    ):
        list(render(executor, plan))


def test_a_scheduler_that_is_not_there_is_an_error_that_says_what_to_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lookdev.rendering.executors.dask._CONNECT_TIMEOUT", 0.5)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    with pytest.raises(WorkerError, match=f"no scheduler of Dask answers at {address}.*'dask scheduler'"):
        make_executor(address, tmp_path).__enter__()
    for address in ("nowhere", "tpc://127.0.0.1:8786"):
        with pytest.raises(LookdevError, match=f"'{address}' is not an address .*: write dask:tcp://HOST:8786"):
            make_executor(address, tmp_path).__enter__()
    files = WorkerFiles(tmp_path, lambda name: tmp_path / name, ())
    with pytest.raises(LookdevError, match="has workers of its own"):
        open_executor(ExecutorOptions("dask", address, workers=2), files, store_frame)


def test_a_user_is_told_where_no_worker_comes(tmp_path: Path, plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    from distributed import LocalCluster

    monkeypatch.setattr("lookdev.rendering.executors.dask._NO_WORKER_NOTE", 0.2)
    monkeypatch.setattr("lookdev.rendering.executors.dask._POLL", 0.1)
    with (
        LocalCluster(n_workers=0, **LOOPBACK) as cluster,
        make_executor(cluster.scheduler_address, tmp_path) as executor,
    ):
        events = []
        for event in render(executor, plan):
            events.append(event)
            if isinstance(event, ExecutorNote) and not cluster.workers:
                assert "has no worker: frames wait for one" in event.text
                cluster.adapt(minimum=0, maximum=1, interval="100ms")
        assert stems(events, Finished) == ALL
