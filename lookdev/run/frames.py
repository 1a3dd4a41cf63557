"""The main loop of a run: it selects, claims, renders and writes frames, and makes the files that show frames.

Several runs may render the same plan at the same time. A run claims a frame before it renders the frame, so that no
other run renders it. A picture is a file that shows one frame, such as a PNG. A sheet is a file that shows several.
"""

from __future__ import annotations

import random
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from lookdev.cache import link_or_copy
from lookdev.errors import LookdevError, OutputError, close_hint
from lookdev.output.exr import read_frame, read_header
from lookdev.output.frame_name import FrameName
from lookdev.plan import Plan
from lookdev.plan.plan import DAMAGED
from lookdev.rendering.executors import protocol
from lookdev.rendering.executors.protocol import Executor, ExecutorEvent, StoredFrame
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.task import FrameTask
from lookdev.run import events
from lookdev.run.events import ReportEvent
from lookdev.run.frame_file import exposed_beauty, store_frame
from lookdev.run.pictures import PictureFile, PictureWriter
from lookdev.run.runs import Run
from lookdev.run.status import FailedFrame, record_failure

_MAX_NAMES = 5  # the most names of frames in a message

_WAIT_SECONDS = (0.05, 2.0)  # the first and the longest time between checks whether other runs have made a file


@dataclass(frozen=True)
class RunResult:
    """The result of a run."""

    total: int  # frames in the plan
    done: int  # frames on disk
    rendered: int  # frames that this run has rendered
    failures: tuple[FailedFrame, ...]
    interrupted: bool  # by Ctrl-C
    missing: tuple[str, ...] = ()  # the names of frames that a run that renders nothing did not find on disk

    @property
    def exit_code(self) -> int:
        """0 if all frames are done, 1 if some failed or are missing, 130 after Ctrl-C."""
        if self.interrupted:
            return 130
        return 1 if self.failures or self.missing else 0

    @property
    def event(self) -> events.RunEnded:
        """The result as an event."""
        failed, missing = len(self.failures), len(self.missing)
        return events.RunEnded(self.total, self.done, self.rendered, failed, missing, self.interrupted)

    def summary(self) -> str:
        """Return the result as text, with a line for each failed frame."""
        logs = [f" (log: {failure.log})" if failure.log else "" for failure in self.failures]
        lines = [f"{failure.name}: {failure.reason}{log}" for failure, log in zip(self.failures, logs, strict=True)]
        if lines:
            lines.insert(0, f"{len(self.failures)} of {self.total} frames failed:")
        if self.missing:
            names = ", ".join(self.missing[:_MAX_NAMES]) + (", ..." if len(self.missing) > _MAX_NAMES else "")
            lines.append(f"{len(self.missing)} of {self.total} frames are not rendered yet: {names}")
        lines.append(f"{self.done} of {self.total} frames are done, {self.rendered} of them rendered now.")
        if self.interrupted:
            lines.append("Interrupted; run the same command again to continue.")
        return "\n".join(lines)


class RunFrames:
    """The frames of a plan, as one run updates, renders and writes them.

    Parameters
    ----------
    plan
        The frames, and the files that show several of them.
    pictures
        The writer of the files that show frames.
    run
        The run, which claims frames and files.
    report
        A function that is called with every event.
    force
        Whether to render frames although they are done.
    """

    def __init__(self, plan: Plan, pictures: PictureWriter, run: Run, report: ReportEvent, force: bool) -> None:
        self._plan = plan
        self._run = run
        self._report = report
        self._pictures = pictures
        self._props = set(plan.charts.values())  # frames of reference props, which are composited over other frames
        self._force = force
        self._done: set[Path] = set()  # all files of frames that are done
        self._rendered = 0  # frames that this run has rendered
        self._failures: list[FailedFrame] = []
        self._sheets_of_others: list[PictureFile] = []  # sheets that other runs have claimed

    def result(self, interrupted: bool = False, missing: Sequence[FrameTask] = ()) -> RunResult:
        """Return the result so far; `missing` are the frames that a run without rendering did not find on disk."""
        done = sum(self._done.issuperset(frame.task.files) for frame in self._plan.frames)
        names = tuple(map(self._name, missing))
        return RunResult(len(self._plan.frames), done, self._rendered, tuple(self._failures), interrupted, names)

    def update_files(self, only: Sequence[str]) -> list[FrameTask]:
        """Make the copies, pictures and sheets that need no rendering; return the frames to render.

        `only` has the names of the frames to render; if it is empty, all frames of the plan are selected.
        """
        force = self._force
        tasks = [frame.task for frame in self._plan.frames]
        selected = self._files_named(only) if only else {task.files for task in tasks}
        folders = {path.parent for task in tasks for path in task.files}
        # Sheets that show several looks are in folders named after lights, next to the folders of looks.
        self._run.remove_leftovers(
            {self._run.state} | folders | {self._plan.output / folder.name for folder in folders}
        )
        # A frame is identified by its files. Its digest would not do: frames of equal looks have the same digest.
        waiting = {task.files for task in self._plan.pending()} | (selected if force else set())
        pending = [task for task in tasks if task.files in waiting & selected]
        files = () if force else (file for frame in self._plan.frames for file in frame.files)
        damaged = [file.path for file in files if file.reason == DAMAGED]
        for copy in () if force else self._plan.copies():
            link_or_copy(copy.source, copy.target)
        for task in tasks:
            if task.files in waiting:
                continue
            try:
                self._pictures.refresh_pictures(task, self._done)
            except OutputError:
                if _is_readable(task.files[0]):
                    raise
                # The header of the frame is valid, but its pixels are damaged. A version without checksums wrote it, so
                # the plan has not noticed the damage.
                damaged.append(task.files[0])
                pending += [task] if task.files in selected else []
            else:
                self._done.update(task.files)
        for path in damaged:
            self._report(events.Noted(f"{path}: was damaged, and is made again"))
        self._make_due_sheets()
        self._report(events.RunStarted(len(tasks), len(pending)))
        return pending

    def _files_named(self, names: Sequence[str]) -> set[tuple[Path, ...]]:
        """Return the files of the frames with these names, and the files of the reference props composited over them.

        Raises LookdevError where the plan has no frame of a name.
        """
        frames = {str(FrameName.of(path)): frame.task.files for frame in self._plan.frames for path in frame.task.files}
        for name in names:
            if name not in frames:
                hint = close_hint(name, list(frames)) or "see its plan"
                raise LookdevError(f"the job has no frame '{name}' ({hint})")
        selected = {frames[name] for name in names}
        tasks = {path: frame.task.files for frame in self._plan.frames for path in frame.task.files}
        charts = self._plan.charts
        return selected | {tasks[charts[file]] for files in selected for file in files if file in charts}

    def render(self, tasks: Sequence[FrameTask], executor: Executor) -> None:
        """Render frames, each claimed by this run until it is done; raises the errors of `Executor.render`.

        Scenes without a frame that another run has claimed come first. The other frames without a claim follow, from
        the last frame of each scene to its first. Finally, this run waits for the frames that other runs have claimed,
        and renders a frame if its claim is released or void.
        """
        left = self._render_unclaimed(tasks, executor, skip_scenes=True)
        waits = _wait_times()
        while left:
            before = len(self._done)
            left = self._render_unclaimed(left, executor, skip_scenes=False)
            waits = _wait_times() if len(self._done) > before else waits
            if left:
                time.sleep(next(waits))

    def _render_unclaimed(
        self, tasks: Sequence[FrameTask], executor: Executor, *, skip_scenes: bool
    ) -> list[FrameTask]:
        """Render the frames that no other run has claimed; return the other frames.

        With `skip_scenes`, a frame that follows a claimed frame of its scene is not rendered either. The returned
        frames are sorted by scene, from the last frame of a scene to its first. The order of the scenes is random, and
        different for each run. Several runs that render these frames next thus spread over the scenes, and seldom
        change their scene.
        """
        claimed: list[FrameTask] = []
        scenes: set[int] = set()

        def should_render(task: FrameTask) -> bool:
            """Return whether this run is to render a frame; if so, it has claimed the frame."""
            if (skip_scenes and id(task.scene) in scenes) or not self._run.claim(self._name(task)):
                claimed.append(task)
                scenes.add(id(task.scene))
                return False
            return not self._take_from_disk(task)

        for event in executor.render(tasks, should_render):
            self._handle_event(event)
        generator = random.Random(self._run.info.id)
        ranks = {scene: generator.random() for scene in dict.fromkeys(id(task.scene) for task in claimed)}
        claimed.reverse()
        return sorted(claimed, key=lambda task: ranks[id(task.scene)])

    def _take_from_disk(self, task: FrameTask) -> bool:
        """Return whether another run has rendered a frame since this plan was made; if so, record it as done."""
        if self._force or not _has_frame(task.files[0], task):
            return False
        for path in task.files[1:]:
            if not _has_frame(path, task):
                link_or_copy(task.files[0], path)
        self._pictures.refresh_pictures(task, self._done)
        self._mark_done(task)
        self._report(events.FrameFound(self._name(task), id=task.digest))
        self._make_due_sheets()
        return True

    def _handle_event(self, event: ExecutorEvent) -> None:
        """Report an event of the executor; if a frame is finished, write it."""
        if isinstance(event, protocol.ExecutorNote):
            self._report(events.Noted(event.text))
            return
        task = event.task
        name, digest = self._name(task), task.digest
        match event:
            case protocol.Started():
                self._report(events.FrameStarted(name, id=digest))
            case protocol.Progressed(_, progress):
                self._report(events.FrameProgressed(name, progress.samples, progress.of, progress.relmse, id=digest))
            case protocol.Retried(_, reason, attempt, attempts):
                self._report(events.FrameRetried(name, reason, attempt, attempts, id=digest))
            case protocol.GivenUp(_, reason, log):
                self._run.release(name)
                self._failures.append(record_failure(self._run, name, reason, log))
                self._report(events.FrameFailed(name, reason, id=digest))
            case protocol.Finished(_, rendered, seconds):
                self._finish_frame(task, rendered, seconds)

    def _finish_frame(self, task: FrameTask, rendered: WorkerFrame | StoredFrame, seconds: float) -> None:
        """Write a frame, unless its worker has written it. Then write the pictures and sheets that show it."""
        self._run.check_alive()
        stored = rendered if isinstance(rendered, StoredFrame) else store_frame(task, rendered)
        for note in stored.notes:
            self._report(events.Noted(note))
        pixels = None if isinstance(rendered, StoredFrame) else (exposed_beauty(task, rendered), rendered.alpha)
        self._pictures.refresh_pictures(task, self._done, pixels)
        self._mark_done(task)
        self._rendered += 1
        self._report(events.FrameDone(self._name(task), seconds, stored.samples, stored.relmse, id=task.digest))
        self._make_due_sheets(task)

    def _mark_done(self, task: FrameTask) -> None:
        """Record a frame as done, and end its claim."""
        self._done.update(task.files)
        if task.files[0] in self._props:
            self._pictures.refresh_frames_under(task, self._done)
        self._run.release(self._name(task))

    def _make_due_sheets(self, task: FrameTask | None = None) -> None:
        """Make the sheets whose frames are all done and that are missing or outdated.

        With `task`, make all finished sheets that show this new frame, and no others.
        """
        for file in self._pictures.finished_sheets(self._done, task):
            is_due = task is not None or self._pictures.is_due(file)
            if is_due and not self._make_sheet(file, new=task is not None):
                self._sheets_of_others.append(file)

    def _make_sheet(self, file: PictureFile, *, new: bool = False) -> bool:
        """Make a sheet if it is outdated or shows a `new` frame; return False if another run has claimed it."""
        name = file.paths[0].relative_to(self._plan.output).as_posix()
        if not self._run.claim(name):
            return False
        try:
            if new or self._pictures.is_due(file):
                self._pictures.write(file, file.paths)
                for path in file.paths:
                    self._report(events.SheetWritten(path))
        finally:
            self._run.release(name)
        return True

    def wait_for_sheets(self) -> None:
        """Wait for the sheets that other runs have claimed; make a sheet here if its run ends without making it."""
        for wait in _wait_times():
            self._sheets_of_others = [file for file in self._sheets_of_others if not self._make_sheet(file)]
            if not self._sheets_of_others:
                return
            time.sleep(wait)

    def _name(self, task: FrameTask) -> str:
        """Return the name of a frame, which is the name of its first file."""
        return str(FrameName.of(task.files[0]))


def _wait_times() -> Iterator[float]:
    """Yield the seconds of consecutive waits: each is twice the one before, up to the longest."""
    wait, longest = _WAIT_SECONDS
    while True:
        yield wait
        wait = min(2.0 * wait, longest)


def _has_frame(file: Path, task: FrameTask) -> bool:
    """Return whether a file exists, is undamaged and is the frame of a task."""
    if not file.exists():
        return False
    try:
        return read_header(file).get("digest") == task.digest
    except OutputError:
        return False


def _is_readable(frame: Path) -> bool:
    """Return whether the pixels of a frame can be read."""
    try:
        read_frame(frame)
    except OutputError:
        return False
    return True
