"""Small jobs rendered by the real program, in a process of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

LOOK = """#usda 1.0
( defaultPrim = "Look" )
def Material "Look"
{{
    token outputs:lookdev:surface.connect = </Look/Base.outputs:layer>
    def Shader "Base"
    {{
        uniform token info:id = "LookdevDisney"
        color3f inputs:baseColor = ({color})
        float inputs:roughness = 1
        float inputs:specular = 0
        token outputs:layer
    }}
}}
"""

JOB = """
output = "out"
asset = {{ builtin = "suzanne" }}
look = [{{ name = "red", material = "red.usda" }}, {{ name = "blue", material = "blue.usda" }}]
ibl = [{{ name = "{light}", builtin = "{light}", exposure = -1.0 }}]
turntable = [{{ kind = "element", frames = {frames} }}, {{ kind = "lighting", frames = 2 }}]
render = {{ resolution = [{size}, {size}], samples = {samples}, bounces = 0 }}
"""


def write_look(folder: Path, name: str, color: str) -> None:
    (folder / f"{name}.usda").write_text(LOOK.format(color=color))


def write_job(folder: Path, frames: int = 2, size: int = 16, samples: int = 4, light: str = "white") -> Path:
    """Write a job of two looks, each with `frames` + 2 files, and one pose fewer, or two where the light is white."""
    write_look(folder, "red", "0.7, 0.1, 0.1")
    write_look(folder, "blue", "0.1, 0.1, 0.7")
    job = folder / "job.toml"
    job.write_text(JOB.format(light=light, frames=frames, size=size, samples=samples))
    return job


def start(job: Path) -> subprocess.Popen[str]:
    """Start ``lookdev render`` with its output in one pipe."""
    command = (sys.executable, "-m", "lookdev", "render", str(job))
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    return subprocess.Popen(command, **pipes, text=True, start_new_session=True)


def finish(batch: subprocess.Popen[str], code: int, retries: int = 0) -> str:
    """Wait for the end of a batch, which renders a frame again as often as expected; return its output."""
    output, _ = batch.communicate(timeout=120)
    assert batch.returncode == code, output
    # Each of them may be a worker that crashed, which the frames do not show.
    assert output.count("retry ") == retries, output
    return output


def render(job: Path, code: int = 0) -> str:
    return finish(start(job), code)


def frames(job: Path) -> dict[str, tuple[int, int]]:
    """Return inode and time of every frame, by its name in the output."""
    output = job.parent / "out"
    stats = {path.relative_to(output).as_posix(): path.stat() for path in output.rglob("[!.]*.exr")}
    return {name: (stat.st_ino, stat.st_mtime_ns) for name, stat in stats.items()}


def leftovers(job: Path) -> list[Path]:
    """Return what a finished run leaves besides its results: nothing but its state."""
    output = job.parent / "out"
    known = {
        ".lookdev",
        ".lookdev/worker.log",
        *(f".lookdev/{name}.json" for name in ("pictures", "digests", "plan")),
    }
    hidden = [path.relative_to(output) for path in output.rglob("*") if "/." in f"/{path.relative_to(output)}"]
    return [path for path in hidden if path.as_posix() not in known]


def worker_of(batch: subprocess.Popen[str]) -> int:
    """Return the process id of a batch's worker."""
    parents: dict[int, int] = {}
    workers = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            parents[int(process.name)] = int((process / "stat").read_text().rpartition(")")[2].split()[1])
            workers += [int(process.name)] * (b"lookdev.cycles" in (process / "cmdline").read_bytes())
        except (FileNotFoundError, ProcessLookupError):
            continue
    (worker,) = (each for each in workers if parents.get(parents[each]) == batch.pid)
    return worker
