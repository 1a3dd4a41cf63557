"""The frames of a plan as a run makes them: wanted, claimed, rendered, written, and what is made of them."""

from __future__ import annotations

import random
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from lookdev.cache import share
from lookdev.errors import LookdevError, OutputError, close_hint
from lookdev.output.exr import read_frame, read_header
from lookdev.output.frame_name import FrameName
from lookdev.plan import Plan
from lookdev.plan.plan import DAMAGED
from lookdev.rendering.executors import (
    Executor,
    Finished,
    GivenUp,
    Happening,
    Progressed,
    Remarked,
    Retried,
    Started,
    Stored,
)
from lookdev.rendering.results import Rendered
from lookdev.rendering.task import FrameTask
from lookdev.run.events import (
    FrameDone,
    FrameFailed,
    FrameFound,
    FrameProgressed,
    FrameRetried,
    FrameStarted,
    Noted,
    Report,
    RunEnded,
    RunStarted,
    SheetWritten,
)
from lookdev.run.frame_file import exposed, store
from lookdev.run.pictures import PictureFile, Pictures
from lookdev.run.runs import Run
from lookdev.run.status import record_failure

_NAMED = 5  # frames in a message

_WAITS = (0.05, 2.0)  # seconds between looks at what other runs make, the first and the longest


@dataclass(frozen=True)
class Failure:
    """A failed frame, the reason of its last try, and the log with the details, if it is on this machine."""

    name: str
    reason: str
    log: Path | None


@dataclass(frozen=True)
class RunResult:
    """The result of a run: of `total` frames, `done` are on disk, `rendered` of them by this run.

    `missing` are the names of those that it was to find on disk, and did not.
    """

    total: int
    done: int
    rendered: int
    failures: tuple[Failure, ...]
    interrupted: bool
    missing: tuple[str, ...] = ()

    @property
    def exit_code(self) -> int:
        """0 when all is done, 1 when frames failed or are missing, 130 after Ctrl-C."""
        if self.interrupted:
            return 130
        return 1 if self.failures or self.missing else 0

    @property
    def event(self) -> RunEnded:
        """The result as an event."""
        failed, missing = len(self.failures), len(self.missing)
        return RunEnded(self.total, self.done, self.rendered, failed, missing, self.interrupted)

    def summary(self) -> str:
        """Return the result as text, with a line for each failed frame."""
        logged = [f" (log: {failure.log})" if failure.log else "" for failure in self.failures]
        lines = [f"{each.name}: {each.reason}{log}" for each, log in zip(self.failures, logged, strict=True)]
        if lines:
            lines.insert(0, f"{len(self.failures)} of {self.total} frames failed:")
        if self.missing:
            named = ", ".join(self.missing[:_NAMED]) + (", ..." if len(self.missing) > _NAMED else "")
            lines.append(f"{len(self.missing)} of {self.total} frames are not rendered yet: {named}")
        lines.append(f"{self.done} of {self.total} frames are done, {self.rendered} of them rendered now.")
        if self.interrupted:
            lines.append("Interrupted; run the same command again to continue.")
        return "\n".join(lines)


class Frames:
    """The frames of a plan, as a run makes them."""

    def __init__(self, plan: Plan, pictures: Pictures, run: Run, report: Report, force: bool) -> None:
        self._root = plan.output
        self._plan = plan
        self._run = run
        self._report = report
        self._pictures = pictures
        self._props = set(plan.charts.values())
        self._force = force
        self._done: set[Path] = set()
        self._rendered = 0
        self._failures: list[Failure] = []
        self._with_others: list[PictureFile] = []

    def result(self, interrupted: bool = False, missing: Sequence[FrameTask] = ()) -> RunResult:
        """Return what has become of the frames; `missing` are those that were to be found on disk."""
        done = sum(self._done.issuperset(frame.task.files) for frame in self._plan.frames)
        names = tuple(map(self._name, missing))
        return RunResult(len(self._plan.frames), done, self._rendered, tuple(self._failures), interrupted, names)

    def bring_up_to_date(self, only: Sequence[str]) -> list[FrameTask]:
        """Make copies, pictures and sheets that need no rendering; return the frames to render."""
        force = self._force
        tasks = [frame.task for frame in self._plan.frames]
        chosen = self._chosen(only) if only else {task.files for task in tasks}
        folders = {path.parent for task in tasks for path in task.files}
        # Overviews are in folders named by lights, beside those of the looks.
        self._run.remove_leftovers({self._run.state} | folders | {self._root / folder.name for folder in folders})
        # By file: equal looks have one digest.
        waiting = {task.files for task in self._plan.pending()} | (chosen if force else set())
        pending = [task for task in tasks if task.files in waiting & chosen]
        files = () if force else (each for frame in self._plan.frames for each in frame.files)
        damaged = [each.path for each in files if each.reason == DAMAGED]
        for copy in () if force else self._plan.copies():
            share(copy.source, copy.target)
        for task in tasks:
            if task.files in waiting:
                continue
            try:
                self._pictures.refresh(task, self._done)
            except OutputError:
                if _is_whole(task.files[0]):
                    raise
                # Of a version without checksums: its header is valid, its pixels are not.
                damaged.append(task.files[0])
                pending += [task] if task.files in chosen else []
            else:
                self._done.update(task.files)
        for path in damaged:
            self._report(Noted(f"{path}: was damaged, and is made again"))
        self._refresh_sheets()
        self._report(RunStarted(len(tasks), len(pending)))
        return pending

    def _chosen(self, names: Sequence[str]) -> set[tuple[Path, ...]]:
        """Return the files of the frames that names stand for."""
        known = {str(FrameName.of(path)): frame.task.files for frame in self._plan.frames for path in frame.task.files}
        for name in names:
            if name not in known:
                raise LookdevError(f"the job has no frame '{name}' ({close_hint(name, list(known)) or 'see its plan'})")
        chosen = {known[name] for name in names}
        tasks = {path: frame.task.files for frame in self._plan.frames for path in frame.task.files}
        return chosen | {tasks[self._plan.charts[f]] for files in chosen for f in files if f in self._plan.charts}

    def render(self, tasks: Sequence[FrameTask], executor: Executor) -> None:
        """Render frames, each claimed until it is done; only workers that never start end the batch.

        Scenes at which no other run works come first, then any frames that none has claimed, of each scene the last
        first; those that others have claimed are waited for.
        """
        left = self._rendered_apart(tasks, executor, apart=True)
        waits = _waits()
        while left:
            before = len(self._done)
            left = self._rendered_apart(left, executor, apart=False)
            waits = _waits() if len(self._done) > before else waits
            if left:
                time.sleep(next(waits))

    def _rendered_apart(self, tasks: Sequence[FrameTask], executor: Executor, *, apart: bool) -> list[FrameTask]:
        """Render frames but those that other runs have claimed, and, if `apart`, the rest of their scenes.

        These are returned, from the last of each scene. Scenes are in an order of this run: so runs that help others
        are spread over them, and change their scene seldom.
        """
        claimed: list[FrameTask] = []
        scenes: set[int] = set()

        def wanted(task: FrameTask) -> bool:
            if (apart and id(task.scene) in scenes) or not self._run.claim(self._name(task)):
                claimed.append(task)
                scenes.add(id(task.scene))
                return False
            return not self._found(task)

        for happening in executor.render(tasks, wanted):
            self._take(happening)
        chance = random.Random(self._run.info.id)
        ranks = {scene: chance.random() for scene in dict.fromkeys(id(task.scene) for task in claimed)}
        claimed.reverse()
        return sorted(claimed, key=lambda task: ranks[id(task.scene)])

    def _found(self, task: FrameTask) -> bool:
        """Return whether another run has rendered a frame since it was planned; if so, take it and end its claim."""
        if self._force or not _has(task.files[0], task):
            return False
        for path in task.files[1:]:
            if not _has(path, task):
                share(task.files[0], path)
        self._pictures.refresh(task, self._done)
        self._settle(task)
        self._report(FrameFound(self._name(task), task.digest))
        self._refresh_sheets()
        return True

    def _take(self, what: Happening) -> None:
        if isinstance(what, Remarked):
            self._report(Noted(what.text))
            return
        task = what.task
        name, digest = self._name(task), task.digest
        match what:
            case Started():
                self._report(FrameStarted(name, digest))
            case Progressed(_, progress):
                self._report(FrameProgressed(name, progress.samples, progress.of, progress.relmse, digest))
            case Retried(_, reason, attempt, attempts):
                self._report(FrameRetried(name, reason, attempt, attempts, digest))
            case GivenUp(_, reason, log):
                self._run.release(name)
                self._failures.append(Failure(name, reason, log))
                record_failure(self._run, name, reason, log)
                self._report(FrameFailed(name, reason, digest))
            case Finished(_, rendered, seconds):
                self._finish(task, rendered, seconds)

    def _finish(self, task: FrameTask, rendered: Rendered | Stored, seconds: float) -> None:
        """Write a frame, unless its worker did, and what is made of it."""
        self._run.check()
        stored = rendered if isinstance(rendered, Stored) else store(task, rendered)
        for note in stored.notes:
            self._report(Noted(note))
        if isinstance(rendered, Stored):
            self._pictures.refresh(task, self._done)
        else:
            self._pictures.write(task, exposed(task, rendered), rendered.alpha, self._done)
        self._settle(task)
        self._rendered += 1
        self._report(FrameDone(self._name(task), seconds, stored.samples, stored.relmse, task.digest))
        self._refresh_sheets(task)

    def _settle(self, task: FrameTask) -> None:
        self._done.update(task.files)
        if task.files[0] in self._props:
            self._pictures.refresh_under(task, self._done)
        self._run.release(self._name(task))

    def _refresh_sheets(self, task: FrameTask | None = None) -> None:
        """Make what is out of date of several frames that are all done; with `task`, what shows that new frame."""
        for file in self._pictures.sheets(self._done, task):
            if task is None and not self._pictures.is_due(file):
                continue
            if not self._make_sheet(file, new=task is not None):
                self._with_others.append(file)

    def _make_sheet(self, file: PictureFile, *, new: bool = False) -> bool:
        """Make a file of several frames unless it is neither `new` nor due; return False where another run is at it."""
        name = file.paths[0].relative_to(self._root).as_posix()
        if not self._run.claim(name):
            return False
        try:
            if new or self._pictures.is_due(file):
                self._pictures.make(file)
                for path in file.paths:
                    self._report(SheetWritten(path))
        finally:
            self._run.release(name)
        return True

    def wait_for_sheets(self) -> None:
        """Wait until other runs have made what they are at, or make it."""
        for wait in _waits():
            self._with_others = [file for file in self._with_others if not self._make_sheet(file)]
            if not self._with_others:
                return
            time.sleep(wait)

    def _name(self, task: FrameTask) -> str:
        return str(FrameName.of(task.files[0]))


def _waits() -> Iterator[float]:
    wait, longest = _WAITS
    while True:
        yield wait
        wait = min(2.0 * wait, longest)


def _has(file: Path, task: FrameTask) -> bool:
    """Return whether a file is whole and of a frame."""
    if not file.exists():
        return False
    try:
        return read_header(file).get("digest") == task.digest
    except OutputError:
        return False


def _is_whole(frame: Path) -> bool:
    try:
        read_frame(frame)
    except OutputError:
        return False
    return True
