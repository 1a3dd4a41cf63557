"""`lookdev review`: a page of the frames in an output folder, alone or against those of another version."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from lookdev.errors import OutputError, shorten
from lookdev.output.color import DisplayView
from lookdev.output.exr import read_header
from lookdev.output.frame_name import FRAME_PATTERN, frame_files
from lookdev.output.manifest import STATE_FOLDER, read_manifest
from lookdev.output.review import Reel, ReviewFrame, Version, write_page
from lookdev.output.review.page import Written
from lookdev.scene.charts import FOLDER, STRIP

PAGE_FOLDER = "review"
"""Folder of the page inside the output folder, unless another is named."""

_MOST = 5  # damaged frames that a message names


def review(
    folder: Path,
    against: Path | None = None,
    to: Path | None = None,
    view: str | None = None,
    report: Callable[[int, int], None] = lambda done, of: None,
) -> tuple[Path, Written, tuple[str, ...]]:
    """Write the review page of an output folder; return its index, what was written, and notes for the user.

    Parameters
    ----------
    folder, against
        The output folder of a job, and that of an earlier version.
    to
        The folder of the page; None: ``review`` in `folder`.
    view
        Of `lookdev.output.color.VIEWS`; None: that of the job's pictures, by the manifest of `folder`, or if there is
        none, that of a job which sets none.
    report
        Is called with frames that are done, and all.

    Raises
    ------
    OutputError
        A folder has no frames, or none that is whole; a file cannot be written.
    """
    to = (folder / PAGE_FOLDER if to is None else to).absolute()
    versions = [find_version(each, to) for each in (folder, against) if each is not None]
    if against is not None and versions[0].folder == versions[1].folder:
        raise OutputError(f"{against}: is the same folder; --against names that of another version")
    names = _names([version.folder for version in versions])
    versions = [
        Version(name, each.folder, each.reels, each.problems) for name, each in zip(names, versions, strict=True)
    ]
    written = write_page(to, versions, DisplayView(view) if view else _job_view(folder), versions[0].name, report)
    return to / "index.html", written, tuple(note for version in versions for note in version.problems)


def find_version(folder: Path, page: Path) -> Version:
    """Return the frames of an output folder, with the reference props over each.

    Damaged frames are left out, and are among its problems; the folder `page` is passed over. Raises OutputError where
    no frame is left.
    """
    if not folder.is_dir():
        raise OutputError(f"{folder}: no such folder; the output folder of a job would be right")
    folder = folder.absolute()
    reels: dict[tuple[str, str, str], list[ReviewFrame]] = {}
    problems, doubted = list[str](), set[str]()
    for name, file in frame_files(folder):
        if name.look == STATE_FOLDER or file.is_relative_to(page):
            continue
        try:
            header = read_header(file)
        except OutputError as error:
            problems.append(f"{file}: is left out: {str(error).removeprefix(f'{file}: ')}")
            continue
        if "digest" not in header:
            problems.append(f"{file}: is left out: not written by lookdev")
            continue
        if "charts.doubt" in header and header["digest"] not in doubted:
            doubted.add(header["digest"])  # one picture has several names
            problems.append(f"{file}: {header['charts.doubt']}")
        reels.setdefault(name.reel, []).append(ReviewFrame(file, name.number, header))
    if not reels:
        why = f": {'; '.join(map(shorten, problems[:_MOST]))}" if problems else ""
        raise OutputError(f"{folder}: has no frames, {FRAME_PATTERN}.exr{why}")
    props = {
        frame.file.relative_to(folder / FOLDER): frame.file
        for (look, _, _), frames in reels.items()
        for frame in frames
        if look == FOLDER and STRIP in frame.header and _has_props(folder)
    }
    made = []
    for key, frames in sorted(reels.items(), key=lambda each: each[0][0] == FOLDER):  # props after the looks
        files = [frame.file.relative_to(folder / key[0]) for frame in frames]
        over = [props.get(file) if key[0] != FOLDER else None for file in files]
        made.append(Reel(*key, tuple(replace(f, over=each) for f, each in zip(frames, over, strict=True))))
    return Version(folder.name, folder, tuple(made), tuple(problems))


def _has_props(folder: Path) -> bool:
    """Return whether frames of props that are in a folder belong to its job, as far as it is known."""
    try:
        return "charts" in read_manifest(folder)["settings"]
    except (OutputError, KeyError, TypeError):
        return True


def _job_view(folder: Path) -> DisplayView:
    try:
        return DisplayView(**read_manifest(folder)["view"])
    except (OutputError, KeyError, TypeError):  # an output of an earlier version, or made by hand
        return DisplayView()


def _names(folders: list[Path]) -> list[str]:
    """Return names of folders by which they differ."""
    depth = 1
    while len({folder.parts[-depth:] for folder in folders}) < len(folders):
        depth += 1
    return ["/".join(folder.parts[-depth:]) for folder in folders]
