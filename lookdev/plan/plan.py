"""The plan of a job: every frame of its setups, the state of each file on disk, and what remains to be done.

A *setup* is a look under a light. Its frames are distinct poses; several files, of one or more turntables, can show the
same frame.
"""

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
from lookdev.plan.setup import Setup, TurntableFrames
from lookdev.plan.skips import Skip, scene_skips
from lookdev.rendering.task import FrameTask
from lookdev.scene import Pose
from lookdev.scene.charts.props import PROPS_STRIP_KEY, Strip

FrameState = Literal["done", "stale", "new"]
DAMAGED = "damaged"
"""The reason of a stale file that cannot be read, or that was changed after it was written."""

Header = Mapping[str, str]
HeaderReader = Callable[[Path], Header | None]
"""A function that returns the ``lookdev:`` attributes of an EXR, without that prefix, and its ``resolution``.

The resolution is a text, "width x height". It raises OutputError if the file is broken."""


@dataclass(frozen=True)
class PlannedFile:
    """A file of a frame, and its state on disk.

    The state is "done" if the file is up to date, "stale" if it must be rendered again, and "new" if there is no file.
    `reason` states why it is not done; it is "" if the file is done. `seconds` is the rendering time that the file
    states, scaled to the planned pixels and samples if the file has others; None if it is unknown.
    """

    path: Path
    state: FrameState
    reason: str
    seconds: float | None = None


@dataclass(frozen=True, eq=False)
class PlannedFrame:
    """A frame, with the task that renders it; `read_header` reads its files when `files` is first used."""

    task: FrameTask
    read_header: HeaderReader

    @cached_property
    def files(self) -> tuple[PlannedFile, ...]:
        """The state of each of ``task.files``, in their order."""
        return tuple(_plan_file(path, self.task, self.read_header) for path in self.task.files)

    @property
    def seconds(self) -> float | None:
        """The rendering time in seconds that a file of the frame states or predicts; None if no file does."""
        return next((file.seconds for file in self.files if file.seconds is not None), None)


@dataclass(frozen=True)
class Copy:
    """A file to write without rendering: a copy of `source`, another file of the same frame."""

    source: Path
    target: Path


@dataclass(frozen=True)
class Reel:
    """The EXRs of a turntable of a look under a light or rig (`ibl`), in the order of the frames."""

    look: str
    ibl: str
    turntable: str
    files: tuple[Path, ...]


@dataclass(frozen=True)
class Charts:
    """The reference props of a job: their setup under each light, and the strip of the frame in which they are."""

    setups: tuple[Setup, ...]
    strip: Strip


@dataclass(frozen=True)
class Plan:
    """The plan of a job: its frames in the order of the setups, and their files.

    `reels` has a reel for each turntable of each setup, without the reference props. `frame_suffixes` has the suffixes
    of the pictures that each frame has beside its EXR. `charts` maps each file of a look to the file of the reference
    props that are composited over it. The frames of the props come first in `frames`.
    """

    frames: tuple[PlannedFrame, ...]
    reels: tuple[Reel, ...]
    output: Path  # the folder of all files
    frame_suffixes: tuple[str, ...] = ()
    skips: tuple[Skip, ...] = ()  # the work that is left out because no pixel depends on it
    sheets: tuple[WedgeSheet, ...] = ()  # the contact sheets of wedges
    charts: Mapping[Path, Path] = field(default_factory=dict)

    @cached_property
    def digest(self) -> str:
        """A digest of all frames and their files, which does not depend on the path of the output folder."""
        digest, start = hashlib.sha256(), len(str(self.output))
        for frame in self.frames:
            names = "\0".join(str(path)[start:] for path in frame.task.files)
            digest.update(f"{frame.task.digest}\0{names}\n".encode())
        return digest.hexdigest()

    @property
    def counts(self) -> dict[FrameState, int]:
        """The number of files in each state."""
        counter = Counter(file.state for frame in self.frames for file in frame.files)
        return {"done": counter["done"], "stale": counter["stale"], "new": counter["new"]}

    @cached_property
    def pictures(self) -> tuple[Path, ...]:
        """The pictures (`frame_suffixes`) to make from the EXRs of frames that need no rendering.

        These are the pictures that are missing, that are older than their EXR, or whose EXR `copies` writes.
        """
        return tuple(_due_pictures(self.frames, self.frame_suffixes))

    def pending(self) -> tuple[FrameTask, ...]:
        """Return the tasks of the frames to render, scene by scene: the frames without a done file.

        If a frame has a done file, its other files are copies of it (`copies`).
        """
        return tuple(frame.task for frame in self.frames if _done_path(frame.files) is None)

    def copies(self) -> tuple[Copy, ...]:
        """Return the files to copy from a done file of the same frame.

        There are such files after a turntable was added, or after a run was killed between two files of a frame.
        """
        return tuple(
            Copy(source, file.path)
            for frame in self.frames
            if (source := _done_path(frame.files)) is not None
            for file in frame.files
            if file.state != "done"
        )


def build_plan(
    setups: Sequence[Setup],
    turns: TurntableFrames,
    read_header: HeaderReader,
    *,
    labels: Mapping[str, str] | None = None,
    frame_suffixes: Sequence[str] = (),
    charts: Charts | None = None,
) -> Plan:
    """Return the plan of setups, which has one frame for each distinct pose of a setup.

    Two poses are not distinct if they differ only by the rotation of an asset, or of a light, that looks the same all
    around. `labels` are entries for the header of every frame. `frame_suffixes` has the suffixes of the pictures that
    every frame has beside its EXR.
    """
    labels = labels or {}
    pose_labels = cache(_pose_labels)  # computed once for all looks
    frames: list[PlannedFrame] = []

    def add_frames(setup: Setup, reels: Sequence[Reel], labels: Mapping[str, str]) -> None:
        frames.extend(PlannedFrame(task, read_header) for task in _tasks(setup, turns, reels, labels, pose_labels))

    reels = [_reels(setup, turns) for setup in setups]
    all_reels = tuple(chain.from_iterable(reels))
    chart_files: dict[Path, Path] = {}
    if charts is not None:
        for setup in charts.setups:
            chart_reels = _reels(setup, turns)
            add_frames(setup, chart_reels, {**labels, PROPS_STRIP_KEY: charts.strip.label})
            files_of_charts = {reel.turntable: reel.files for reel in chart_reels}
            for reel in all_reels:
                if reel.ibl == setup.ibl:
                    chart_files |= zip(reel.files, files_of_charts[reel.turntable], strict=True)
    for setup, setup_reels in zip(setups, reels, strict=True):
        add_frames(setup, setup_reels, labels)
    skips = tuple(find_skips(setups, turns))
    return Plan(tuple(frames), all_reels, turns.output, tuple(frame_suffixes), skips, charts=chart_files)


def _reels(setup: Setup, turns: TurntableFrames) -> tuple[Reel, ...]:
    """Return the reel of a setup for each turntable."""
    return tuple(
        Reel(setup.look, setup.ibl, turntable.name, turns.files(setup.look, setup.ibl, turntable))
        for turntable in turns.turntables
    )


def find_skips(setups: Iterable[Setup], turns: TurntableFrames) -> Iterator[Skip]:
    """Yield the work that setups leave out, in the order of the setups; work that the user turned off is not a skip."""
    for setup in setups:
        skips = scene_skips(setup.task, setup.scene.looks, setup.requested, len(setup.scene.lights))
        for work, cause in (*skips, *_frame_skips(setup, turns)):
            yield Skip(setup.look, setup.ibl, work, cause)


def _frame_skips(setup: Setup, turns: TurntableFrames) -> Iterator[tuple[str, str]]:
    """Yield the texts "n of m frames", for frames of turntables that are not rendered, each with its cause."""
    requested = [
        pose for turntable in turns.turntables for pose in turntable_poses(turntable, setup.rotation, turns.azimuth)
    ]
    distinct, rendered = set(requested), turns.poses(setup)
    if len(distinct) < len(requested):
        yield f"{len(requested) - len(distinct)} of {len(requested)} frames", "same pose"
    if len(rendered) < len(distinct):
        causes = ["same all around"] * setup.is_rotation_invariant + ["constant light"] * setup.task.is_light_fixed
        yield f"{len(distinct) - len(rendered)} of {len(distinct)} frames", ", ".join(causes)


def _pose_labels(pose: Pose) -> dict[str, str]:
    """Return the entries of a frame's header that depend on its pose."""
    return {"pose.element": repr(pose.element), "pose.lighting": repr(pose.lighting), "digest.pose": pose_digest(pose)}


def _tasks(
    setup: Setup,
    turns: TurntableFrames,
    reels: Sequence[Reel],
    labels: Mapping[str, str],
    pose_labels: Callable[[Pose], dict[str, str]],
) -> Iterator[FrameTask]:
    """Yield the task of each distinct pose of a setup."""
    files_of_poses: dict[Pose, list[tuple[str, Path]]] = {}
    for turntable, reel in zip(turns.turntables, reels, strict=True):
        for pose, file in zip(setup.poses(turntable, turns.azimuth), reel.files, strict=True):
            files_of_poses.setdefault(pose, []).append((turntable.name, file))
    parts = scene_digests(setup.task, setup.exposure)
    common = {**labels, "look": setup.look, "ibl": setup.ibl, "exposure": repr(setup.exposure)}
    common |= {f"digest.{part}": digest for part, digest in parts.items()}
    for pose, named_files in files_of_poses.items():
        labels_of_pose = pose_labels(pose)
        names = ", ".join(dict.fromkeys(name for name, _ in named_files))
        yield FrameTask(
            scene=setup.task,
            pose=pose,
            exposure=setup.exposure,
            digest=frame_digest({**parts, "pose": labels_of_pose["digest.pose"]}),
            files=tuple(file for _, file in named_files),
            labels={**common, "turntable": sys.intern(names), **labels_of_pose},
        )


def _plan_file(path: Path, task: FrameTask, read_header: HeaderReader) -> PlannedFile:
    """Return a file of a frame with its state, which follows from the header of the file."""
    try:
        header = read_header(path) or {}
    except OutputError:
        return PlannedFile(path, "stale", DAMAGED) if path.exists() else PlannedFile(path, "new", "no file")
    width, height = task.scene.resolution
    if header.get("digest") == task.digest:
        if header.get("resolution") == f"{width} x {height}":
            return PlannedFile(path, "done", "", _frame_seconds(header, task, is_same_frame=True))
        return PlannedFile(path, "stale", "pixels of another size")
    if "digest" not in header:
        return PlannedFile(path, "stale", "not written by lookdev")
    parts = [part for part in PARTS if header.get(f"digest.{part}") != task.labels[f"digest.{part}"]]
    names = ["light" if part == "ibl" else part for part in parts]
    changed = ", ".join(names) or "digest"
    return PlannedFile(path, "stale", f"{changed} changed", _frame_seconds(header, task, is_same_frame=False))


def _frame_seconds(header: Header, task: FrameTask, *, is_same_frame: bool) -> float | None:
    """Return the time that a frame takes, from the header of a file; None if the header states none.

    Unless the file is of the same frame, the time is scaled to the pixels and samples of the task.
    """
    try:
        seconds, samples = float(header["seconds"]), int(header["samples"])
        pixels = math.prod(int(side) for side in header["resolution"].split(" x "))
    except (KeyError, ValueError):
        return None
    if not (0.0 <= seconds < math.inf and samples > 0 and pixels > 0):
        return None
    scene = task.scene
    if is_same_frame or scene.sampling.error is not None:  # with a target error, the samples are not known beforehand
        return seconds
    return seconds * math.prod(scene.resolution) * scene.sampling.samples / (pixels * samples)


def _done_path(files: tuple[PlannedFile, ...]) -> Path | None:
    """Return the first done file of a frame; None if there is none."""
    return next((file.path for file in files if file.state == "done"), None)


def _due_pictures(frames: tuple[PlannedFrame, ...], suffixes: Sequence[str]) -> Iterator[Path]:
    """Yield the missing and the outdated pictures of the frames that have a done file."""
    for frame in frames:
        if _done_path(frame.files) is not None:
            for file in frame.files:
                pictures = (file.path.with_suffix(suffix) for suffix in suffixes)
                yield from (picture for picture in pictures if file.state != "done" or _is_due(picture, file.path))


def _is_due(picture: Path, frame: Path) -> bool:
    # The EXR is written first. A picture that is older than the EXR therefore shows the previous frame.
    if not picture.is_file():
        return True
    status = picture.stat()
    return not status.st_size or status.st_mtime_ns < frame.stat().st_mtime_ns
