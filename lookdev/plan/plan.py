"""What is to be rendered and why: every frame of some setups, and the state of every file on disk."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from lookdev.errors import OutputError
from lookdev.job.wedges import WedgeSheet
from lookdev.plan.digest import frame_digest, part_digests
from lookdev.plan.poses import turntable_poses
from lookdev.plan.setup import Setup, Turns
from lookdev.plan.skips import Skip, scene_skips
from lookdev.render.task import FrameTask
from lookdev.scene import Pose
from lookdev.scene.charts import Strip

State = Literal["done", "stale", "new"]
DAMAGED = "damaged"
"""The reason of a stale file that cannot be read, or was changed since it was written."""

Header = Mapping[str, str]
HeaderReader = Callable[[Path], Header | None]
"""Returns the ``lookdev:`` attributes of an EXR, without that prefix, and its ``resolution``, "width x height"; raises
OutputError where the file is broken."""


@dataclass(frozen=True)
class PlannedFile:
    """A file of a frame. `reason` is why it is not done, empty where it is."""

    path: Path
    state: State
    reason: str


@dataclass(frozen=True)
class PlannedFrame:
    """A frame, and the state of each of ``task.files``, in their order."""

    task: FrameTask
    files: tuple[PlannedFile, ...]


@dataclass(frozen=True)
class Copy:
    """A file to make without rendering: `source` is another file of the same frame."""

    source: Path
    target: Path


@dataclass(frozen=True)
class Reel:
    """The files of a turntable of a look under a light, in the order of its frames."""

    look: str
    ibl: str
    turntable: str
    files: tuple[Path, ...]


@dataclass(frozen=True)
class Charts:
    """The reference props of a job: a setup for each light, and the strip of the frame that shows them."""

    setups: tuple[Setup, ...]
    strip: Strip


@dataclass(frozen=True)
class Plan:
    """Every frame of some setups, in their order.

    `charts` are the frames of reference props that are laid over frames of looks, all by their files; the props are in
    a `strip` of the frame, and their frames are the first.

    `pictures` are the files to make of single frames that need no rendering: those that are missing or older than the
    EXR, or whose EXR `copies` will make.
    """

    frames: tuple[PlannedFrame, ...]
    reels: tuple[Reel, ...]
    output: Path  # the folder of all files
    pictures: tuple[Path, ...] = ()  # EXRs that need no rendering but whose PNG is missing or older, copies included
    skips: tuple[Skip, ...] = ()
    sheets: tuple[WedgeSheet, ...] = ()
    charts: Mapping[Path, Path] = field(default_factory=dict)
    strip: Strip | None = None

    @property
    def counts(self) -> dict[State, int]:
        """How many files are in each state."""
        counter = Counter(file.state for frame in self.frames for file in frame.files)
        return {"done": counter["done"], "stale": counter["stale"], "new": counter["new"]}

    def pending(self) -> tuple[FrameTask, ...]:
        """Return the tasks to render, scene by scene; a frame with a done file is among `copies` instead."""
        return tuple(frame.task for frame in self.frames if _done_path(frame.files) is None)

    def copies(self) -> tuple[Copy, ...]:
        """Return the files to copy, after a turntable was added, or a run was killed between two files of a frame."""
        return tuple(
            Copy(source, file.path)
            for frame in self.frames
            if (source := _done_path(frame.files)) is not None
            for file in frame.files
            if file.state != "done"
        )


def build_plan(
    setups: Sequence[Setup],
    turns: Turns,
    read_header: HeaderReader,
    *,
    labels: Mapping[str, str] | None = None,
    beside: Sequence[str] = (),
    charts: Charts | None = None,
) -> Plan:
    """Plan the frames of setups: one for each distinct pose of a setup, however many turntables show it.

    Poses that differ only by a turn of what looks the same from everywhere are one. `labels` are entries of the header
    of every frame; `beside` are the suffixes of the files that every frame is to have beside its EXR.
    """
    over = charts.setups if charts else ()
    strip = charts.strip if charts else None
    of_props = {**(labels or {}), "charts.strip": f"{strip.place} {strip.size!r}"} if strip else {}
    frames = tuple(
        PlannedFrame(task, tuple(_planned_file(path, task, read_header) for path in task.files))
        for setup, named in (*((each, of_props) for each in over), *((each, labels or {}) for each in setups))
        for task in _tasks(setup, turns, named)
    )
    reels = tuple(
        Reel(setup.look, setup.ibl, each.name, turns.files(setup.look, setup.ibl, each))
        for setup in setups
        for each in turns.turntables
    )
    due = tuple(_pictures(frames, beside))
    laid_over = {
        frame: above
        for props in over
        for each in turns.turntables
        for setup in setups
        if setup.ibl == props.ibl
        for frame, above in zip(
            turns.files(setup.look, setup.ibl, each), turns.files(props.look, props.ibl, each), strict=True
        )
    }
    return Plan(frames, reels, turns.output, due, tuple(find_skips(setups, turns)), charts=laid_over, strip=strip)


def find_skips(setups: Iterable[Setup], turns: Turns) -> Iterator[Skip]:
    """Yield what setups leave out, in their order, except what the user turned off."""
    for setup in setups:
        of_scene = scene_skips(setup.task, setup.scene.looks, setup.requested, len(setup.scene.lights))
        for what, why in (*of_scene, *_frame_skips(setup, turns)):
            yield Skip(setup.look, setup.ibl, what, why)


def _frame_skips(setup: Setup, turns: Turns) -> Iterator[tuple[str, str]]:
    asked = [pose for each in turns.turntables for pose in turntable_poses(each, setup.rotation, turns.azimuth)]
    poses, left = set(asked), turns.poses(setup)
    if len(poses) < len(asked):
        yield f"{len(asked) - len(poses)} of {len(asked)} frames", "same pose"
    if len(left) < len(poses):
        causes = ["same all around"] * setup.around + ["constant light"] * setup.task.light_stays
        yield f"{len(poses) - len(left)} of {len(poses)} frames", ", ".join(causes)


def _tasks(setup: Setup, turns: Turns, labels: Mapping[str, str]) -> Iterator[FrameTask]:
    shown: dict[Pose, list[tuple[str, Path]]] = {}
    for turntable in turns.turntables:
        files = turns.files(setup.look, setup.ibl, turntable)
        for pose, file in zip(setup.poses(turntable, turns.azimuth), files, strict=True):
            shown.setdefault(pose, []).append((turntable.name, file))
    for pose, places in shown.items():
        parts = part_digests(setup.task, pose, setup.exposure)
        own = {
            "look": setup.look,
            "ibl": setup.ibl,
            "turntable": ", ".join(dict.fromkeys(name for name, _ in places)),
            "pose.element": repr(pose.element),
            "pose.lighting": repr(pose.lighting),
            "exposure": repr(setup.exposure),
        }
        yield FrameTask(
            scene=setup.task,
            pose=pose,
            exposure=setup.exposure,
            digest=frame_digest(parts),
            files=tuple(file for _, file in places),
            labels={**labels, **own, **{f"digest.{part}": digest for part, digest in parts.items()}},
        )


def _planned_file(path: Path, task: FrameTask, read_header: HeaderReader) -> PlannedFile:
    if not path.exists():
        return PlannedFile(path, "new", "no file")
    try:
        header = read_header(path) or {}
    except OutputError:
        return PlannedFile(path, "stale", DAMAGED)
    width, height = task.scene.resolution
    if header.get("digest") == task.digest:
        same = header.get("resolution") == f"{width} x {height}"
        return PlannedFile(path, "done", "") if same else PlannedFile(path, "stale", "pixels of another size")
    if "digest" not in header:
        return PlannedFile(path, "stale", "not written by lookdev")
    parts = [key for key in task.labels if key.startswith("digest.") and header.get(key) != task.labels[key]]
    names = ["light" if part == "digest.ibl" else part.removeprefix("digest.") for part in parts]
    changed = ", ".join(names) or "digest"
    return PlannedFile(path, "stale", f"{changed} changed")


def _done_path(files: tuple[PlannedFile, ...]) -> Path | None:
    return next((file.path for file in files if file.state == "done"), None)


def _pictures(frames: tuple[PlannedFrame, ...], beside: Sequence[str]) -> Iterator[Path]:
    for frame in frames:
        if _done_path(frame.files) is not None:
            for file in frame.files:
                pictures = (file.path.with_suffix(suffix) for suffix in beside)
                yield from (each for each in pictures if file.state != "done" or _is_due(each, file.path))


def _is_due(picture: Path, frame: Path) -> bool:
    # The EXR is written first: a picture older than it is of the frame that it replaced.
    if not picture.is_file():
        return True
    status = picture.stat()
    return not status.st_size or status.st_mtime_ns < frame.stat().st_mtime_ns
