"""A small job for tests of batch runs, its plan, and functions for the fake worker (`fake_worker.py`) that renders it.

Run as a program, ``batch_case.py FOLDER`` runs this job, so that tests can kill the run.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from lookdev.asset import load_asset
from lookdev.cache import Content
from lookdev.codegen.source import ShaderSource
from lookdev.job import Job, parse_job
from lookdev.light import Dome
from lookdev.material import Look
from lookdev.output.exr import read_header
from lookdev.plan import Plan, Setup, TurntableFrames, build_plan
from lookdev.processes import end_at_signals
from lookdev.rendering.task import SceneTask
from lookdev.run.events import FrameDone
from lookdev.run.render import RunResult, run_plan
from lookdev.scene import Scene, frame_camera

WIDTH, HEIGHT = 8, 6
JOB = """
output = "out"
asset = { builtin = "sphere" }
ibl = [{ name = "city", builtin = "city", exposure = -1.0 }]
[[look]]
name = "gold"
material = "gold.usda"
"""
TURNTABLES = """
[[turntable]]
kind = "element"
frames = 4
[[turntable]]
kind = "lighting"
frames = 3
"""
RENDER = """
[render]
resolution = [8, 6]
samples = 8
background = [0.5, 0.25, 0.0]
[outputs]
view = "Raw"
"""
# A program that joins the runs of an output folder and claims a frame, until its standard input ends.
HOLD = """
import sys
from pathlib import Path
from lookdev.run.runs import Run
with Run(Path(sys.argv[1])) as run:
    run.announce_plan("plan")
    assert run.claim(sys.argv[2])
    print("held", flush=True)
    sys.stdin.read()
"""


def make_job(folder: Path, turntables: str = TURNTABLES, render: str = RENDER) -> Job:
    """Return a job with two turntables, of 4 and 3 frames; two of these 7 files show the same pose."""
    (folder / "gold.usda").touch()
    return parse_job(JOB + turntables + render, folder / "job.toml")


def make_plan(job: Job) -> Plan:
    """Return the plan of a job, whose tasks have files that do not exist: the fake worker does not read them."""
    size, sampling = (WIDTH, HEIGHT), job.render.sampling
    light = Dome(*(Content(part, ".exr") for part in "rpsb"), 64, 32, "119147")
    camera = frame_camera((0.0, 0.0, 0.0), 1.0, size, elevation=job.camera.elevation)
    shown = Scene.of_look(load_asset(builtin="plane"), Look("gold", ()), light, size, camera)
    setups = []
    for look in job.look:
        source = ShaderSource(look.name, f"shader {look.name}() {{}}", (), (), f"500d {look.name}", transmits=True)
        task = SceneTask(Content("a55e7", ".npz"), "exact", (source,), (0,), (light,), size, sampling, camera)
        setups += [Setup(look.name, ibl.name, shown, task, sampling, exposure=ibl.exposure) for ibl in job.ibl]
    turns = TurntableFrames(job.turntable, job.output, job.camera.azimuth)
    plan = build_plan(
        setups, turns, read_header, labels={"job": str(job.file)}, frame_suffixes=job.outputs.frame_suffixes
    )
    return replace(plan, skips=())


def command(folder: Path) -> tuple[str, ...]:
    """Return the command that starts the fake worker with a folder."""
    return (sys.executable, str(Path(__file__).with_name("fake_worker.py")), str(folder))


def misbehave(folder: Path, **by_frame: list[str]) -> None:
    """Set the behaviour of the fake worker at each try of a frame: ``element_0001=["die", "ok"]``."""
    behaviour = {f"{name.replace('_', '.')}.exr": tries for name, tries in by_frame.items()}
    (folder / "behaviour.json").write_text(json.dumps(behaviour))


def requests(folder: Path) -> list[str]:
    """Return the file names of the frames that the fake worker was asked for, in order."""
    file = folder / "requests.txt"
    return file.read_text().split() if file.exists() else []


def worker_pids(folder: Path) -> list[int]:
    """Return the process ids of all fake workers that were started."""
    file = folder / "pids.txt"
    return [int(pid) for pid in file.read_text().split()] if file.exists() else []


def is_alive(pid: int) -> bool:
    """Return whether a process runs; a zombie does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def wait_until(condition, seconds: float = 60.0) -> None:  # type: ignore[no-untyped-def]
    """Wait until a function returns a true value; fail if that takes too long."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "the condition does not become true"
        time.sleep(0.01)


@contextmanager
def hold_frame(out: Path, name: str) -> Iterator[subprocess.Popen[bytes]]:
    """Yield another process that has joined the runs of an output folder and has claimed a frame; then kill it."""
    program = (sys.executable, "-c", HOLD, str(out), name)
    with subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"held\n"
        try:
            yield process
        finally:
            process.kill()


def run(folder: Path, job: Job | None = None, **options: object) -> RunResult:
    """Run a job with the fake worker; `options` are arguments of `run_plan`."""
    job = job or make_job(folder)
    options = {"worker_command": command(folder), **options}
    return run_plan(make_plan(job), job.outputs, job.render.background, **options)  # type: ignore[arg-type]


if __name__ == "__main__":

    def print_frame(event: object) -> None:
        if isinstance(event, FrameDone):
            print(event.name, flush=True)  # noqa: T201  a test waits for it

    # As on the command line: otherwise a signal that arrives just before a wait would be handled only after the wait.
    with end_at_signals():
        result = run(Path(sys.argv[1]), report=print_frame)
    sys.stdout.write(result.summary() + "\n")
    sys.stdout.flush()
    os._exit(result.exit_code)
