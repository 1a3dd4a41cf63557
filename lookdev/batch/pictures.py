"""Display pictures and contact sheets, made from frames, and made again only when they would differ.

A ledger in the output's state folder records the frame digests and the view of each picture, so that a new view or
another number of frames makes it again without rendering.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookdev.batch.lock import STATE_FOLDER
from lookdev.cache import atomic_path, share
from lookdev.job import JobOutputs
from lookdev.output.display import composite, to_display, write_pixels
from lookdev.output.exr import read_frame
from lookdev.output.sheet import write_sheet
from lookdev.plan import Plan, Reel
from lookdev.render.task import FrameTask

Floats = NDArray[np.float32]
Background = Callable[[FrameTask], NDArray[np.float32] | NDArray[np.float64]]
"""Returns the linear light behind a frame, exposure applied: (H, W, 3), or (3,) for one colour."""

SHEET_SOURCE_SIZE = 512
"""Pixels. Larger frames are averaged down on reading, which bounds the memory of a sheet."""

OVERVIEW_CELLS = (128, 256)
"""Pixels, smallest and largest; the smallest leaves space for the names below."""


@dataclass(frozen=True)
class _Sheet:
    """A sheet: its frames in order, the labels below them, and their layout."""

    path: Path
    title: str
    frames: dict[Path, FrameTask]
    labels: tuple[str, ...]
    cell: int = 256
    columns: int | None = None


class Pictures:
    """The PNGs and sheets of a plan; `light` is that of `background`, which the ledger records."""

    def __init__(self, plan: Plan, outputs: JobOutputs, background: object, light: Background) -> None:
        self._outputs = outputs
        self._root = plan.output
        self._background = light
        self._behind = background
        self._ledger_file = plan.output / STATE_FOLDER / "pictures.json"
        self._ledger = _read_ledger(self._ledger_file)
        self._overdue = set(plan.pictures)
        self._sheets = tuple(_sheets(plan, outputs))

    def refresh(self, task: FrameTask) -> None:
        """Make the PNGs of a frame on disk that are missing or out of date; OutputError where that fails."""
        key = self._picture_key(task)
        due = [
            path.with_suffix(".png")
            for path in task.files
            if path in self._overdue or not self._is_current(path.with_suffix(".png"), key)
        ]
        if self._outputs.png and due:
            self._write(task, due, *read_frame(task.files[0]))

    def write(self, task: FrameTask, beauty: Floats, alpha: Floats) -> None:
        """Make the PNGs of a new frame, unless the job has none."""
        if self._outputs.png:
            self._write(task, [path.with_suffix(".png") for path in task.files], beauty, alpha)

    def refresh_sheets(self, done: set[Path], task: FrameTask | None = None) -> list[Path]:
        """Make the sheets that are out of date and whose frames are all done; return their paths.

        With `task`, a new frame, make those that show it, and no others.
        """
        written = []
        for sheet in self._sheets:
            if task is not None and sheet.frames.keys().isdisjoint(task.files):
                continue
            key = self._sheet_key(sheet)
            if sheet.frames.keys() <= done and (task is not None or not self._is_current(sheet.path, key)):
                self._write_sheet(sheet)
                self._record([sheet.path], key)
                written.append(sheet.path)
        return written

    def _write(self, task: FrameTask, paths: Sequence[Path], beauty: Floats, alpha: Floats) -> None:
        pixels = to_display(composite(beauty, alpha, self._background(task)), self._outputs.view)
        write_shared(paths, lambda path: write_pixels(path, pixels))
        self._record(paths, self._picture_key(task))

    def _write_sheet(self, sheet: _Sheet) -> None:
        shown = []
        for path, task in sheet.frames.items():
            rgb = composite(*read_frame(path), self._background(task))
            shown.append(to_display(_shrunk(rgb), self._outputs.view))
        write_sheet(sheet.path, shown, sheet.labels, sheet.title, sheet.columns, sheet.cell)

    def _picture_key(self, task: FrameTask) -> str:
        return f"{task.digest} {self._behind} {self._outputs.view}"

    def _sheet_key(self, sheet: _Sheet) -> str:
        keys = [*(self._picture_key(task) for task in sheet.frames.values()), *sheet.labels, str(sheet.columns)]
        return hashlib.sha256("\n".join(keys).encode()).hexdigest()

    def _is_current(self, path: Path, key: str) -> bool:
        return self._ledger.get(self._name(path)) == key and path.exists()

    def _record(self, paths: Iterable[Path], key: str) -> None:
        self._ledger |= {self._name(path): key for path in paths}
        with atomic_path(self._ledger_file) as temporary:
            temporary.write_text(json.dumps(self._ledger, indent=0))

    def _name(self, path: Path) -> str:
        return path.relative_to(self._root).as_posix()


def write_shared(paths: Sequence[Path], write: Callable[[Path], None]) -> None:
    """Write the first path, and share its content with the others."""
    write(paths[0])
    for path in paths[1:]:
        share(paths[0], path)


def _sheets(plan: Plan, outputs: JobOutputs) -> Iterator[_Sheet]:
    """Yield a sheet for each turntable of a look under a light, then the overviews, as `outputs` selects."""
    tasks = {path: planned.task for planned in plan.frames for path in planned.task.files}
    for reel in plan.reels if outputs.sheet else ():
        yield _Sheet(
            reel.files[0].with_name(f"{reel.turntable}.sheet.png"),
            f"{reel.look} / {reel.ibl} / {reel.turntable}",
            {path: tasks[path] for path in reel.files},
            tuple(path.stem.rpartition(".")[2] for path in reel.files),
        )
    least, most = OVERVIEW_CELLS
    sides: dict[tuple[str, str], list[Reel]] = {}
    for reel in plan.reels if outputs.overview else ():
        sides.setdefault((reel.ibl, reel.turntable), []).append(reel)
    for (ibl, turntable), reels in sides.items():
        firsts = {reel.files[0]: tasks[reel.files[0]] for reel in reels}
        size = max(side for task in firsts.values() for side in task.scene.resolution)
        yield _Sheet(
            plan.output / ibl / f"{turntable}.looks.png",
            f"{ibl} / {turntable}",
            firsts,
            tuple(reel.look for reel in reels),
            min(max(least, size), most),
            outputs.overview_columns,
        )


def _shrunk(rgb: Floats) -> Floats:
    """Average whole blocks of pixels so that the longer side comes near `SHEET_SOURCE_SIZE`."""
    height, width = rgb.shape[:2]
    block = min(max(height, width) // SHEET_SOURCE_SIZE, height, width)
    if block < 2:
        return rgb
    rows, columns = height // block, width // block
    blocks = rgb[: rows * block, : columns * block].reshape(rows, block, columns, block, 3)
    return np.asarray(blocks.mean(axis=(1, 3), dtype=np.float32))


def _read_ledger(path: Path) -> dict[str, str]:
    try:
        ledger = json.loads(path.read_text())
    except (FileNotFoundError, ValueError):  # every picture is made again
        return {}
    return ledger if isinstance(ledger, dict) else {}
