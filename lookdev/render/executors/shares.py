"""Which frame a worker renders next: frames of a scene stay with a worker, as a change of scene takes seconds."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable, Iterable

from lookdev.render.task import FrameTask

_CHANGE = 2.0
"""Seconds that a change of scene takes until one was measured: a shader is compiled."""


class Shares:
    """Frames that wait, by scene, and who renders which scene.

    A worker goes on with its scene, then with the first scene that nobody renders, then with the scene of most frames
    for each of its workers, if its part of them takes longer than a change of scene.
    """

    def __init__(self, tasks: Iterable[FrameTask]) -> None:
        self._waiting: dict[int, deque[FrameTask]] = {}
        for task in tasks:
            # Frames of a scene share its task; equal ones are not worth a comparison.
            self._waiting.setdefault(id(task.scene), deque()).append(task)
        self._scene_of: dict[Hashable, int] = {}
        self._seconds: dict[int, float] = {}  # of a frame of each scene, not its first
        self._change = _CHANGE

    def __len__(self) -> int:
        return sum(map(len, self._waiting.values()))

    def next_for(self, worker: Hashable) -> FrameTask | None:
        """Return a frame that waits no longer; None where the others are better left to other workers."""
        scene = self._choice(worker)
        if scene is None:
            return None
        self._scene_of[worker] = scene
        return self._waiting[scene].popleft()

    def give_back(self, task: FrameTask) -> None:
        """Let a frame wait again."""
        self._waiting[id(task.scene)].appendleft(task)

    def leave(self, worker: Hashable) -> None:
        """Forget a worker."""
        self._scene_of.pop(worker, None)

    def seconds_of(self, task: FrameTask) -> float | None:
        """Return what a frame of the scene of this one takes, once that is known."""
        return self._seconds.get(id(task.scene))

    def measured(self, task: FrameTask, seconds: float, *, first: bool) -> None:
        """Note what a frame took, `first` of its scene on its worker or not."""
        usual = self._seconds.get(id(task.scene))
        if not first:
            self._seconds[id(task.scene)] = seconds
        elif usual is not None:
            self._change = max(seconds - usual, 0.0)

    def _choice(self, worker: Hashable) -> int | None:
        own = self._scene_of.get(worker)
        if own is not None and self._waiting[own]:
            return own
        others = [scene for other, scene in self._scene_of.items() if other != worker]
        waiting = [scene for scene, tasks in self._waiting.items() if tasks]
        if free := [scene for scene in waiting if scene not in others]:
            return free[0]
        if not waiting:
            return None
        widest = max(waiting, key=lambda scene: len(self._waiting[scene]) / others.count(scene))
        part = len(self._waiting[widest]) / (others.count(widest) + 1)
        seconds = self._seconds.get(widest)
        return widest if seconds is None or part * seconds > self._change else None
