"""Display pictures and contact sheets, made from frames, and made again only when they would differ.

A ledger in the output's state folder says what each picture was made from: the frame digests and the view.
So a new view, or another number of frames, is noticed although no frame was rendered.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookdev.cache import atomic_path
from lookdev.job import Job
from lookdev.output.display import composite, to_display, write_pixels
from lookdev.output.exr import read_frame
from lookdev.output.sheet import write_sheet
from lookdev.plan import Plan
from lookdev.plan.task import FrameTask

Floats = NDArray[np.float32]
Background = Callable[[FrameTask], NDArray[np.float32] | NDArray[np.float64]]
"""Gives the linear light behind a frame, exposure applied: (H, W, 3), or (3,) where it is one colour."""

SHEET_SOURCE_SIZE = 512
"""Pixels. Larger frames are averaged down on reading, so that a sheet of many never fills the memory."""


class Pictures:
    """The PNGs and sheets of a job's frames.

    Parameters
    ----------
    job, plan
        Which pictures are wanted, in which view, of which frames.
    state_folder
        Where the ledger is kept.
    background
        What stands behind the frames.
    """

    def __init__(self, job: Job, plan: Plan, state_folder: Path, background: Background) -> None:
        self._outputs = job.outputs
        self._root = job.output
        self._background = background
        self._behind = job.render.background
        self._ledger_file = state_folder / "pictures.json"
        self._ledger = _read_ledger(self._ledger_file)
        self._overdue = set(plan.pictures)
        self._turntables = _turntables(plan)

    def refresh(self, task: FrameTask) -> None:
        """Make the PNGs of a frame on disk that are missing or out of date.

        Raises
        ------
        OutputError
            The frame cannot be read, or a picture not be written.
        """
        key = self._picture_key(task)
        due = [
            path.with_suffix(".png")
            for path in task.files
            if path in self._overdue or not self._is_current(path.with_suffix(".png"), key)
        ]
        if self._outputs.png and due:
            self._write(task, due, *read_frame(task.files[0]))

    def write(self, task: FrameTask, beauty: Floats, alpha: Floats) -> None:
        """Make the PNGs of a frame just rendered, if pictures are wanted."""
        if self._outputs.png:
            self._write(task, [path.with_suffix(".png") for path in task.files], beauty, alpha)

    def refresh_sheets(self, done: set[Path], task: FrameTask | None = None) -> list[Path]:
        """Make the sheets that are out of date and whose frames are all done; return their paths.

        With `task`, of the turntables alone that show it, and in any case: its frame is new.
        """
        if not self._outputs.sheet:
            return []
        written = []
        for sheet, frames in self._turntables.items():
            if task is not None and frames.keys().isdisjoint(task.files):
                continue
            key = self._sheet_key(frames)
            if frames.keys() <= done and (task is not None or not self._is_current(sheet, key)):
                self._write_sheet(sheet, frames)
                self._record([sheet], key)
                written.append(sheet)
        return written

    def _write(self, task: FrameTask, paths: Sequence[Path], beauty: Floats, alpha: Floats) -> None:
        pixels = to_display(composite(beauty, alpha, self._background(task)), self._outputs.view)
        write_shared(paths, lambda path: write_pixels(path, pixels))
        self._record(paths, self._picture_key(task))

    def _write_sheet(self, sheet: Path, frames: Mapping[Path, FrameTask]) -> None:
        shown = []
        for path, task in frames.items():
            rgb = composite(*read_frame(path), self._background(task))
            shown.append(to_display(_shrunk(rgb), self._outputs.view))
        labels = [path.stem.rpartition(".")[2] for path in frames]
        turntable = sheet.name.removesuffix(".sheet.png")
        write_sheet(sheet, shown, labels, f"{sheet.parent.parent.name} / {sheet.parent.name} / {turntable}")

    def _picture_key(self, task: FrameTask) -> str:
        return f"{task.digest} {self._behind} {self._outputs.view}"

    def _sheet_key(self, frames: Mapping[Path, FrameTask]) -> str:
        keys = "\n".join(self._picture_key(task) for task in frames.values())
        return hashlib.sha256(keys.encode()).hexdigest()

    def _is_current(self, path: Path, key: str) -> bool:
        return self._ledger.get(self._name(path)) == key and path.exists()

    def _record(self, paths: Iterable[Path], key: str) -> None:
        self._ledger |= {self._name(path): key for path in paths}
        with atomic_path(self._ledger_file) as temporary:
            temporary.write_text(json.dumps(self._ledger, indent=0))

    def _name(self, path: Path) -> str:
        return path.relative_to(self._root).as_posix()


def write_shared(paths: Sequence[Path], write: Callable[[Path], None]) -> None:
    """Write the first path, and give the same content to the others."""
    write(paths[0])
    for path in paths[1:]:
        share(paths[0], path)


def share(source: Path, target: Path) -> None:
    """Make `target` the same file as `source`, or a copy where the file system has no hard links; atomic."""
    with atomic_path(target) as temporary:
        try:
            os.link(source, temporary)
        except OSError:
            shutil.copy2(source, temporary)


def _turntables(plan: Plan) -> dict[Path, dict[Path, FrameTask]]:
    """Return the sheet of each turntable with the frames on it, in order."""
    frames = {path: planned.task for planned in plan.frames for path in planned.task.files}
    sheets: dict[Path, dict[Path, FrameTask]] = {}
    for path in sorted(frames):
        turntable = path.stem.rpartition(".")[0]
        sheets.setdefault(path.with_name(f"{turntable}.sheet.png"), {})[path] = frames[path]
    return sheets


def _shrunk(rgb: Floats) -> Floats:
    """Average whole blocks of pixels so that the longer side comes near `SHEET_SOURCE_SIZE`."""
    height, width = rgb.shape[:2]
    block = min(max(height, width) // SHEET_SOURCE_SIZE, height, width)
    if block < 2:
        return rgb
    rows, columns = height // block, width // block
    blocks = rgb[: rows * block, : columns * block].reshape(rows, block, columns, block, 3)
    averages: Floats = blocks.mean(axis=(1, 3), dtype=np.float32)
    return averages


def _read_ledger(path: Path) -> dict[str, str]:
    try:
        ledger = json.loads(path.read_text())
    except (FileNotFoundError, ValueError):  # lost or spoilt: every picture is made again
        return {}
    return ledger if isinstance(ledger, dict) else {}
