"""The order in which workers get frames: a worker stays with its scene, because a change of scene takes seconds."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable, Iterable

from lookdev.rendering.executors.protocol import FrameFilter
from lookdev.rendering.task import FrameTask, SceneTask

_CHANGE_SECONDS = 2.0
"""Assumed seconds of a change of scene, which compiles a shader, until one is measured."""

_CHUNK_SECONDS = 15.0  # seconds of frames in a chunk
_CHUNK_BYTES = 64 << 20  # bytes of pixels in the answer of a chunk, about


class FrameQueue:
    """Waiting frames by scene, and the scene of each worker.

    A worker stays with its scene while the scene has frames. Then it takes the first scene that no worker renders.
    Without such a scene, it takes the one with the most frames per worker, if its share of these takes longer than a
    change of scene.
    """

    def __init__(self, tasks: Iterable[FrameTask]) -> None:
        self._waiting: dict[int, deque[FrameTask]] = {}
        for task in tasks:
            # The frames of a scene share its task, so that its id identifies it without a slow comparison.
            self._waiting.setdefault(id(task.scene), deque()).append(task)
        self._scene_of: dict[Hashable, int] = {}
        self._seconds: dict[int, float] = {}  # of the latest frame of each scene that was not a worker's first
        self._change_seconds = _CHANGE_SECONDS

    def __len__(self) -> int:
        return sum(map(len, self._waiting.values()))

    def next_frame(self, worker: Hashable) -> FrameTask | None:
        """Remove and return a worker's next frame; None where the waiting frames are better left to other workers."""
        scene = self._next_scene(worker)
        if scene is None:
            return None
        self._scene_of[worker] = scene
        return self._waiting[scene].popleft()

    def put_back(self, task: FrameTask) -> None:
        """Put a frame back in front of the waiting ones."""
        self._waiting[id(task.scene)].appendleft(task)

    def remove_worker(self, worker: Hashable) -> None:
        """Remove a worker, and the claim on its scene."""
        self._scene_of.pop(worker, None)

    def frame_seconds(self, task: FrameTask) -> float | None:
        """Return the seconds of a frame of the same scene as `task`; None until one is measured."""
        return self._seconds.get(id(task.scene))

    def record_time(self, task: FrameTask, seconds: float, *, first: bool) -> None:
        """Record the seconds of a frame; `first` says whether it was the first of its scene on its worker."""
        usual = self._seconds.get(id(task.scene))
        if not first:
            self._seconds[id(task.scene)] = seconds
        elif usual is not None:
            self._change_seconds = max(seconds - usual, 0.0)

    def _next_scene(self, worker: Hashable) -> int | None:
        current = self._scene_of.get(worker)
        if current is not None and self._waiting[current]:
            return current
        others = [scene for other, scene in self._scene_of.items() if other != worker]
        waiting = [scene for scene, tasks in self._waiting.items() if tasks]
        if free := [scene for scene in waiting if scene not in others]:
            return free[0]
        if not waiting:
            return None
        widest = max(waiting, key=lambda scene: len(self._waiting[scene]) / others.count(scene))
        part = len(self._waiting[widest]) / (others.count(widest) + 1)
        seconds = self._seconds.get(widest)
        return widest if seconds is None or part * seconds > self._change_seconds else None


class ChunkQueue:
    """Waiting frames, which workers get in chunks of one scene.

    `is_needed` is called before a frame goes to a worker. With `returns_pixels`, the answers of chunks contain pixels:
    the number of pixels in a chunk is then limited.
    """

    def __init__(self, tasks: Iterable[FrameTask], is_needed: FrameFilter, *, returns_pixels: bool) -> None:
        self._frames = FrameQueue(tasks)
        self._is_needed = is_needed
        self._returns_pixels = returns_pixels
        self._scene_before: dict[str, SceneTask] = {}

    def record_time(self, task: FrameTask, seconds: float, worker: str) -> None:
        """Record the seconds of a frame on a worker."""
        first = self._scene_before.get(worker) is not task.scene
        self._scene_before[worker] = task.scene
        self._frames.record_time(task, seconds, first=first)

    def remove_worker(self, worker: str) -> None:
        """Forget a worker."""
        self._frames.remove_worker(worker)

    def next_chunk(self, worker: str, workers: int) -> list[FrameTask]:
        """Return frames of one scene for a worker; none where no waiting frames are worth a change of scene."""
        frames: list[FrameTask] = []
        while (task := self._frames.next_frame(worker)) is not None:
            if frames and frames[0].scene is not task.scene:
                self._frames.put_back(task)
                break
            frames += [task] if self._is_needed(task) else []
            if frames and len(frames) >= self._chunk_size(task, workers):
                break
        return frames

    def _chunk_size(self, task: FrameTask, workers: int) -> int:
        """Return the number of frames in a chunk: one until the time of a frame is measured."""
        seconds = self._frames.frame_seconds(task)
        if seconds is None:
            return 1
        width, height = task.scene.resolution
        bound = max(_CHUNK_BYTES // (width * height * 32), 1) if self._returns_pixels else len(self._frames)
        # Towards the end chunks get smaller, so that all workers finish together.
        return max(min(int(_CHUNK_SECONDS / max(seconds, 1e-3)), -(-len(self._frames) // (2 * workers)), bound), 1)
