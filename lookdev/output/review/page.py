"""The writer of the folder of a review page: pictures and pixel values of frames, an index, and the page's own code.

The name of a frame's file has a digest of its inputs, so that a later page in the same folder uses the file again. A
ledger, which is a file in the folder, has the SHA-256 of all files.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio

from lookdev.arrays import Bytes
from lookdev.cache import file_digest, output_errors, write_file
from lookdev.errors import OutputError
from lookdev.output.color import DisplayView
from lookdev.output.display import composite, to_display, write_image
from lookdev.output.frame_name import FrameName
from lookdev.output.review.pixels import SQUARE, Comparison, compare_frames, read_pixels, write_pixels_script
from lookdev.output.review.view import view_shader
from lookdev.safe_text import read_json_object

FORMAT = 1
"""The version of the files of frames, which is part of their digests: after a change, all of them are written anew."""

THUMBNAIL = 176
"""Longer side of a frame in the grid, in pixels."""

_STATIC = Path(__file__).with_name("static")
_LEDGER = "data/ledger.json"
# Options of the JPEG of a frame, which the page shows until the pixel values are loaded.
_JPEG = {"Compression": "jpeg:90", "jpeg:subsampling": "4:4:4"}


@dataclass(frozen=True)
class ReviewFrame:
    """An undamaged frame: its EXR, the number in its name, its header, and the EXR of props to composite over it."""

    file: Path
    number: int
    header: Mapping[str, str]
    props_file: Path | None = None


@dataclass(frozen=True)
class ReviewReel:
    """A reel: the frames of one turntable of a look under a rig, at least one."""

    look: str
    rig: str
    turntable: str
    frames: tuple[ReviewFrame, ...]

    @property
    def key(self) -> tuple[str, str, str]:
        """Look, rig and turntable, which identify the reel in any version."""
        return self.look, self.rig, self.turntable


@dataclass(frozen=True)
class Version:
    """A version of the frames, which is an output folder: its name on the page, its reels, and messages of problems."""

    name: str
    folder: Path
    reels: tuple[ReviewReel, ...]
    problems: tuple[str, ...] = ()


@dataclass(frozen=True)
class WrittenPage:
    """The result of writing a page: the numbers of its new and unchanged files, and the size of all files in bytes."""

    new_files: int
    unchanged_files: int
    size: int


def write_review_page(
    folder: Path,
    versions: Sequence[Version],
    view: DisplayView,
    title: str,
    report: Callable[[int, int], None] = lambda *_: None,
) -> WrittenPage:
    """Write the page of one version, or of a new and an old version, into a folder; undamaged files there are reused.

    Each file is written complete or not at all, and after the files to which it refers. Files that no longer belong to
    the page are removed last. After an interruption, the folder has the old page or the new one. `report` is called
    with the number of frames that are done, and the number of all frames. Raises OutputError if a frame is damaged or a
    file cannot be written.
    """
    with output_errors(folder, "the page cannot be written", name_file=True):
        return _PageWriter(folder, view).write(versions, title, report)


class _PageWriter:
    """The writer of the files of a page in a folder, which uses undamaged files of an earlier page again.

    `_ledger` has the SHA-256 of the earlier page's files by name, and `_digests` has it for this page's files.
    """

    def __init__(self, folder: Path, view: DisplayView) -> None:
        self._folder = folder
        self._view = view
        ledger = read_json_object(folder / _LEDGER).items()  # empty if missing: then all files are written anew
        self._ledger = {name: digest for name, digest in ledger if isinstance(digest, str)}
        self._digests: dict[str, str] = {}
        self._new_names: set[str] = set()

    def write(self, versions: Sequence[Version], title: str, report: Callable[[int, int], None]) -> WrittenPage:
        """Write all files of the page, the ledger last, and remove files that no longer belong to it."""
        shader = view_shader(self._view)
        frames = [frame for version in versions for reel in version.reels for frame in reel.frames]
        keys: dict[Path, str] = {}
        with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
            for done, (frame, key) in enumerate(zip(frames, pool.map(self._write_frame, frames), strict=True), 1):
                keys[frame.file] = key
                report(done, len(frames))
            reels = [(number, reel) for number, version in enumerate(versions) for reel in version.reels]
            entries = list(pool.map(lambda item: self._write_reel(item[0], item[1], keys), reels))
            changes = list(_compare_reels(versions, pool)) if len(versions) == 2 else None
        index = {
            "title": title,
            "view": shader,
            "square": SQUARE,
            "versions": [
                {"name": version.name, "folder": str(version.folder), "problems": version.problems}
                for version in versions
            ],
            "reels": entries,
            "changes": changes,
        }
        self._write_text("data/index.js", f"review.start({json.dumps(index, allow_nan=False)});\n")
        for file in sorted(_STATIC.iterdir()):
            if file.is_file():
                name = "index.html" if file.suffix == ".html" else f"static/{file.name}"
                self._write_text(name, file.read_text("utf-8"))
        write_file(self._folder / _LEDGER, json.dumps(self._digests, indent=0, sort_keys=True))
        self._remove_others()
        size = sum((self._folder / name).stat().st_size for name in self._digests)
        return WrittenPage(len(self._new_names), len(self._digests) - len(self._new_names), size)

    def _write_frame(self, frame: ReviewFrame) -> str:
        """Write the picture and the pixel values of a frame, and return the key in the names of these files."""
        props = [file_digest(frame.props_file)] if frame.props_file else []
        key = _content_key(FORMAT, self._view.digest, file_digest(frame.file), *props)
        picture, script = f"data/frames/{key}.jpg", f"data/frames/{key}.js"
        if not (self._reuse(picture) and self._reuse(script)):
            pixels = read_pixels(frame.file, frame.props_file)
            light = composite(pixels.beauty, pixels.alpha, np.zeros(3, np.float32))
            self._write_file(script, lambda path: write_pixels_script(path, key, pixels))
            self._write_file(picture, lambda path: write_image(path, to_display(light, self._view), _JPEG))
        return key

    def _write_reel(self, version: int, reel: ReviewReel, keys: Mapping[Path, str]) -> dict[str, Any]:
        """Write the thumbnails of a reel and the headers of its frames, and return the reel's entry in the index.

        The thumbnails are the sprites of one picture. `keys` has the key of each frame by its EXR.
        """
        names = [keys[frame.file] for frame in reel.frames]
        key = _content_key(FORMAT, THUMBNAIL, names)
        sprite = f"data/reels/{key}.jpg"
        columns = math.ceil(math.sqrt(len(names)))
        if not self._reuse(sprite):
            pictures = [self._folder / f"data/frames/{name}.jpg" for name in names]
            self._write_file(sprite, lambda path: write_image(path, _sprite_sheet(pictures, columns), _JPEG))
        frames = [
            {"key": name, "file": str(frame.file), "header": dict(frame.header), "command": _command(reel, frame)}
            for frame, name in zip(reel.frames, names, strict=True)
        ]
        script = f"data/reels/{_content_key(key, frames)}.js"
        self._write_text(script, f"review.put({json.dumps(script)}, {json.dumps(frames, allow_nan=False)});\n")
        width, height = (int(side) for side in reel.frames[0].header["resolution"].split(" x "))
        return {
            "version": version, "look": reel.look, "rig": reel.rig, "turntable": reel.turntable, "count": len(names),
            "turns": _rotating_part(reel), "width": width, "height": height, "sprite": sprite, "columns": columns,
            "script": script, "numbers": [frame.number for frame in reel.frames],
        }  # fmt: skip

    def _reuse(self, name: str) -> bool:
        """Return whether a file is unchanged since it was written; if so, add it to this page's files."""
        digest = self._digests.get(name) or self._ledger.get(name)
        path = self._folder / name
        if digest is None or not path.is_file() or file_digest(path) != digest:
            return False
        self._digests[name] = digest
        return True

    def _write_file(self, name: str, write: Callable[[Path], None]) -> None:
        """Write a file of the page anew by the function `write`, which gets its path."""
        path = self._folder / name
        write(path)
        self._digests[name] = file_digest(path)
        self._new_names.add(name)

    def _write_text(self, name: str, text: str) -> None:
        """Write a text as a file of the page, unless the file has this text already."""
        data = text.encode("utf-8")
        self._ledger[name] = hashlib.sha256(data).hexdigest()
        if not self._reuse(name):
            self._write_file(name, lambda path: write_file(path, data))

    def _remove_others(self) -> None:
        """Remove the files of an earlier page that this page does not have."""
        for name in self._ledger.keys() - self._digests.keys():
            path = (self._folder / name).resolve()
            if path.is_relative_to(self._folder.resolve()):
                path.unlink(missing_ok=True)


def _compare_reels(versions: Sequence[Version], pool: ThreadPoolExecutor) -> Iterator[dict[str, Any]]:
    """Yield the comparison of each reel of the new and the old version, by the frame that differs most.

    ``state`` is "new" or "removed" for a reel of one version only, and "other frames" if the two versions have no frame
    number in common. Otherwise it is "changed" if pixels differ beyond noise, "same picture" if only inputs or noise
    differ, or "same".
    """
    new, old = ({reel.key: reel for reel in version.reels} for version in versions)
    for key in dict.fromkeys((*new, *old)):
        names = dict(zip(("look", "rig", "turntable"), key, strict=True))
        if key not in old or key not in new:
            yield names | {"state": "new" if key not in old else "removed"}
            continue
        before = {frame.number: frame for frame in old[key].frames}
        pairs = [(frame, before[frame.number]) for frame in new[key].frames if frame.number in before]
        comparisons = list(pool.map(lambda pair: _compare_frame(*pair), pairs))
        if not comparisons:
            yield names | {"state": "other frames"}
            continue
        worst = max(comparisons, key=lambda result: (result.visible, result.beyond or 0.0, result.relmse or 0.0))
        parts = list(dict.fromkeys(part for comparison in comparisons for part in comparison.changed))
        state = "changed" if worst.visible else "same picture" if parts or worst.relmse else "same"
        yield (
            names
            | {"state": state}
            | asdict(replace(worst, changed=tuple(parts)))
            | {
                "frame": pairs[comparisons.index(worst)][0].number,
                "frames": f"{len(comparisons)} of {len({*before, *(frame.number for frame in new[key].frames)})}",
                "headers": _differing_entries(pairs[0][0].header, pairs[0][1].header),
            }
        )


def _compare_frame(new: ReviewFrame, old: ReviewFrame) -> Comparison:
    """Compare two versions of a frame; if both are the same files, they are equal, and their pixels are not read."""
    pairs = ((new.file, old.file), (new.props_file, old.props_file))
    if all(a == b or (a and b and a.samefile(b)) for a, b in pairs):
        return Comparison((), 0.0, 0.0)
    return compare_frames(
        read_pixels(new.file, new.props_file), read_pixels(old.file, old.props_file), new.header, old.header
    )


def _differing_entries(new: Mapping[str, str], old: Mapping[str, str]) -> list[tuple[str, str, str]]:
    """Return the entries in which two headers differ: name, old value and new value.

    The job, digests, times and errors are left out.
    """
    keys = [
        key for key in (*new, *(set(old) - set(new))) if key not in ("job", "seconds", "time", "relmse", "raw.relmse")
    ]
    return [
        (key, old.get(key, ""), new.get(key, ""))
        for key in keys
        if not key.startswith("digest") and old.get(key) != new.get(key)
    ]


def _command(reel: ReviewReel, frame: ReviewFrame) -> str:
    """Return the command that renders a frame again, or "" if its header does not name a job."""
    name = str(FrameName(*reel.key, frame.number))
    job = frame.header.get("job")
    return f"lookdev render {shlex.quote(job)} --force --frame {shlex.quote(name)}" if job else ""


def _rotating_part(reel: ReviewReel) -> str:
    """Return the kind of a reel's turntable: "lighting" if only the lights rotate, otherwise "element", the asset."""
    element = {frame.header.get("pose.element") for frame in reel.frames}
    lighting = {frame.header.get("pose.lighting") for frame in reel.frames}
    return "lighting" if len(element) == 1 and len(lighting) > 1 else "element"


def _sprite_sheet(pictures: Sequence[Path], columns: int) -> Bytes:
    """Return the thumbnails of pictures in one picture, in rows of `columns` cells.

    A cell has the size of the first thumbnail; unused cells are black.
    """
    small = [_thumbnail(picture) for picture in pictures]
    height, width = small[0].shape[:2]
    page = np.zeros((math.ceil(len(small) / columns) * height, columns * width, 3), np.uint8)
    for number, thumbnail in enumerate(small):
        y, x = number // columns * height, number % columns * width
        cell = thumbnail[:height, :width]
        page[y : y + cell.shape[0], x : x + cell.shape[1]] = cell
    return page


def _thumbnail(picture: Path) -> Bytes:
    """Return a picture, scaled down until its longer side is at most `THUMBNAIL`."""
    image = oiio.ImageBuf(str(picture))
    spec = image.spec()
    scale = min(1.0, THUMBNAIL / max(spec.width, spec.height))
    width, height = max(1, round(spec.width * scale)), max(1, round(spec.height * scale))
    small = oiio.ImageBufAlgo.resize(image, filtername="box", roi=oiio.ROI(0, width, 0, height))
    if small.has_error:
        raise OutputError(f"{picture}: cannot be read: {small.geterror().strip()}")
    return np.asarray(small.get_pixels(oiio.UINT8), np.uint8)


def _content_key(*parts: object) -> str:
    """Return a digest of the inputs of a file, for its name."""
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:32]
