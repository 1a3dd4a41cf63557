"""A plan as text, and as data for a program."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import timedelta
from itertools import groupby
from pathlib import Path

from lookdev.codegen import ShaderSource
from lookdev.plan import Plan, PlannedFile
from lookdev.plan.chunks import split
from lookdev.plan.costs import estimated

LINKED = "shown by another frame that is done: linked, not rendered"


@dataclass(frozen=True)
class Range:
    """Consecutive frames of a turntable that are in the same state for the same reason."""

    turntable: str  # look/ibl/turntable
    first: str
    last: str
    count: int
    state: str
    reason: str


def plan_ranges(plan: Plan, output: Path) -> Iterator[Range]:
    """Group the files of a plan, turntable by turntable in the plan's order."""
    linked = {copy.target for copy in plan.copies()}
    turntables: dict[str, list[PlannedFile]] = {}
    for frame in plan.frames:
        for file in frame.files:
            turntable, _, _ = file.path.relative_to(output).with_suffix("").as_posix().rpartition(".")
            turntables.setdefault(turntable, []).append(file)

    def of_file(file: PlannedFile) -> tuple[str, str]:
        return file.state, LINKED if file.path in linked else file.reason

    for turntable, files in turntables.items():
        for (state, reason), group in groupby(sorted(files, key=lambda file: file.path), key=of_file):
            numbers = [file.path.stem.rpartition(".")[2] for file in group]
            yield Range(turntable, numbers[0], numbers[-1], len(numbers), state, reason)


def plan_text(plan: Plan, output: Path) -> str:
    """Return a plan as an aligned table, a line for each scene with skips, and lines of sums."""
    rows = [("turntable", "frames", "state", "reason")]
    for part in plan_ranges(plan, output):
        numbers = part.first if part.count == 1 else f"{part.first}-{part.last}"
        rows.append((part.turntable, numbers, part.state, part.reason))
    lines = [_table(rows)]
    for (look, ibl), skips in groupby(plan.skips, key=lambda skip: (skip.look, skip.ibl)):
        lines.append(f"{look}/{ibl} skipped: {', '.join(map(str, skips))}")
    counts = ", ".join(f"{count} {state}" for state, count in plan.counts.items())
    lines.append(f"{len(plan.pending())} of {len(plan.frames)} frames to render (files: {counts})")
    sources, programs = _programs(plan)
    if programs < sources:
        lines.append(f"{programs} programs to compile for {sources} looks, of which others differ in numbers alone")
    if plan.pictures:
        lines.append(f"{len(plan.pictures)} pictures to make from frames that are done")
    return "\n".join(lines)


def _programs(plan: Plan) -> tuple[int, int]:
    """Count the OSL shaders of the frames to render, and the programs that are compiled for them."""
    scenes = {id(task.scene): task.scene for task in plan.pending()}.values()
    sources = {shader for scene in scenes for shader in scene.shaders if isinstance(shader, ShaderSource)}
    return len(sources), len({source.program for source in sources})


def plan_data(plan: Plan, output: Path) -> dict[str, object]:
    """Return a plan as plain data for JSON: a record for each file and skip; paths are relative to `output`."""

    def name(path: Path) -> str:
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
        **dict(zip(("shaders", "programs"), _programs(plan), strict=True)),
    }


@dataclass(frozen=True)
class ChunkSummary:
    """A chunk as `lookdev plan --chunks` lists it: its frames, by the names of the first and the last."""

    chunk: str
    frames: int
    done: int
    scenes: int
    seconds: float  # estimated, of all frames, preparing their scenes included
    first: str | None
    last: str | None


def chunk_summaries(plan: Plan, count: int) -> list[ChunkSummary]:
    """Return the parts of a plan, as `lookdev render --chunk` has them."""
    scenes = [frame.task.scene for frame in plan.frames]
    costs = estimated(scenes)
    ends = split(scenes, costs, count)
    found, first = [], 0
    for number, end in enumerate(ends, start=1):
        frames = plan.frames[first:end]
        names = [each.files[0].path.relative_to(plan.output).with_suffix("").as_posix() for each in frames]
        shown = len({id(scene) for scene in scenes[first:end]})
        seconds = sum(costs.frames[first:end]) + shown * costs.scene
        done = sum(any(file.state == "done" for file in frame.files) for frame in frames)
        ends_at = (names[0], names[-1]) if names else (None, None)
        found.append(ChunkSummary(f"{number}/{count}", len(frames), done, shown, seconds, *ends_at))
        first = end
    return found


def chunks_text(plan: Plan, count: int) -> str:
    """Return the parts of a plan as an aligned table."""
    rows = [["chunk", "frames", "done", "scenes", "time", "first", "last"]]
    for each in chunk_summaries(plan, count):
        time = timedelta(seconds=round(each.seconds))
        row = each.chunk, each.frames, each.done, each.scenes, time, each.first or "-", each.last or "-"
        rows.append([str(cell) for cell in row])
    return _table(rows)


def chunks_data(plan: Plan, count: int) -> dict[str, object]:
    """Return the parts of a plan as plain data for JSON."""
    return {"output": str(plan.output), "chunks": [asdict(each) for each in chunk_summaries(plan, count)]}


def _table(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    )
