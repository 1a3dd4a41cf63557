"""Makes files that show finished frames, such as PNGs, movies and contact sheets, if they are missing or outdated.

An output is a kind of such files (`lookdev.output`). For each file, a ledger (`lookdev.run.ledger`) records the digest
of its content, and a key. The key is a digest of the inputs of the file, which are frames and options. A new view,
another number of frames or a damaged file is therefore detected even if no frame was rendered.

A job may have reference props, such as a colour chart. They are rendered as frames of their own, and composited over
the frames of looks.
"""

from __future__ import annotations

import hashlib
import json
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice, product
from operator import attrgetter
from pathlib import Path

from lookdev.arrays import Floats32, Reals
from lookdev.cache import file_digest, link_or_copy
from lookdev.job import JobOutputs
from lookdev.output.display import composite, composite_layers
from lookdev.output.exr import light_in_rec709, read_rec709
from lookdev.output.frame_name import FrameName
from lookdev.output.record import FrameSequence, Output
from lookdev.plan import Plan, Reel
from lookdev.rendering.task import FrameTask
from lookdev.run.ledger import Ledger

RenderBackground = Callable[[FrameTask], Reals]
"""Returns the linear light behind a frame, with exposure applied: (H, W, 3), or (3,) for a uniform colour."""


@dataclass(frozen=True, eq=False)
class PictureFile:
    """A file to make of finished frames. It has several paths if several turntables show the same frame."""

    output: Output
    paths: tuple[Path, ...]
    title: str
    frames: dict[Path, FrameTask]  # by the path of the frame's EXR, in their order in the file
    labels: tuple[str, ...]  # a label for each frame
    columns: int | None = None  # the number of frames in a row, for a wedge: a table of variations of a look or light


class PictureWriter:
    """The writer of the files that show the frames of a plan.

    Parameters
    ----------
    plan, outputs
        The frames, and the kinds of files to make of them.
    background
        The background of the frames as a value for JSON, which is a part of each file's key.
    light
        The function that returns the light of that background.
    ledger
        The record of files that earlier runs and other runs have made. The caller closes it.
    """

    def __init__(
        self, plan: Plan, outputs: JobOutputs, background: object, light: RenderBackground, ledger: Ledger
    ) -> None:
        self._plan = plan
        self._outputs = outputs
        self._background_light = light
        self._background = background
        self._ledger = ledger
        self._due = set(plan.pictures)  # files that were missing or older than their frame when the plan was made
        self._tasks = {path: planned.task for planned in plan.frames for path in planned.task.files}
        self._sheets: list[PictureFile] = []
        self._files_of_frame = defaultdict[Path, list[PictureFile]](list)
        for output in outputs.enabled_outputs:
            for file in _output_files(plan, output):
                (self._files_of_frame[next(iter(file.frames))] if output.scope == "frame" else self._sheets).append(
                    file
                )

    def refresh_pictures(
        self, task: FrameTask, done: set[Path], pixels: tuple[Floats32, Floats32] | None = None
    ) -> None:
        """Make the files that show this frame alone and are missing or outdated.

        A file is not made yet if reference props are composited over the frame, and the frame of these props is not
        among the files that are `done`. `pixels` are the beauty and the alpha of a new frame: if they are given, all
        files of the frame are made from them.

        Raises
        ------
        OutputError
            The frame cannot be read, or a file cannot be written.
        """
        for file in self._files_of_frame[task.files[0]]:
            if not self._props_over(file) <= done:
                continue
            key = self._key(file)
            due = [path for path in file.paths if pixels or path in self._due or not self._is_current(path, key)]
            if due:
                self.write(file, due, pixels)

    def refresh_frames_under(self, task: FrameTask, done: set[Path]) -> None:
        """Call `refresh_pictures` for all frames that are `done` and over which a new frame of props is composited."""
        frames = {self._tasks[frame].files for frame, props in self._plan.charts.items() if props in task.files}
        for files in frames:
            if files[0] in done:
                self.refresh_pictures(self._tasks[files[0]], done)

    def finished_sheets(self, done: set[Path], task: FrameTask | None = None) -> Iterator[PictureFile]:
        """Yield the files that show several frames, if all of their frames are `done`.

        With `task`, yield only the files that show the frame of the task. If it is a frame of reference props, these
        are the files in which the props are composited over frames.
        """
        for file in self._sheets:
            inputs = file.frames.keys() | self._props_over(file)
            if inputs <= done and not (task is not None and inputs.isdisjoint(task.files)):
                yield file

    def is_due(self, file: PictureFile) -> bool:
        """Return whether a file is missing or out of date."""
        return not self._is_current(file.paths[0], self._key(file))

    def write(self, file: PictureFile, paths: Sequence[Path], pixels: tuple[Floats32, Floats32] | None = None) -> None:
        """Write a file to some of its paths, and record it in the ledger.

        `pixels` are the beauty and the alpha of its only frame. Without them, frames are read from disk.
        """

        def layers(frame: Path) -> tuple[Floats32, Floats32]:
            """Return the premultiplied light and the alpha of a frame, with reference props composited over it."""
            props = self._plan.charts.get(frame)
            if pixels is None:
                layer = read_rec709(frame)
            else:
                layer = light_in_rec709(pixels[0], file.frames[frame].scene.space), pixels[1]
            return layer if props is None else composite_layers(read_rec709(props), layer)

        def light(frame: Path) -> Floats32:
            """Return the light of a frame over the background."""
            return composite(*layers(frame), self._background_light(file.frames[frame]))

        frames = FrameSequence(
            tuple(file.frames), file.labels, file.title, self._options(file.output), light, layers, file.columns
        )
        file.output.write(paths[0], frames)
        link_to_first(paths)
        key = self._key(file)
        digest = file_digest(paths[0])
        for path in paths:
            self._ledger.add(self._name(path), key, digest)

    def _props_over(self, file: PictureFile) -> set[Path]:
        """Return the frames of reference props that are composited over the frames of a file."""
        return {self._plan.charts[frame] for frame in file.frames if frame in self._plan.charts}

    def _key(self, file: PictureFile) -> str:
        """Return the key of a file: a digest of its frames, their labels, the background and the options."""
        digests = [task.digest for task in file.frames.values()]
        digests += [self._tasks[self._plan.charts[frame]].digest for frame in file.frames if frame in self._plan.charts]
        inputs = [digests, file.labels, self._background, self._options(file.output)]
        inputs += [file.columns] if file.columns else []
        # Inputs that JSON does not know, such as a view, have an attribute `digest`.
        return hashlib.sha256(json.dumps(inputs, default=attrgetter("digest")).encode()).hexdigest()

    def _options(self, output: Output) -> dict[str, object]:
        """Return the options of an output, as `FrameSequence.options`."""
        options = {name: getattr(self._outputs, name) for name in output.options}
        burn_in = {"burn_in": True} if output.name in self._outputs.burn_in else {}
        return {"view": self._outputs.display_view(output.name), **burn_in, **options}

    def _is_current(self, path: Path, key: str) -> bool:
        """Return whether a file exists and has the content that belongs to a key."""
        return path.is_file() and self._ledger.has(self._name(path), key, path)

    def _name(self, path: Path) -> str:
        """Return the name of a file in the ledger: its path relative to the output folder."""
        return path.relative_to(self._plan.output).as_posix()


def link_to_first(paths: Sequence[Path]) -> None:
    """Make the file at the first path also appear at the other paths, by links or copies."""
    for path in paths[1:]:
        link_or_copy(paths[0], path)


def _output_files(plan: Plan, output: Output) -> Iterator[PictureFile]:
    """Yield all files that an output makes of the frames of a plan, by the output's scope.

    A reel has the frames of one look under one light in one turntable.
    """
    tasks = {path: planned.task for planned in plan.frames for path in planned.task.files}

    def file(paths: Iterable[Path], title: Iterable[str], frames: Iterable[Path], labels: Iterable[str]) -> PictureFile:
        """Return a file of some frames; `title` has the parts of its title."""
        return PictureFile(
            output, tuple(paths), " / ".join(title), {path: tasks[path] for path in frames}, tuple(labels)
        )

    if output.scope == "frame":
        for files in (planned.task.files for planned in plan.frames):
            title = str(FrameName.of(files[0])).split("/")
            yield file((path.with_suffix(output.suffix) for path in files), title, files[:1], [_digits(files[0])])
    elif output.scope == "turntable":
        for reel in plan.reels:
            path = reel.files[0].with_name(reel.turntable + output.suffix)
            yield file([path], (reel.look, reel.ibl, reel.turntable), reel.files, map(_digits, reel.files))
    elif output.scope == "wedge":
        reels_of = {(reel.look, reel.ibl, reel.turntable): reel for reel in plan.reels}
        for sheet, turntable in product(plan.sheets, dict.fromkeys(reel.turntable for reel in plan.reels)):
            cells = [reels_of[look, rig, turntable].files[0] for look, rig in sheet.cells]
            path = plan.output / sheet.look / sheet.rig / f"{turntable}.{sheet.name}{output.suffix}"
            yield replace(file([path], (turntable, sheet.title), cells, sheet.labels), columns=sheet.columns)
    else:
        sides: dict[tuple[str, str], list[Reel]] = {}  # the reels to show side by side, by light and turntable
        for reel in plan.reels:
            sides.setdefault((reel.ibl, reel.turntable), []).append(reel)
        for (ibl, turntable), reels in sides.items():
            path = plan.output / ibl / (turntable + output.suffix)
            all_steps = zip(*(reel.files for reel in reels), strict=True)
            steps = all_steps if output.scope == "looks in step" else islice(all_steps, 1)
            yield file([path], (ibl, turntable), chain.from_iterable(steps), (reel.look for reel in reels))


def _digits(frame: Path) -> str:
    """Return the frame number of a file, as in its name."""
    return FrameName.of(frame).digits
