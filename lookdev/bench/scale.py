"""Large assets: seconds and memory up to the first sample of a job, against Blender's own import of the same file.

Each is measured in fresh processes, in turn, from the start of the process. The cache holds what depends on light and
look alone, as after any earlier job; assets are derived anew.
"""

from __future__ import annotations

import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

from lookdev.bench.results import Machine, this_machine
from lookdev.bench.scale_files import write_instances, write_meshes, write_quads
from lookdev.cache import write_file
from lookdev.errors import RenderError

Way = Literal["lookdev", "blender"]
WAYS: tuple[Way, ...] = ("lookdev", "blender")

JSON_FILE = "scale.json"
_SIDE, _LIGHT, _BOUNCES = 64, "studio", 2
_LOOK = """#usda 1.0
def Material "Grey"
{
    token outputs:lookdev:surface.connect = </Grey/Surface.outputs:layer>
    def Shader "Surface"
    {
        uniform token info:id = "LookdevDisney"
        color3f inputs:baseColor = (0.4, 0.4, 0.4)
        token outputs:layer
    }
}
"""


@dataclass(frozen=True)
class Case:
    """A file to measure: what is in it, and the function that writes it."""

    help: str
    write: Callable[[Path], None]


CASES: dict[str, Case] = {
    "quads": Case("a mesh of a million quads", write_quads),
    "instances": Case("10,000 instances of a mesh of 10,000 quads", write_instances),
    "meshes": Case("20,000 meshes of 6 quads", write_meshes),
}


@dataclass(frozen=True)
class Start:
    """Seconds from the start of a process until its frames are planned and until its first sample.

    With Blender's import, `planned` is when it is done. `memory` is the peak of each process in bytes.
    """

    case: str
    way: Way
    planned: float
    sample: float
    memory: tuple[int, ...]


@dataclass
class ScaleResults:
    """The starts so far."""

    machine: Machine = field(default_factory=this_machine)
    starts: list[Start] = field(default_factory=list)

    def median(self, case: str, way: Way) -> tuple[float, float, int]:
        """Return the median seconds until frames are planned, and until the first sample, and the largest memory."""
        mine = [each for each in self.starts if (each.case, each.way) == (case, way)]
        planned, sample = (statistics.median(getattr(each, name) for each in mine) for name in ("planned", "sample"))
        return planned, sample, max(sum(each.memory) for each in mine)

    def write(self, folder: Path) -> None:
        """Write ``scale.json``, whole or not at all."""
        data = {"machine": asdict(self.machine), "starts": [asdict(each) for each in self.starts]}
        write_file(folder / JSON_FILE, json.dumps(data, indent=1) + "\n")


def run_scale(
    folder: Path, report: Callable[[str], None], *, repeats: int, cases: dict[str, Case] = CASES
) -> ScaleResults:
    """Measure every case, and write ``scale.json`` to `folder`; raises RenderError where a process fails."""
    results = ScaleResults()
    with tempfile.TemporaryDirectory(prefix="lookdev-scale-") as scratch:
        root = Path(scratch)
        for name, case in cases.items():
            report(f"scale: writes {case.help}")
            case.write(root / f"{name}.usdc")
        write_quads(root / "warm.usdc", side=2)
        for start in _starts(root, list(cases), repeats, report):
            results.starts.append(start)
            results.write(folder)
    return results


def _starts(root: Path, cases: Sequence[str], repeats: int, report: Callable[[str], None]) -> Iterator[Start]:
    (root / "grey.usda").write_text(_LOOK, encoding="utf-8")
    # Tables of the light and compiled shaders.
    _start(root, "warm", "lookdev")
    for repeat in range(repeats):
        for case in cases:
            for way in WAYS:
                report(f"scale: {case}: {way}, {repeat + 1} of {repeats}")
                yield _start(root, case, way)


def _start(root: Path, case: str, way: Way) -> Start:
    cache = root / "cache"
    shutil.rmtree(cache / "assets", ignore_errors=True)
    for stored in cache.glob("content/*.asset"):
        stored.unlink()
    request = _write_job(root, case) if way == "lookdev" else _write_request(root, case)
    module = "lookdev.bench.scale_job" if way == "lookdev" else "lookdev.cycles.plain_import"
    log = root / f"{way}.log"
    reached: dict[str, float] = {}
    memory: list[int] = []
    started = time.perf_counter()
    with (
        log.open("wb") as stream,
        subprocess.Popen(
            [sys.executable, "-m", module, str(request)],
            stdout=subprocess.PIPE,
            stderr=stream,
            env=os.environ | {"LOOKDEV_CACHE": str(cache)},
        ) as process,
    ):
        assert process.stdout is not None
        try:
            for line in process.stdout:
                message = json.loads(line)
                reached[message["reached"]] = time.perf_counter() - started
                memory = message.get("memory", memory)
        except BaseException:
            process.kill()
            raise
    if process.returncode or "sample" not in reached:
        text = log.read_text(errors="replace")[-500:]
        raise RenderError(f"{case}, {way}: ended with exit code {process.returncode} before its first sample: {text}")
    return Start(case, way, reached["planned"], reached["sample"], tuple(memory))


def _write_job(root: Path, case: str) -> Path:
    output = root / "out"
    shutil.rmtree(output, ignore_errors=True)
    job = root / f"{case}.toml"
    job.write_text(
        f"""output = "{output}"
asset = {{ usd = "{case}.usdc" }}
look = [{{ name = "grey", material = "grey.usda" }}]
ibl = [{{ name = "{_LIGHT}", builtin = "{_LIGHT}" }}]
turntable = [{{ kind = "element", frames = 1 }}]
camera = {{ elevation = 45 }}
render = {{ resolution = [{_SIDE}, {_SIDE}], samples = 2, bounces = {_BOUNCES} }}
""",
        encoding="utf-8",
    )
    return job


def _write_request(root: Path, case: str) -> Path:
    request = root / f"{case}.json"
    given = {
        "file": str(root / f"{case}.usdc"),
        "light": _LIGHT,
        "resolution": [_SIDE, _SIDE],
        "bounces": _BOUNCES,
        "distance": 3.0,  # so that the square of 2 m fills the frame
    }
    request.write_text(json.dumps(given), encoding="utf-8")
    return request
