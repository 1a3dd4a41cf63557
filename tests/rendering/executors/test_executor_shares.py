from types import SimpleNamespace
from typing import Any

import pytest

from lookdev.rendering.executors.capacity import CpuUse, free_memory, idle_cores, is_worker_worthwhile
from lookdev.rendering.executors.frame_queue import FrameQueue


def frames(*counts: int) -> list[Any]:
    """Return frames of scenes, named as ``b2``, the third of the second scene."""
    tasks = []
    for letter, count in zip("abc", counts, strict=False):
        scene = object()
        tasks += [SimpleNamespace(scene=scene, name=f"{letter}{number}") for number in range(count)]
    return tasks


def name(task: Any) -> str | None:
    return task and task.name


def test_a_worker_keeps_its_scene_and_then_takes_one_that_nobody_renders() -> None:
    shares = FrameQueue(frames(2, 2, 1))
    taken = [(worker, name(shares.next_frame(worker))) for worker in (1, 2, 1, 2, 1)]
    assert taken == [(1, "a0"), (2, "b0"), (1, "a1"), (2, "b1"), (1, "c0")]
    assert len(shares) == 0
    assert shares.next_frame(1) is None


def test_workers_share_the_scene_that_has_most_for_each() -> None:
    shares = FrameQueue(frames(2, 5))
    assert [name(shares.next_frame(worker)) for worker in (1, 2, 3)] == ["a0", "b0", "b1"]


@pytest.mark.parametrize(("seconds", "shared"), [(0.1, False), (10.0, True)])
def test_a_scene_is_shared_where_that_takes_less_than_a_change_of_scene(seconds: float, shared: bool) -> None:
    tasks = frames(5)
    shares = FrameQueue(tasks)
    shares.next_frame(1)
    shares.record_time(tasks[0], seconds + 3.0, first=True)
    shares.record_time(tasks[1], seconds, first=False)
    shares.record_time(tasks[0], seconds + 3.0, first=True)  # so that a change takes 3 s
    assert (shares.next_frame(2) is not None) == shared


def test_frames_of_a_worker_that_has_gone_are_anyones() -> None:
    tasks = frames(3)
    shares = FrameQueue(tasks)
    first = shares.next_frame(1)
    shares.record_time(tasks[0], 0.01, first=False)
    assert shares.next_frame(2) is None
    assert first is not None
    shares.put_back(first)
    shares.remove_worker(1)
    assert name(shares.next_frame(2)) == "a0"


def test_another_worker_is_worth_idle_cores_free_memory_and_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lookdev.rendering.executors.capacity.usable_cores", lambda: 2)
    for workers, idle, left, free, worth in (
        (1, 0.8, 100.0, 8, True),
        (1, 0.1, 100.0, 8, False),  # it keeps the cores busy
        (1, 0.8, 5.0, 8, False),  # it is done before another is there
        (1, 0.8, 100.0, 2, False),  # memory is short
        (3, 0.5, 100.0, 8, True),  # each uses half a core
    ):
        assert is_worker_worthwhile(workers, idle, left, 2 << 30, free << 30) == worth, (workers, idle, left, free)


def test_idle_cores_are_those_that_neither_these_processes_nor_others_use(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lookdev.rendering.executors.capacity.usable_cores", lambda: 4)
    assert idle_cores(CpuUse(0.0, 10.0, 100.0), CpuUse(10.0, 20.0, 125.0)) == 1.5
    assert idle_cores(CpuUse(0.0, 10.0, 100.0), CpuUse(10.0, 45.0, 125.0)) == 0.5


def test_use_and_memory_are_those_of_this_machine() -> None:
    before = CpuUse.of(())
    while CpuUse.of(()).processes < before.processes + 0.3:
        sum(range(1 << 16))
    after = CpuUse.of(())
    # The kernel samples the machine's time in ticks of 10 ms, a hypervisor's guest with some of them late.
    assert after.machine >= before.machine + 0.2
    assert 0 < free_memory() < 1 << 50
