"""The command `lookdev review`: it finds the frames of an output folder, and of another version of it, for the page.

A frame can have a frame of reference props, such as a grey ball and a colour chart; the page shows the props over it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from lookdev.errors import OutputError, shorten
from lookdev.output.color import DisplayView
from lookdev.output.exr import read_header
from lookdev.output.frame_name import FRAME_PATTERN, frame_files
from lookdev.output.manifest import STATE_FOLDER, read_manifest
from lookdev.output.review.page import ReviewFrame, ReviewReel, Version, WrittenPage, write_review_page
from lookdev.scene.charts.props import PROPS_FOLDER, PROPS_STRIP_KEY

PAGE_FOLDER = "review"
"""Default folder of the page inside the output folder."""

_MAX_PROBLEMS = 5  # number of damaged frames that a message names


def review(
    folder: Path,
    against: Path | None = None,
    to: Path | None = None,
    view: str | None = None,
    report: Callable[[int, int], None] = lambda done, of: None,
) -> tuple[Path, WrittenPage, tuple[str, ...]]:
    """Write the review page of an output folder; return its ``index.html``, counts of files, and notes for the user.

    Parameters
    ----------
    folder, against
        The output folder of a job, and the output folder of an earlier version.
    to
        The folder of the page; by default ``review`` in `folder`.
    view
        One of `lookdev.output.color.VIEWS`. The default is the view of the job's pictures by the manifest of `folder`;
        without a manifest, the default view of jobs.
    report
        Function that is called with the number of frames that are done, and the number of all frames.

    Raises
    ------
    OutputError
        A folder has no frames, or only damaged ones; a file cannot be written.
    """
    to = (folder / PAGE_FOLDER if to is None else to).absolute()
    versions = [read_version(output, to) for output in (folder, against) if output is not None]
    if against is not None and versions[0].folder == versions[1].folder:
        raise OutputError(f"{against}: is the same folder; --against names that of another version")
    names = _distinct_names([version.folder for version in versions])
    versions = [replace(version, name=name) for name, version in zip(names, versions, strict=True)]
    written = write_review_page(
        to, versions, DisplayView(view) if view else _job_view(folder), versions[0].name, report
    )
    return to / "index.html", written, tuple(note for version in versions for note in version.problems)


def read_version(folder: Path, page: Path) -> Version:
    """Return the frames of an output folder, each with the frame of reference props to composite over it, if any.

    Damaged frames are left out; `Version.problems` lists them. Frames in the folder `page` are skipped. Raises
    OutputError where no frame is left.
    """
    if not folder.is_dir():
        raise OutputError(f"{folder}: no such folder; the output folder of a job would be right")
    folder = folder.absolute()
    reels: dict[tuple[str, str, str], list[ReviewFrame]] = {}
    problems, doubted_digests = list[str](), set[str]()
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
        # The header states a doubt if the frame's props differ from their prediction (`lookdev.checks.charts`). Several
        # frames can be the same picture, with the same digest; a doubt about it is listed once.
        if "charts.doubt" in header and header["digest"] not in doubted_digests:
            doubted_digests.add(header["digest"])
            problems.append(f"{file}: {header['charts.doubt']}")
        reels.setdefault(name.reel, []).append(ReviewFrame(file, name.number, header))
    if not reels:
        reason = f": {'; '.join(map(shorten, problems[:_MAX_PROBLEMS]))}" if problems else ""
        raise OutputError(f"{folder}: has no frames, {FRAME_PATTERN}.exr{reason}")
    # The frames of props, by their paths below PROPS_FOLDER. A frame of a look has the props at the same path: its path
    # below the folder of the look.
    props = {
        frame.file.relative_to(folder / PROPS_FOLDER): frame.file
        for (look, _, _), frames in reels.items()
        for frame in frames
        if look == PROPS_FOLDER and PROPS_STRIP_KEY in frame.header
    }
    if props and not _has_props(folder):
        props.clear()
    complete = []
    for key, frames in sorted(reels.items(), key=lambda item: item[0][0] == PROPS_FOLDER):  # props after the looks
        if key[0] != PROPS_FOLDER:
            frames = [replace(frame, props_file=props.get(frame.file.relative_to(folder / key[0]))) for frame in frames]
        complete.append(ReviewReel(*key, tuple(frames)))
    return Version(folder.name, folder, tuple(complete), tuple(problems))


def _has_props(folder: Path) -> bool:
    """Return whether the job of an output folder has reference props by the manifest; True if there is no manifest."""
    try:
        return "charts" in read_manifest(folder)["settings"]
    except (OutputError, KeyError, TypeError):
        return True


def _job_view(folder: Path) -> DisplayView:
    """Return the view of the job's pictures by the manifest of its output folder, or else the default view."""
    try:
        return DisplayView(**read_manifest(folder)["view"])
    except (OutputError, KeyError, TypeError):  # an output of an earlier version, or made by hand
        return DisplayView()


def _distinct_names(folders: list[Path]) -> list[str]:
    """Return a name for each folder: the shortest end of its path such that all names differ."""
    depth = 1
    while len({folder.parts[-depth:] for folder in folders}) < len(folders):
        depth += 1
    return ["/".join(folder.parts[-depth:]) for folder in folders]
