"""Queues from which executors take the next frame, or chunk of frames, for a worker.

A worker gets frames of the same scene one after the other, because a change of scene takes seconds.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable, Iterable

from lookdev.rendering.executors.protocol import FrameFilter
from lookdev.rendering.task import FrameTask, SceneTask

_CHANGE_SECONDS = 2.0
"""Assumed seconds of a change of scene, which compiles a shader, until such a change is measured."""

_CHUNK_SECONDS = 15.0  # the seconds in which a worker renders a chunk, approximately
_CHUNK_BYTES = 64 << 20  # the most bytes of pixels in the answer for a chunk, approximately


class FrameQueue:
    """Waiting frames by scene, and the scene that each worker renders.

    A worker stays with its scene while the scene has waiting frames. Then it takes the first scene that no other worker
    renders. If there is no such scene, the worker joins the scene with the most waiting frames per worker. It does so
    only if its share of these frames takes longer than a change of scene.
    """

    def __init__(self, tasks: Iterable[FrameTask]) -> None:
        self._waiting: dict[int, deque[FrameTask]] = {}
        for task in tasks:
            # All frames of a scene refer to the same `SceneTask`. Its id identifies the scene, without a slow
            # comparison of values.
            self._waiting.setdefault(id(task.scene), deque()).append(task)
        self._scene_of: dict[Hashable, int] = {}  # the id of the scene that each worker renders, by worker
        # The seconds that the latest frame of each scene took, by scene. Each worker's first frame of a scene does not
        # count.
        self._seconds: dict[int, float] = {}
        self._change_seconds = _CHANGE_SECONDS

    def __len__(self) -> int:
        return sum(map(len, self._waiting.values()))

    def next_frame(self, worker: Hashable) -> FrameTask | None:
        """Remove and return a worker's next frame, or None if other workers are to render the waiting frames."""
        scene = self._next_scene(worker)
        if scene is None:
            return None
        self._scene_of[worker] = scene
        return self._waiting[scene].popleft()

    def put_back(self, task: FrameTask) -> None:
        """Put a frame back, before the waiting frames of its scene."""
        self._waiting[id(task.scene)].appendleft(task)

    def remove_worker(self, worker: Hashable) -> None:
        """Remove a worker, which then no longer counts as a worker of its scene."""
        self._scene_of.pop(worker, None)

    def frame_seconds(self, task: FrameTask) -> float | None:
        """Return the seconds that the latest measured frame of a task's scene took; None if no frame is measured."""
        return self._seconds.get(id(task.scene))

    def record_time(self, task: FrameTask, seconds: float, *, first: bool) -> None:
        """Record the seconds that a frame took; `first` is true if it was its worker's first frame of the scene."""
        usual = self._seconds.get(id(task.scene))
        if not first:
            self._seconds[id(task.scene)] = seconds
        elif usual is not None:
            self._change_seconds = max(seconds - usual, 0.0)

    def _next_scene(self, worker: Hashable) -> int | None:
        """Return the id of the scene from which a worker takes its next frame, or None for no scene."""
        current = self._scene_of.get(worker)
        if current is not None and self._waiting[current]:
            return current
        others = [scene for other, scene in self._scene_of.items() if other != worker]
        waiting = [scene for scene, tasks in self._waiting.items() if tasks]
        if free := [scene for scene in waiting if scene not in others]:
            return free[0]
        if not waiting:
            return None
        largest = max(waiting, key=lambda scene: len(self._waiting[scene]) / others.count(scene))
        share = len(self._waiting[largest]) / (others.count(largest) + 1)
        seconds = self._seconds.get(largest)
        return largest if seconds is None or share * seconds > self._change_seconds else None


class ChunkQueue:
    """Waiting frames, which workers get in chunks: several frames of one scene.

    `is_needed` is called before a frame goes to a worker; a frame for which it returns false is left out. With
    `returns_pixels`, the answer for a chunk contains pixels, and the size of a chunk is limited accordingly.
    """

    def __init__(self, tasks: Iterable[FrameTask], is_needed: FrameFilter, *, returns_pixels: bool) -> None:
        self._frames = FrameQueue(tasks)
        self._is_needed = is_needed
        self._returns_pixels = returns_pixels
        self._scene_before: dict[str, SceneTask] = {}

    def record_time(self, task: FrameTask, seconds: float, worker: str) -> None:
        """Record the seconds that a frame took on a worker."""
        first = self._scene_before.get(worker) is not task.scene
        self._scene_before[worker] = task.scene
        self._frames.record_time(task, seconds, first=first)

    def remove_worker(self, worker: str) -> None:
        """Remove a worker, as `FrameQueue.remove_worker`."""
        self._frames.remove_worker(worker)

    def next_chunk(self, worker: str, workers: int) -> list[FrameTask]:
        """Remove and return frames of one scene for a worker; none if other workers are to render the waiting frames.

        `workers` is the number of all workers.
        """
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
        """Return the number of frames for a chunk of the scene of `task`: one until the time of a frame is measured."""
        seconds = self._frames.frame_seconds(task)
        if seconds is None:
            return 1
        width, height = task.scene.resolution
        # A pixel takes about 32 bytes: the colours of two halves, and alpha.
        bound = max(_CHUNK_BYTES // (width * height * 32), 1) if self._returns_pixels else len(self._frames)
        # A chunk is at most half of a worker's share of the waiting frames. So chunks get smaller towards the end, and
        # all workers finish at about the same time.
        return max(min(int(_CHUNK_SECONDS / max(seconds, 1e-3)), -(-len(self._frames) // (2 * workers)), bound), 1)
