import os
import time
from collections.abc import Iterable
from pathlib import Path

import batch_case as case
import pytest

from lookdev.errors import LookdevError, OutputError, WorkerError
from lookdev.rendering.executors.choice import ExecutorOptions, choose_executor, device_environments
from lookdev.rendering.executors.local import LocalExecutor
from lookdev.rendering.executors.protocol import Finished, GivenUp, Retried, WorkerFiles
from lookdev.rendering.task import FrameTask
from lookdev.rendering.threads import share_of_cores, usable_cores

pytestmark = pytest.mark.both_pythons


Tasks = list[FrameTask]


def executor_files(folder: Path, command: tuple[str, ...] | None = None) -> WorkerFiles:
    (folder / "scratch").mkdir(exist_ok=True)
    return WorkerFiles(folder / "scratch", lambda name: folder / f"{name}.log", command or case.command(folder), 20.0)


def names(tasks: Iterable[FrameTask]) -> list[str]:
    return sorted(task.files[0].stem for task in tasks)


@pytest.fixture
def tasks(tmp_path: Path) -> Tasks:
    return [frame.task for frame in case.make_plan(case.make_job(tmp_path)).frames]


def slow_down(folder: Path, tasks: Tasks) -> None:
    case.misbehave(folder, **{name.replace(".", "_"): ["slow"] for name in names(tasks)})


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.proof), 3])
def test_every_frame_is_rendered_once_however_many_workers(tmp_path: Path, tasks: Tasks, workers: int) -> None:
    slow_down(tmp_path, tasks)
    with LocalExecutor(executor_files(tmp_path), workers) as executor:
        events = list(executor.render(tasks, lambda task: True))
    finished = [event for event in events if isinstance(event, Finished)]
    assert names(event.task for event in finished) == names(tasks)
    assert all((event.rendered.a == 0.25).all() for event in finished)
    assert sorted(case.requests(tmp_path)) == sorted(task.files[0].name for task in tasks)
    assert len(case.worker_pids(tmp_path)) == workers
    assert not any(map(case.is_alive, case.worker_pids(tmp_path)))
    logs = sorted(path.name for path in tmp_path.glob("worker*.log"))
    assert logs == [*(f"worker-{number}.log" for number in range(2, workers + 1)), "worker.log"]


def test_a_frame_that_is_not_wanted_any_more_is_left_out(tmp_path: Path, tasks: Tasks) -> None:
    with LocalExecutor(executor_files(tmp_path), 2) as executor:
        events = executor.render(tasks, lambda task: task is not tasks[2])
        assert names(event.task for event in events if isinstance(event, Finished)) == names([*tasks[:2], *tasks[3:]])


def test_a_frame_that_kills_its_worker_is_given_up_and_the_others_are_rendered(tmp_path: Path, tasks: Tasks) -> None:
    case.misbehave(tmp_path, element_0002=["die"], element_0003=["failed", "ok"])
    with LocalExecutor(executor_files(tmp_path), 2) as executor:
        events = list(executor.render(tasks, lambda task: True))
    (given_up,) = (event for event in events if isinstance(event, GivenUp))
    assert (names([given_up.task]), "SIGKILL" in given_up.reason) == (["element.0002"], True)
    assert given_up.log is not None
    assert given_up.log.exists()
    tries = sorted((event.task.files[0].stem, event.attempt) for event in events if isinstance(event, Retried))
    assert tries == [("element.0002", 2), ("element.0002", 3), ("element.0003", 2)]
    assert sum(isinstance(event, Finished) for event in events) == len(tasks) - 1


@pytest.mark.parametrize(
    ("command", "error", "message"), [(None, OutputError, "No space left"), (("/bin/false",), WorkerError, "3 times")]
)
def test_what_ends_a_run_ends_all_workers(
    tmp_path: Path, tasks: Tasks, command: tuple[str, ...] | None, error: type[Exception], message: str
) -> None:
    case.misbehave(tmp_path, element_0002=["full"], element_0001=["hang"], element_0003=["hang"])
    with LocalExecutor(executor_files(tmp_path, command), 2) as executor, pytest.raises(error, match=message):
        list(executor.render(tasks, lambda task: True))
    assert not any(map(case.is_alive, case.worker_pids(tmp_path)))


def test_an_iteration_that_ends_early_ends_what_renders(tmp_path: Path, tasks: Tasks) -> None:
    case.misbehave(tmp_path, element_0001=["hang"], element_0002=["hang"])
    started = time.monotonic()
    with LocalExecutor(executor_files(tmp_path), 2) as executor:
        next(iter(executor.render(tasks, lambda task: True)))
        case.wait_until(lambda: len(case.requests(tmp_path)) == 2)
    assert time.monotonic() - started < 15.0
    assert not any(map(case.is_alive, case.worker_pids(tmp_path)))


@pytest.mark.parametrize(("idle", "workers"), [(1.9, 2), (0.0, 1)])
def test_without_a_number_workers_are_added_while_cores_are_idle(
    tmp_path: Path, tasks: Tasks, monkeypatch: pytest.MonkeyPatch, idle: float, workers: int
) -> None:
    module = "lookdev.rendering.executors"
    monkeypatch.setattr(f"{module}.local.idle_cores", lambda before, now: idle if len(executor._threads) == 1 else 0.0)
    monkeypatch.setattr(f"{module}.local._MEASURED_SECONDS", 0.0)
    monkeypatch.setattr(f"{module}.capacity._START_SECONDS", 0.0)
    monkeypatch.setattr(f"{module}.capacity.usable_cores", lambda: 2)
    slow_down(tmp_path, tasks)
    with LocalExecutor(executor_files(tmp_path), None) as executor:
        events = list(executor.render(tasks, lambda task: True))
    assert sum(isinstance(event, Finished) for event in events) == len(tasks)
    assert len(executor._threads) == workers


def test_workers_divide_cores_and_take_turns_with_devices(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda process: set(range(8)))
    devices = device_environments(ExecutorOptions(workers=3, device="cuda", device_numbers=(0, 2)))
    with LocalExecutor(executor_files(tmp_path), 3, devices) as executor:
        for _ in range(2):
            executor._threads.append(executor._new_thread())
        workers = [slot.worker for slot in executor._threads]
    assert [worker._environment["CUDA_VISIBLE_DEVICES"] for worker in workers] == ["0", "2", "0"]
    assert [sorted(worker._cores or ()) for worker in workers] == [[0, 1], [2, 3, 4], [5, 6, 7]]
    assert device_environments(ExecutorOptions(device="optix", device_numbers=(1, 3))) == (
        {"CUDA_VISIBLE_DEVICES": "1,3"},
    )


@pytest.mark.parametrize("expected", [[4], [2, 2], [1, 1, 2], [1] * 4, [1] * 6])
def test_cores_are_divided_whole(expected: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda process: {1, 3, 5, 7})
    shares = [share_of_cores(number, len(expected)) for number in range(len(expected))]
    assert [len(share) for share in shares] == expected
    assert frozenset().union(*shares) == {1, 3, 5, 7}


def test_a_worker_starts_on_its_cores(tmp_path: Path) -> None:
    before = usable_cores()
    with LocalExecutor(executor_files(tmp_path), before) as executor:
        executor.launch()
        pid = executor._threads[0].worker.pid
        assert pid is not None
        assert os.sched_getaffinity(pid) == (share_of_cores(0, before) if before > 1 else os.sched_getaffinity(0))
    assert usable_cores() == before


def test_a_wrong_choice_states_what_would_be_right() -> None:
    for options, message in (
        ({"executor": "dusk"}, "did you mean 'dask'"),
        ({"executor": "local:here"}, "has no address"),
        ({"executor": "warm"}, "warm:SOCKET"),
        ({"executor": "warm:x", "workers": 2}, "--workers: executor 'warm' has workers of its own"),
        ({"shared_output": True}, "--shared"),
        ({"device": "cdua"}, "did you mean 'cuda'"),
        ({"device": "cpu:0"}, "cannot be chosen by number"),
        ({"device": "cuda:"}, "should be as cuda:0"),
        ({"device": "cuda:0,x"}, "should be as cuda:0"),
        ({"executor": "dask", "device": "cuda:1"}, "write --device cuda"),
    ):
        with pytest.raises(LookdevError, match=message):
            choose_executor(**{"executor": "local", "workers": None, "device": None, "shared_output": False, **options})  # type: ignore[arg-type]
