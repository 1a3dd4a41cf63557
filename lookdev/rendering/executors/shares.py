"""Which frames a worker renders next: those of a scene stay with a worker, as a change of scene takes seconds."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable, Iterable

from lookdev.rendering.executors.protocol import Wanted
from lookdev.rendering.task import FrameTask, SceneTask

_CHANGE = 2.0
"""Seconds that a change of scene takes until one was measured: a shader is compiled."""

_CHUNK = 15.0  # seconds of frames in a chunk
_PIXELS = 64 << 20  # bytes of pixels that a chunk answers, about


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


class ChunkShares:
    """Frames that wait, given away in chunks of one scene.

    `wanted` is asked before a frame is given away; `answered` chunks come back with pixels, whose size is bounded.
    """

    def __init__(self, tasks: Iterable[FrameTask], wanted: Wanted, *, answered: bool) -> None:
        self._shares = Shares(tasks)
        self._wanted = wanted
        self._answered = answered
        self._before: dict[str, SceneTask] = {}

    def measured(self, task: FrameTask, seconds: float, worker: str) -> None:
        """Note what a frame took on a worker."""
        first = self._before.get(worker) is not task.scene
        self._before[worker] = task.scene
        self._shares.measured(task, seconds, first=first)

    def leave(self, worker: str) -> None:
        """Forget a worker."""
        self._shares.leave(worker)

    def chunk(self, worker: str, workers: int) -> list[FrameTask]:
        """Return frames of a scene for a worker; none where none waits that is worth a change of its scene."""
        chosen: list[FrameTask] = []
        while (task := self._shares.next_for(worker)) is not None:
            if chosen and chosen[0].scene is not task.scene:
                self._shares.give_back(task)
                break
            chosen += [task] if self._wanted(task) else []
            if chosen and len(chosen) >= self._size(task, workers):
                break
        return chosen

    def _size(self, task: FrameTask, workers: int) -> int:
        """Return how many frames make a chunk: one until it is known how long they take."""
        seconds = self._shares.seconds_of(task)
        if seconds is None:
            return 1
        width, height = task.scene.resolution
        bound = max(_PIXELS // (width * height * 32), 1) if self._answered else len(self._shares)
        # At the end chunks are small, so that all workers end at once.
        return max(min(int(_CHUNK / max(seconds, 1e-3)), -(-len(self._shares) // (2 * workers)), bound), 1)
