"""The output of `lookdev plan`: a plan as text, and as data for other programs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path

from lookdev.codegen.source import ShaderSource
from lookdev.output.frame_name import FrameName
from lookdev.plan import Plan, PlannedFile
from lookdev.safe_text import align_columns

LINKED_REASON = "shown by another frame that is done: linked, not rendered"
"""The listed reason for a file that is not rendered, because a finished file of the same frame is linked or copied."""


@dataclass(frozen=True)
class FrameRange:
    """Consecutive frames of a turntable that are in the same state for the same reason."""

    turntable: str  # in the form look/ibl/turntable
    first: str  # the digits of the first frame, such as "0001"
    last: str
    count: int
    state: str  # as `PlannedFile.state`
    reason: str


def plan_ranges(plan: Plan) -> Iterator[FrameRange]:
    """Yield the files of a plan in ranges, turntable by turntable in the plan's order."""
    linked = {copy.target for copy in plan.copies()}
    turntables: dict[str, list[PlannedFile]] = {}
    for frame in plan.frames:
        for file in frame.files:
            turntables.setdefault("/".join(FrameName.of(file.path).reel), []).append(file)

    def state_and_reason(file: PlannedFile) -> tuple[str, str]:
        return file.state, LINKED_REASON if file.path in linked else file.reason

    for turntable, files in turntables.items():
        for (state, reason), group in groupby(sorted(files, key=lambda file: file.path), key=state_and_reason):
            numbers = [FrameName.of(file.path).digits for file in group]
            yield FrameRange(turntable, numbers[0], numbers[-1], len(numbers), state, reason)


def plan_text(plan: Plan) -> str:
    """Return a plan as text: a table of files, the work that is skipped for each look and light, and totals."""
    rows = [("turntable", "frames", "state", "reason")]
    for group in plan_ranges(plan):
        numbers = group.first if group.count == 1 else f"{group.first}-{group.last}"
        rows.append((group.turntable, numbers, group.state, group.reason))
    lines = align_columns(rows)
    for (look, ibl), skips in groupby(plan.skips, key=lambda skip: (skip.look, skip.ibl)):
        lines.append(f"{look}/{ibl} skipped: {', '.join(map(str, skips))}")
    counts = ", ".join(f"{count} {state}" for state, count in plan.counts.items())
    lines.append(f"{len(plan.pending())} of {len(plan.frames)} frames to render (files: {counts})")
    sources, programs = _program_counts(plan)
    if programs < sources:
        lines.append(f"{programs} programs to compile for {sources} looks, of which others differ in numbers alone")
    if plan.pictures:
        lines.append(f"{len(plan.pictures)} pictures to make from frames that are done")
    return "\n".join(lines)


def _program_counts(plan: Plan) -> tuple[int, int]:
    """Return the number of OSL sources of the frames to render, and the number of programs to compile for them.

    Sources that differ only in numbers share a program.
    """
    scenes = {id(task.scene): task.scene for task in plan.pending()}.values()
    sources = {shader for scene in scenes for shader in scene.shaders if isinstance(shader, ShaderSource)}
    return len(sources), len({source.program for source in sources})


def plan_data(plan: Plan, output: Path) -> dict[str, object]:
    """Return a plan as plain data for JSON, with a record for each file and each `Skip`.

    Paths are relative to `output`.
    """

    def name(path: Path) -> str:
        """Return the path of a file relative to `output`."""
        return path.relative_to(output).as_posix()

    return {
        "output": str(output),
        "files": [
            {"path": name(file.path), "state": file.state, "reason": file.reason, "digest": frame.task.digest}
            | asdict(frame.task.pose)
            for frame in plan.frames
            for file in frame.files
        ],
        "links": [{"source": name(copy.source), "target": name(copy.target)} for copy in plan.copies()],
        "pictures": [name(path) for path in plan.pictures],
        "skipped": [asdict(skip) for skip in plan.skips],
        "render": len(plan.pending()),
        **dict(zip(("shaders", "programs"), _program_counts(plan), strict=True)),
    }
