"""What is to be rendered and why: every frame of some setups, and the state of every file on disk."""

from __future__ import annotations

import hashlib
import math
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from itertools import chain
from pathlib import Path
from typing import Literal

from lookdev.build.wedges import WedgeSheet
from lookdev.errors import OutputError
from lookdev.plan.digest import PARTS, frame_digest, pose_digest, scene_digests
from lookdev.plan.poses import turntable_poses
from lookdev.plan.setup import Setup, Turns
from lookdev.plan.skips import Skip, scene_skips
from lookdev.rendering.task import FrameTask
from lookdev.scene import Pose
from lookdev.scene.charts import STRIP, Strip

State = Literal["done", "stale", "new"]
DAMAGED = "damaged"
"""The reason of a stale file that cannot be read, or was changed since it was written."""

Header = Mapping[str, str]
HeaderReader = Callable[[Path], Header | None]
"""Returns the ``lookdev:`` attributes of an EXR, without that prefix, and its ``resolution``, "width x height"; raises
OutputError where the file is broken."""


@dataclass(frozen=True)
class PlannedFile:
    """A file of a frame.

    `reason` is why it is not done, empty where it is. `seconds` are those that rendering took, in proportion to the
    pixels and samples of the frame where the file has others; None where they are not known.
    """

    path: Path
    state: State
    reason: str
    seconds: float | None = None


@dataclass(frozen=True, eq=False)
class PlannedFrame:
    """A frame, whose files `read_header` reads when their states are first asked for."""

    task: FrameTask
    read_header: HeaderReader

    @cached_property
    def files(self) -> tuple[PlannedFile, ...]:
        """The state of each of ``task.files``, in their order."""
        return tuple(_planned_file(path, self.task, self.read_header) for path in self.task.files)

    @property
    def seconds(self) -> float | None:
        """The time that the frame took, or will by that of another version of it on disk; None without one."""
        return next((file.seconds for file in self.files if file.seconds is not None), None)


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
    """Every frame of some setups, in their order; `beside` are the suffixes of the files that each is to have.

    `charts` are the frames of reference props that are laid over frames of looks, all by their files; their frames are
    the first.
    """

    frames: tuple[PlannedFrame, ...]
    reels: tuple[Reel, ...]
    output: Path  # the folder of all files
    beside: tuple[str, ...] = ()
    skips: tuple[Skip, ...] = ()
    sheets: tuple[WedgeSheet, ...] = ()
    charts: Mapping[Path, Path] = field(default_factory=dict)

    @cached_property
    def digest(self) -> str:
        """A digest of all frames and their files, wherever the output folder is."""
        digest, start = hashlib.sha256(), len(str(self.output))
        for frame in self.frames:
            names = "\0".join(str(path)[start:] for path in frame.task.files)
            digest.update(f"{frame.task.digest}\0{names}\n".encode())
        return digest.hexdigest()

    @property
    def counts(self) -> dict[State, int]:
        """How many files are in each state."""
        counter = Counter(file.state for frame in self.frames for file in frame.files)
        return {"done": counter["done"], "stale": counter["stale"], "new": counter["new"]}

    @cached_property
    def pictures(self) -> tuple[Path, ...]:
        """The files to make of single frames that need no rendering.

        They are missing or older than the EXR, or `copies` will make their EXR.
        """
        return tuple(_pictures(self.frames, self.beside))

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
    reels = tuple(
        tuple(
            Reel(setup.look, setup.ibl, each.name, turns.files(setup.look, setup.ibl, each))
            for each in turns.turntables
        )
        for setup in setups
    )
    of_pose = cache(_pose_labels)  # shared by the looks
    frames = tuple(
        PlannedFrame(task, read_header)
        for setup, shown in zip(setups, reels, strict=True)
        for task in _tasks(setup, turns, shown, labels or {}, of_pose)
    )
    over, above = _frames_over(charts, reels, turns, read_header, labels or {}, of_pose)
    skips = tuple(find_skips(setups, turns))
    return Plan((*over, *frames), tuple(chain.from_iterable(reels)), turns.output, tuple(beside), skips, charts=above)


def _frames_over(
    charts: Charts | None,
    reels: Sequence[Sequence[Reel]],
    turns: Turns,
    read_header: HeaderReader,
    labels: Mapping[str, str],
    of_pose: Callable[[Pose], dict[str, str]],
) -> tuple[tuple[PlannedFrame, ...], dict[Path, Path]]:
    """Return the frames of reference props, and which of their files is laid over each file of the reels of looks."""
    if charts is None:
        return (), {}
    frames: list[PlannedFrame] = []
    above: dict[Path, Path] = {}
    for setup in charts.setups:
        own = [
            Reel(setup.look, setup.ibl, each.name, turns.files(setup.look, setup.ibl, each))
            for each in turns.turntables
        ]
        named = {**labels, STRIP: charts.strip.label}
        frames += (PlannedFrame(task, read_header) for task in _tasks(setup, turns, own, named, of_pose))
        for shown in reels:
            for under, over in zip(shown, own, strict=True):
                if under.ibl == over.ibl:
                    above |= zip(under.files, over.files, strict=True)
    return tuple(frames), above


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


def _pose_labels(pose: Pose) -> dict[str, str]:
    return {
        "pose.element": repr(pose.element),
        "pose.lighting": repr(pose.lighting),
        "digest.pose": pose_digest(pose),
    }


def _tasks(
    setup: Setup,
    turns: Turns,
    reels: Sequence[Reel],
    labels: Mapping[str, str],
    of_pose: Callable[[Pose], dict[str, str]],
) -> Iterator[FrameTask]:
    shown: dict[Pose, list[tuple[str, Path]]] = {}
    for turntable, reel in zip(turns.turntables, reels, strict=True):
        for pose, file in zip(setup.poses(turntable, turns.azimuth), reel.files, strict=True):
            shown.setdefault(pose, []).append((turntable.name, file))
    parts = scene_digests(setup.task, setup.exposure)
    common = {**labels, "look": setup.look, "ibl": setup.ibl, "exposure": repr(setup.exposure)}
    common |= {f"digest.{part}": digest for part, digest in parts.items()}
    for pose, places in shown.items():
        own = of_pose(pose)
        yield FrameTask(
            scene=setup.task,
            pose=pose,
            exposure=setup.exposure,
            digest=frame_digest({**parts, "pose": own["digest.pose"]}),
            files=tuple(file for _, file in places),
            labels={**common, "turntable": sys.intern(", ".join(dict.fromkeys(name for name, _ in places))), **own},
        )


def _planned_file(path: Path, task: FrameTask, read_header: HeaderReader) -> PlannedFile:
    try:
        header = read_header(path) or {}
    except OutputError:
        return PlannedFile(path, "stale", DAMAGED) if path.exists() else PlannedFile(path, "new", "no file")
    width, height = task.scene.resolution
    if header.get("digest") == task.digest:
        if header.get("resolution") == f"{width} x {height}":
            return PlannedFile(path, "done", "", _seconds(header, task, exactly=True))
        return PlannedFile(path, "stale", "pixels of another size")
    if "digest" not in header:
        return PlannedFile(path, "stale", "not written by lookdev")
    parts = [part for part in PARTS if header.get(f"digest.{part}") != task.labels[f"digest.{part}"]]
    names = ["light" if part == "ibl" else part for part in parts]
    changed = ", ".join(names) or "digest"
    return PlannedFile(path, "stale", f"{changed} changed", _seconds(header, task, exactly=False))


def _seconds(header: Header, task: FrameTask, *, exactly: bool) -> float | None:
    """Return the time that a frame takes, by the header of one on disk; None where it states none."""
    try:
        seconds, samples = float(header["seconds"]), int(header["samples"])
        shown = math.prod(int(side) for side in header["resolution"].split(" x "))
    except (KeyError, ValueError):
        return None
    if not (0.0 <= seconds < math.inf and samples > 0 and shown > 0):
        return None
    scene = task.scene
    if exactly or scene.sampling.error is not None:  # of a target error, nobody knows the samples
        return seconds
    return seconds * math.prod(scene.resolution) * scene.sampling.samples / (shown * samples)


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
