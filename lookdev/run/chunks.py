"""The chunks of a job: which frames each has, the same for runs on any machine at any time.

The division follows from the job and the numbers of chunks and machines alone, by estimates: not from what is on disk,
which changes while chunks are rendered. One by measured times is made on request, before the first chunk, and kept in
the output's state folder, where all runs find it.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from datetime import timedelta
from pathlib import Path

from lookdev.cache import atomic_path
from lookdev.errors import LookdevError, OutputError
from lookdev.output.frame_name import FrameName
from lookdev.output.manifest import STATE_FOLDER
from lookdev.plan import Plan
from lookdev.plan.chunks import Chunk, Costs, Division, part_of, split
from lookdev.plan.costs import estimated, measured
from lookdev.run.listing import table
from lookdev.run.runs import Runs
from lookdev.text import TextError, parse_json, read_text


@dataclass(frozen=True)
class ChunkSummary:
    """A chunk as `lookdev plan --chunks` lists it: its frames, by the names of the first and the last."""

    chunk: str
    frames: int
    done: int
    scenes: int
    seconds: float  # of all its frames, done or not, preparing their scenes included
    first: str | None
    last: str | None


def plan_of_chunk(plan: Plan, chunk: Chunk) -> Plan:
    """Return a chunk of a plan."""
    return part_of(plan, _kept(plan, chunk.of) or _divided(plan, chunk.of, estimated(plan)), chunk.number)


def store_measured_chunks(plan: Plan, division: Division) -> None:
    """Divide a plan by the times of frames on disk, and keep the division for chunks to come.

    Raises LookdevError where no frame is on disk, OutputError where a chunk of such a division is at work, OSError
    where the output folder cannot be written.
    """
    if all(frame.seconds is None for frame in plan.frames):
        raise LookdevError(
            f"{plan.output}: no frame of the job was rendered yet, whose time could be that of others; render one of "
            "each look and light with 'lookdev render JOB --frame NAME'"
        )
    file = _file(plan, division)
    for run in Runs(file.parent).alive():
        if run.part.endswith(f"/{division}"):
            raise OutputError(f"{plan.output}: {run} renders chunk {run.part} of the division that would be replaced")
    with atomic_path(file) as temporary:
        temporary.write_text(json.dumps(_divided(plan, division, measured(plan))))


def chunk_summaries(plan: Plan, division: Division) -> list[ChunkSummary]:
    """Return the chunks of a plan, their times by frames on disk as far as there are some."""
    costs = measured(plan)
    ends = _kept(plan, division) or _divided(plan, division, estimated(plan))
    found, first = [], 0
    for number, end in enumerate(ends, start=1):
        frames = plan.frames[first:end]
        names = [str(FrameName.of(frame.task.files[0])) for frame in frames]
        scenes = len({id(frame.task.scene) for frame in frames})
        seconds = sum(costs.frames[first:end]) + scenes * costs.scene
        done = sum(any(file.state == "done" for file in frame.files) for frame in frames)
        shown = (names[0], names[-1]) if names else (None, None)
        found.append(ChunkSummary(str(Chunk(number, division)), len(frames), done, scenes, seconds, *shown))
        first = end
    return found


def chunks_text(plan: Plan, division: Division) -> str:
    """Return the chunks of a plan as an aligned table."""
    rows = [["chunk", "frames", "done", "scenes", "time", "first", "last"]]
    for each in chunk_summaries(plan, division):
        time = timedelta(seconds=round(each.seconds))
        row = each.chunk, each.frames, each.done, each.scenes, time, each.first or "-", each.last or "-"
        rows.append([str(cell) for cell in row])
    return table(rows)


def chunks_data(plan: Plan, division: Division) -> dict[str, object]:
    """Return the chunks of a plan as plain data for JSON."""
    return {"output": str(plan.output), "chunks": [asdict(each) for each in chunk_summaries(plan, division)]}


def forget_chunks(state: Path) -> None:
    """Remove the divisions of an output whose frames are all done."""
    for file in state.glob("chunks.*.json"):
        file.unlink(missing_ok=True)


def _divided(plan: Plan, division: Division, costs: Costs) -> tuple[int, ...]:
    return split([id(frame.task.scene) for frame in plan.frames], costs, division)


def _file(plan: Plan, division: Division) -> Path:
    return plan.output / STATE_FOLDER / f"chunks.{division}.{plan.digest[:16]}.json"


def _kept(plan: Plan, division: Division) -> tuple[int, ...] | None:
    """Return the ends of the chunks that are kept; None where there are none, or they are damaged."""
    file = _file(plan, division)
    try:
        ends = parse_json(read_text(file), file)
    except TextError:
        return None
    if not isinstance(ends, list) or len(ends) != division.count or not all(isinstance(end, int) for end in ends):
        return None
    return tuple(ends) if ends == sorted(ends) and ends[0] >= 0 and ends[-1] == len(plan.frames) else None
