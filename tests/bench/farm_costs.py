"""What frames, scene changes and a start cost: a job is rendered once, and processor time read between its events.

    python tests/bench/farm_costs.py JOB > tests/bench/farm_costs.json

Processor time hardly depends on what else the machine does. Frames are rendered by all cores, so theirs is divided by
these; a start, and the preparation of a scene, are taken to use one.
"""

import json
import os
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from statistics import fmean

from lookdev.plan.costs import estimate
from lookdev.plan.prepare import prepare_job
from lookdev.run.events import Event, FrameDone, FrameStarted
from lookdev.run.render import render_job

_TICK = os.sysconf("SC_CLK_TCK")


def processor_seconds() -> float:
    """Return the processor time of this process and its children, which run."""
    total = 0
    for process in (os.getpid(), *map(int, Path(f"/proc/self/task/{os.getpid()}/children").read_text().split())):
        total += sum(map(int, Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[11:13]))
    return total / _TICK


def planning_seconds(job: Path) -> float:
    """Return the processor time of a process that plans a job, whose files were read before."""
    for _ in range(2):
        before = getrusage(RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-m", "lookdev", "plan", str(job)], check=True, capture_output=True)
        after = getrusage(RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measure(job: Path) -> dict[str, object]:
    """Render a job, and return its costs in seconds: to start, to plan, and of each scene to prepare and of frames."""
    cores = len(os.sched_getaffinity(0))
    start: list[float] = []
    taken: dict[str, list[float]] = defaultdict(list)
    last = 0.0

    def report(event: Event) -> None:
        nonlocal last
        now = processor_seconds()
        if isinstance(event, FrameStarted) and not start:
            start.append(now)
            last = now
        elif isinstance(event, FrameDone):
            taken[event.name.rpartition("/")[0]].append(now - last)
            last = now

    guessed = {f"{setup.look}/{setup.ibl}": estimate(setup.task) for setup in prepare_job(job).setups}
    assert render_job(job, force=True, report=report).exit_code == 0
    scenes = {
        name: {
            "estimate": guessed[name],
            "scene": max(first - fmean(frames), 0.0),
            "frames": [seconds / cores for seconds in frames],
        }
        for name, (first, *frames) in taken.items()
    }
    return {"cores": cores, "start": start[0], "plan": planning_seconds(job), "scenes": scenes}


if __name__ == "__main__":
    sys.stdout.write(json.dumps(measure(Path(sys.argv[1])), indent=1) + "\n")
