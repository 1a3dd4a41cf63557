"""Small jobs for tests that render them by the real program, usually in another process, and check their output."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from lookdev.output.exr import read_header
from lookdev.processes import end_with_parent

LOOK = """#usda 1.0
( defaultPrim = "Look" )
def Material "Look"
{{
    token outputs:lookdev:surface.connect = </Look/Base.outputs:layer>
    def Shader "Base"
    {{
        uniform token info:id = "Lookdev{model}"
        {inputs}
        token outputs:layer
    }}
}}
"""

JOB = {
    "output": '"out"',
    "asset": '{ builtin = "suzanne" }',
    "look": '[{ name = "red", material = "red.usda" }, { name = "blue", material = "blue.usda" }]',
    "ibl": '[{ name = "studio", builtin = "studio", exposure = -1.0 }]',
    "turntable": '[{ kind = "element", frames = 2 }, { kind = "lighting", frames = 2 }]',
    "render": "{ resolution = [16, 16], samples = 4, bounces = 0 }",
}

OF_THE_RUN = {"time", "seconds", "host"}
"""The entries of a frame's header that depend on the machine and on the time of its render."""


def look_text(model: str, **inputs: float | tuple[float, float, float]) -> str:
    """Return the USD text of a look with one layer, whose inputs are numbers and colours."""
    lines = [
        f"{'color3f' if isinstance(value, tuple) else 'float'} inputs:{key} = {value}" for key, value in inputs.items()
    ]
    return LOOK.format(model=model, inputs="\n        ".join(lines))


def write_look(folder: Path, name: str, color: tuple[float, float, float], **inputs: float) -> None:
    """Write a look of one Disney layer to a folder; it is diffuse unless `inputs` change that."""
    text = look_text("Disney", baseColor=color, **{"roughness": 1, "specular": 0} | inputs)
    (folder / f"{name}.usda").write_text(text)


def write_job(folder: Path, more: str = "", **keys: str) -> Path:
    """Write the job `JOB` and its two looks, and return the file of the job.

    `keys` replace keys of the job; a key with an empty value is left out. `more` has further lines.
    """
    write_look(folder, "red", (0.7, 0.1, 0.1))
    write_look(folder, "blue", (0.1, 0.1, 0.7))
    lines = [f"{key} = {value}\n" for key, value in (JOB | keys).items() if value]
    (folder / "job.toml").write_text("".join(lines) + more)
    return folder / "job.toml"


def start(job: Path, *options: str) -> subprocess.Popen[str]:
    """Start ``lookdev render``, which ends with this process; standard output and errors go to one pipe."""
    command = (sys.executable, "-m", "lookdev", "render", str(job), *options)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    return subprocess.Popen(command, **pipes, text=True, start_new_session=True, preexec_fn=end_with_parent)


def finish(batch: subprocess.Popen[str], code: int, retries: int = 0) -> str:
    """Wait for the end of a batch, which is a running ``lookdev render``; check its exit code, and return its output.

    `retries` is the expected number of frames that are rendered again after a failure.
    """
    output, _ = batch.communicate(timeout=120)
    assert batch.returncode == code, output
    # A retry can mean that a worker has crashed, which cannot be seen in the frames.
    assert output.count("retry ") == retries, output
    return output


def files(job: Path) -> dict[str, tuple[int, int]]:
    """Return inode and modification time of every frame file, by its path in the output folder."""
    output = job.parent / "out"
    stats = {path.relative_to(output).as_posix(): path.stat() for path in output.rglob("[!.]*.exr")}
    return {name: (stat.st_ino, stat.st_mtime_ns) for name, stat in stats.items()}


def contents(out: Path) -> dict[str, object]:
    """Return the content of each frame by its path in an output folder: its header, and its parts.

    A part has the names of its channels and the bytes of its pixels. The entries `OF_THE_RUN` of headers are left out.
    """
    found: dict[str, object] = {}
    for path in sorted(out.glob("*/*/*.exr")):
        header = {key: value for key, value in read_header(path).items() if key not in OF_THE_RUN}
        image = oiio.ImageBuf(str(path))
        parts = []
        for part in range(image.nsubimages):
            image.reset(str(path), part, 0)
            parts.append((image.spec().channelnames, np.asarray(image.get_pixels(oiio.FLOAT)).tobytes()))
        found[path.relative_to(out).as_posix()] = header, parts
    return found


def leftovers(job: Path) -> list[Path]:
    """Return hidden files in the output of a finished run that are not part of its state; there should be none."""
    output = job.parent / "out"
    known = {
        ".lookdev",
        ".lookdev/worker.log",
        *(f".lookdev/{name}.json" for name in ("pictures", "digests", "plan")),
    }
    hidden = [path.relative_to(output) for path in output.rglob("*") if "/." in f"/{path.relative_to(output)}"]
    return [path for path in hidden if path.as_posix() not in known]


def worker_of(batch: subprocess.Popen[str]) -> int:
    """Return the process id of the worker of a batch. The worker is a grandchild of the process `batch`."""
    parents: dict[int, int] = {}
    workers = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            parents[int(process.name)] = int((process / "stat").read_text().rpartition(")")[2].split()[1])
            workers += [int(process.name)] * (b"lookdev.cycles" in (process / "cmdline").read_bytes())
        except (FileNotFoundError, ProcessLookupError):
            continue
    (batch_worker,) = (worker for worker in workers if parents.get(parents[worker]) == batch.pid)
    return batch_worker
