"""What would be rendered and why: every frame of a job, and the state of every file on disk."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from lookdev.errors import OutputError
from lookdev.job import Job, JobIbl, JobLook, JobRender, JobTurntable
from lookdev.plan.digest import frame_digest, part_digests
from lookdev.plan.poses import turntable_poses, unturned
from lookdev.plan.skips import Skip
from lookdev.render.task import FrameTask, SceneTask
from lookdev.scene.camera import Pose
from lookdev.scene.sampling import Sampling

State = Literal["done", "stale", "new"]
Header = Mapping[str, str]
HeaderReader = Callable[[Path], Header | None]
"""Reads the ``lookdev:`` attributes of an EXR, without that prefix; OutputError where the file is broken."""


@dataclass(frozen=True)
class PlannedFile:
    """A file of a frame. `reason` says why it is not done; it is empty where it is."""

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
    """A frame that is done under another name: `source` holds the very pixels that `target` lacks."""

    source: Path
    target: Path


@dataclass(frozen=True)
class Plan:
    """Every frame of a job, look by look, and within a look light by light.

    `pictures` are the EXRs that need no rendering but whose PNG is missing or older; an EXR that `copies`
    will make is among them. `skips` say what the frames leave out.
    """

    frames: tuple[PlannedFrame, ...]
    pictures: tuple[Path, ...]
    skips: tuple[Skip, ...] = ()

    @property
    def counts(self) -> dict[State, int]:
        """How many files are in each state."""
        counter = Counter(file.state for frame in self.frames for file in frame.files)
        return {"done": counter["done"], "stale": counter["stale"], "new": counter["new"]}

    def pending(self) -> tuple[FrameTask, ...]:
        """Return the tasks to render, in an order in which the worker rarely changes its scene.

        A frame of which one file is done is not among them: see `copies`.
        """
        return tuple(frame.task for frame in self.frames if _done_path(frame.files) is None)

    def copies(self) -> tuple[Copy, ...]:
        """Return the files to copy instead of rendering their frames again.

        There are some where a turntable was added to a finished job, or a run was killed between two files.
        """
        return tuple(
            Copy(source, file.path)
            for frame in self.frames
            if (source := _done_path(frame.files)) is not None
            for file in frame.files
            if file.state != "done"
        )


def build_plan(
    job: Job,
    scenes: Mapping[tuple[str, str], SceneTask],
    read_header: HeaderReader,
    around: Collection[tuple[str, str]] = (),
) -> Plan:
    """Plan a job.

    Parameters
    ----------
    job : Job
        The job.
    scenes : mapping
        (look name, IBL name) to the scene, for every look and IBL of the job.
    read_header : callable
        Reads the header of a frame that exists.
    around : collection
        The keys of those scenes whose asset looks the same however it is turned: poses that differ by no more than
        that are one frame.

    Returns
    -------
    Plan
        With one frame for each distinct pose of a look under a light, however many turntables show it. Poses are not
        distinct where only a light turned that comes alike from everywhere.
    """
    frames = tuple(
        PlannedFrame(task, tuple(_planned_file(path, task, read_header) for path in task.files))
        for look in job.look
        for ibl in job.ibl
        for task in _tasks(job, look, ibl, scenes[look.name, ibl.name], (look.name, ibl.name) in around)
    )
    return Plan(frames, tuple(_pictures(frames)) if job.outputs.png else ())


def frame_files(job: Job, look: str, ibl: str, turntable: JobTurntable) -> tuple[Path, ...]:
    """Return each frame's EXR of a turntable: ``<output>/<look>/<ibl>/<turntable>.####.exr``, from 0001."""
    folder = job.output / look / ibl
    return tuple(folder / f"{turntable.name}.{number:04d}.exr" for number in range(1, turntable.frames + 1))


def frame_sampling(render: JobRender) -> Sampling:
    """Return the sampling of a job's scenes."""
    return Sampling(
        samples=render.samples,
        error=render.error,
        brdf_samples=render.brdf_samples,
        ibl_samples=render.ibl_samples,
        bounces=render.bounces,
        seed=render.seed,
    )


def _tasks(job: Job, look: JobLook, ibl: JobIbl, scene: SceneTask, around: bool) -> Iterator[FrameTask]:
    shown: dict[Pose, list[tuple[str, Path]]] = {}
    for turntable in job.turntable:
        poses = turntable_poses(turntable, ibl.rotation, job.camera.azimuth)
        files = frame_files(job, look.name, ibl.name, turntable)
        for pose, file in zip(poses, files, strict=True):
            shown.setdefault(unturned(pose, around, scene.light.constant), []).append((turntable.name, file))
    for pose, places in shown.items():
        parts = part_digests(scene, pose, ibl.exposure)
        labels = {
            "job": str(job.file),
            "asset": job.asset.builtin or str(job.asset.usd),
            "look": look.name,
            "ibl": ibl.name,
            "turntable": ", ".join(dict.fromkeys(name for name, _ in places)),
            "pose.element": repr(pose.element),
            "pose.lighting": repr(pose.lighting),
            "exposure": repr(ibl.exposure),
        }
        yield FrameTask(
            scene=scene,
            pose=pose,
            exposure=ibl.exposure,
            digest=frame_digest(parts),
            files=tuple(file for _, file in places),
            labels=labels | {f"digest.{part}": digest for part, digest in parts.items()},
        )


def _planned_file(path: Path, task: FrameTask, read_header: HeaderReader) -> PlannedFile:
    if not path.exists():
        return PlannedFile(path, "new", "no file")
    try:
        header = read_header(path) or {}
    except OutputError:
        return PlannedFile(path, "stale", "not a readable EXR")
    if header.get("digest") == task.digest:
        return PlannedFile(path, "done", "")
    if "digest" not in header:
        return PlannedFile(path, "stale", "not written by lookdev")
    parts = [key for key in task.labels if key.startswith("digest.") and header.get(key) != task.labels[key]]
    changed = ", ".join(part.removeprefix("digest.") for part in parts) or "digest"
    return PlannedFile(path, "stale", f"{changed} changed")


def _done_path(files: tuple[PlannedFile, ...]) -> Path | None:
    return next((file.path for file in files if file.state == "done"), None)


def _pictures(frames: tuple[PlannedFrame, ...]) -> Iterator[Path]:
    for frame in frames:
        if _done_path(frame.files) is not None:
            yield from (file.path for file in frame.files if file.state != "done" or _picture_is_due(file.path))


def _picture_is_due(frame: Path) -> bool:
    # The EXR is written first: a picture older than it is of the frame that it replaced.
    picture = frame.with_suffix(".png")
    return not picture.exists() or picture.stat().st_mtime_ns < frame.stat().st_mtime_ns
