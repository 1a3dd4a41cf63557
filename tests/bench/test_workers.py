"""What a second worker gains on small frames: rate and processor time, of runs with one and with two in turn."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from statistics import median

import batches
import pytest

from lookdev.rendering.threads import usable_cores

PAIRS = 3
STARTS = 12
"""Frames until both workers render, and their scenes are compiled."""


@dataclass(frozen=True)
class Run:
    """Frames a second once all workers render, and processor seconds of the whole run."""

    rate: float
    processor: float


def render(folder: Path, workers: int) -> Run:
    """Render the job once more; processes that end are counted by wait4(2), their own children included."""
    command = [sys.executable, "-m", "lookdev", "render", str(folder / "job.toml"), "--force"]
    log = folder / "log"
    with log.open("w") as stream:
        run = subprocess.Popen([*command, "--workers", str(workers), "--log-format", "json"], stdout=stream)
        _, status, used = os.wait4(run.pid, 0)
        run.returncode = os.waitstatus_to_exitcode(status)
    assert run.returncode == 0
    events = map(json.loads, log.read_text().splitlines())
    done = [datetime.fromisoformat(event["time"]) for event in events if event["event"] == "frame_done"]
    assert len(done) == 48
    seconds = (done[-1] - done[STARTS]).total_seconds()
    return Run((len(done) - 1 - STARTS) / seconds, used.ru_utime + used.ru_stime)


@pytest.mark.bench
@pytest.mark.cycles
@pytest.mark.skipif(usable_cores() < 2, reason="one core has nothing to divide")
def test_two_workers_render_small_frames_as_fast_as_one_or_faster(tmp_path: Path) -> None:
    batches.write_job(
        tmp_path,
        turntable='[{ kind = "element", frames = 24 }]',
        render="{ resolution = [64, 64], samples = 16 }",
    )
    render(tmp_path, 1)  # what is compiled and kept is the same for all
    pairs = [(render(tmp_path, 1), render(tmp_path, 2)) for _ in range(PAIRS)]
    for one, two in pairs:
        sys.stdout.write(
            f"rate {two.rate / one.rate:.2f} times, {one.rate:.2f} and {two.rate:.2f} frames a second; "
            f"processor time {two.processor / one.processor:.2f} times, {one.processor:.1f} and {two.processor:.1f} s\n"
        )
    assert median(two.rate / one.rate for one, two in pairs) >= 1.0
    # The second starts, and reads the scenes: some seconds. Threads that wait for each other would take as much again.
    assert median(two.processor / one.processor for one, two in pairs) <= 1.3
