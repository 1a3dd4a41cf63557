"""The chunks of a job: its frames, divided in the same way for all runs, on any machine at any time.

A chunk consists of consecutive frames of the plan. ``lookdev render JOB --chunk 2/8`` renders the second of eight. A
`Division` states the number of chunks and, if it is known, the number of machines.

By default, the frames are divided by estimated costs. This division depends only on the job and on the numbers of
chunks and machines. It does not depend on the frames on disk, which change while chunks are rendered. On request,
before the first chunk is rendered, the frames are divided by measured times. The state folder in the output folder then
stores this division for all runs.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from datetime import timedelta
from pathlib import Path

from lookdev.cache import write_file
from lookdev.errors import LookdevError, OutputError
from lookdev.output.frame_name import FrameName
from lookdev.output.manifest import STATE_FOLDER
from lookdev.plan import Plan
from lookdev.plan.chunks import Chunk, Costs, Division, plan_of_part, split_frames
from lookdev.plan.costs import estimate_costs, measure_costs
from lookdev.run.runs import Runs
from lookdev.safe_text import TextError, align_columns, parse_json, read_text


@dataclass(frozen=True)
class ChunkSummary:
    """A chunk, as `lookdev plan --chunks` lists it."""

    chunk: str  # such as "2/8"
    frames: int  # number of frames
    done: int  # number of frames on disk
    scenes: int  # number of different scenes that the frames show
    seconds: float  # estimate for all frames, done or not, and for preparing their scenes
    first: str | None  # the name of the first frame; None if the chunk has no frames
    last: str | None


def plan_of_chunk(plan: Plan, chunk: Chunk) -> Plan:
    """Return the part of a plan that consists of the frames of a chunk."""
    return plan_of_part(plan, _chunk_ends(plan, chunk.division), chunk.number)


def store_measured_chunks(plan: Plan, division: Division) -> None:
    """Divide a plan by the render times of frames on disk, and store the division for later runs of chunks.

    Raises LookdevError where no frame is on disk, OutputError where a run renders a chunk of this division, OSError
    where the output folder cannot be written.
    """
    if all(frame.seconds is None for frame in plan.frames):
        raise LookdevError(
            f"{plan.output}: no frame of the job is rendered, so no time of a frame is known; render one of each look "
            "and light with 'lookdev render JOB --frame NAME'"
        )
    file = _division_file(plan, division)
    for run in Runs(file.parent).alive():
        if run.part.endswith(f"/{division}"):
            raise OutputError(f"{plan.output}: {run} renders chunk {run.part} of the division that would be replaced")
    write_file(file, json.dumps(_divide_plan(plan, division, measure_costs(plan))))


def chunk_summaries(plan: Plan, division: Division) -> list[ChunkSummary]:
    """Return summaries of all chunks of a plan. Times are estimated from the frames on disk, if there are any."""
    costs = measure_costs(plan)
    summaries, first = [], 0
    for number, end in enumerate(_chunk_ends(plan, division), start=1):
        frames = plan.frames[first:end]
        names = [str(FrameName.of(frame.task.files[0])) for frame in frames]
        scenes = len({id(frame.task.scene) for frame in frames})
        seconds = sum(costs.frames[first:end]) + scenes * costs.scene
        done = sum(any(file.state == "done" for file in frame.files) for frame in frames)
        ends = (names[0], names[-1]) if names else (None, None)
        summaries.append(ChunkSummary(str(Chunk(number, division)), len(frames), done, scenes, seconds, *ends))
        first = end
    return summaries


def chunks_text(plan: Plan, division: Division) -> str:
    """Return the chunks of a plan as text: an aligned table."""
    rows = [["chunk", "frames", "done", "scenes", "time", "first", "last"]]
    for chunk in chunk_summaries(plan, division):
        time = timedelta(seconds=round(chunk.seconds))
        row = chunk.chunk, chunk.frames, chunk.done, chunk.scenes, time, chunk.first or "-", chunk.last or "-"
        rows.append([str(cell) for cell in row])
    return "\n".join(align_columns(rows))


def chunks_data(plan: Plan, division: Division) -> dict[str, object]:
    """Return the chunks of a plan as plain data for JSON."""
    return {"output": str(plan.output), "chunks": [asdict(chunk) for chunk in chunk_summaries(plan, division)]}


def remove_chunk_divisions(state: Path) -> None:
    """Remove the stored divisions of plans into chunks from a state folder.

    Call this when all frames of the output are done.
    """
    for file in state.glob("chunks.*.json"):
        file.unlink(missing_ok=True)


def _divide_plan(plan: Plan, division: Division, costs: Costs) -> tuple[int, ...]:
    """Divide the frames of a plan by their costs; return the index after the last frame of each chunk."""
    return split_frames([id(frame.task.scene) for frame in plan.frames], costs, division)


def _division_file(plan: Plan, division: Division) -> Path:
    """Return the file in the state folder that may store a division of this plan."""
    return plan.output / STATE_FOLDER / f"chunks.{division}.{plan.digest[:16]}.json"


def _chunk_ends(plan: Plan, division: Division) -> tuple[int, ...]:
    """Return the index after the last frame of each chunk."""
    return _stored_ends(plan, division) or _divide_plan(plan, division, estimate_costs(plan))


def _stored_ends(plan: Plan, division: Division) -> tuple[int, ...] | None:
    """Return the index after the last frame of each chunk of the stored division.

    Returns None if no division is stored or its file is damaged.
    """
    file = _division_file(plan, division)
    try:
        ends = parse_json(read_text(file), file)
    except TextError:
        return None
    if not isinstance(ends, list) or len(ends) != division.count or not all(isinstance(end, int) for end in ends):
        return None
    return tuple(ends) if ends == sorted(ends) and ends[0] >= 0 and ends[-1] == len(plan.frames) else None
