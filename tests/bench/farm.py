"""A farm as a simulation of events: workers that start, prepare scenes and render frames, each at its measured cost.

    python tests/bench/farm.py [FRAMES] prints how efficient numbers of workers are for frames of some seconds.

The costs are those of `farm_costs.json`, drawn for each frame from the frames of its scene. The chunks are those of
`lookdev.plan.chunks.split_frames`. Runs that share frames take them as `lookdev.run.render` does.
"""

import heapq
import json
import random
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from statistics import fmean

from lookdev.plan.chunks import Costs, Division, split_frames

COSTS = Path(__file__).with_name("farm_costs.json")


@dataclass(frozen=True)
class SimulatedJob:
    """Frames in the order of their plan: the scene and the true cost of each, and what else takes time."""

    scenes: tuple[int, ...]
    frames: tuple[float, ...]
    preparing: tuple[float, ...]
    start: float
    planning: float  # of each process that joins a kept worker
    estimates: tuple[float, ...]  # of each frame, as a plan has them

    @property
    def means(self) -> tuple[float, ...]:
        """The mean cost of each scene's frames, for each frame: what is known of it after one of them was rendered."""
        mean = {
            scene: fmean(self.frames[number] for number in group)
            for scene, group in groupby(range(len(self.frames)), key=lambda number: self.scenes[number])
        }
        return tuple(mean[scene] for scene in self.scenes)

    @property
    def alone(self) -> float:
        """The time of one worker for all."""
        return self.start + sum(self.preparing) + sum(self.frames)


def measured_job(looks: int, rigs: int, frames: int, mean: float, seed: int = 0) -> SimulatedJob:
    """Return a job with the measured costs of scenes, its frames scaled to a mean of so many seconds.

    The costs differ among scenes and frames as the measured ones do.
    """
    rng, measured = random.Random(seed), json.loads(COSTS.read_text())
    scenes = [measured["scenes"][name] for name in sorted(measured["scenes"])]
    of_scenes = [scenes[number % len(scenes)] for number in range(looks * rigs)]
    drawn = [rng.choice(scene["frames"]) for scene in of_scenes for _ in range(frames)]
    scale = mean / fmean(drawn)
    numbers = tuple(scene for scene in range(len(of_scenes)) for _ in range(frames))
    return SimulatedJob(
        numbers,
        tuple(scale * cost for cost in drawn),
        tuple(scene["scene"] for scene in of_scenes),
        measured["start"],
        measured["plan"],
        tuple(scale * of_scenes[number]["estimate"] for number in numbers),
    )


def chunked(job: SimulatedJob, costs: Sequence[float], workers: int, chunks: Division, *, warm: bool) -> float:
    """Return the time until chunks by some costs are done: each is rendered by the next worker that is free.

    A `warm` worker starts once, and keeps the scene of its last frame; each of its chunks is planned anew.
    """
    ends = split_frames(job.scenes, Costs(tuple(costs), fmean(job.preparing), job.start), chunks)
    free = [(0.0, worker) for worker in range(workers)]
    started: dict[int, int | None] = {}
    first = 0
    for end in ends:
        if end == first:
            continue
        now, worker = heapq.heappop(free)
        scene = started.get(worker) if warm else None
        now += job.planning if warm and worker in started else job.start
        for number in range(first, end):
            if job.scenes[number] != scene:
                scene = job.scenes[number]
                now += job.preparing[scene]
            now += job.frames[number]
        started[worker] = scene
        heapq.heappush(free, (now, worker))
        first = end
    return max(now for now, _ in free)


def shared(job: SimulatedJob, workers: int, seed: int = 0) -> float:
    """Return the time until plain runs have rendered a job together, each frame by the one that claims it first."""
    claimed: set[int] = set()
    rng = random.Random(seed)

    def frames() -> Iterator[int | None]:
        """Yield what one run claims; None when it has to wait."""
        left: list[list[int]] = []
        for _, group in groupby(range(len(job.frames)), key=lambda number: job.scenes[number]):
            scene = list(group)
            for index, number in enumerate(scene):
                if number in done:
                    continue
                if number in claimed:
                    left.append(scene[index:])
                    break
                claimed.add(number)
                yield number
        rng.shuffle(left)
        for rest in left:
            for number in reversed(rest):
                if number not in claimed:
                    claimed.add(number)
                    yield number

    done: set[int] = set()
    events = [(job.start, worker) for worker in range(workers)]
    order = [frames() for _ in range(workers)]
    at: list[tuple[int | None, int | None]] = [(None, None)] * workers  # scene and frame
    end = 0.0
    while events:
        now, worker = heapq.heappop(events)
        scene, before = at[worker]
        if before is not None:
            done.add(before)
            end = max(end, now)
        if (number := next(order[worker], None)) is None:
            continue
        cost = job.frames[number] + (0.0 if job.scenes[number] == scene else job.preparing[job.scenes[number]])
        at[worker] = job.scenes[number], number
        heapq.heappush(events, (now + cost, worker))
    return end


def efficiency(job: SimulatedJob, workers: int, seconds: float) -> float:
    """Return the share of the workers' time that one worker would have needed."""
    return job.alone / (workers * seconds)


def main(frames: int) -> None:
    """Print the efficiency of numbers of workers, for frames of some seconds."""
    out = sys.stdout.write
    heads = "s a frame", "workers", "N chunks", "4 N", "6 N for N machines", "N measured", "shared"
    out(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|\n")
    for mean in (1.0, 5.0, 30.0):
        job = measured_job(10, 4, frames, mean)
        for workers in (8, 64, 256):
            times = (
                chunked(job, job.estimates, workers, Division(workers), warm=False),
                chunked(job, job.estimates, workers, Division(4 * workers), warm=True),
                chunked(job, job.estimates, workers, Division(6 * workers, workers), warm=True),
                chunked(job, job.means, workers, Division(workers), warm=False),
                shared(job, workers),
            )
            cells = " | ".join(f"{efficiency(job, workers, seconds):.3f}" for seconds in times)
            out(f"| {mean:g} | {workers} | {cells} |\n")


if __name__ == "__main__":
    main(int((sys.argv[1:] or ["143"])[0]))
