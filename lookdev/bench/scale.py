"""Benchmark of large assets: the seconds and the memory up to the first sample, of a job and of Blender's own import.

Both programs load the same USD files, which are as large as the files of a production. Each load is timed from the
start of a fresh process; the processes run one after the other. The cache has the data of the light and the look, as
after any earlier job, but not the data of the asset.
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
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from lookdev.arrays import Floats
from lookdev.bench.benchmark import MEGABYTE, Benchmark, TextTable
from lookdev.errors import RenderError

ImportProgram = Literal["lookdev", "blender"]
IMPORT_MODULES: dict[ImportProgram, str] = {
    "lookdev": "lookdev.bench.scale_job",
    "blender": "lookdev.cycles.plain_import",
}
"""The module that runs as a process to load a file, by the program that is measured.

Elsewhere in this file, `way` is one of these keys: "lookdev", a job, or "blender", Blender's own import.
"""

_SIDE, _LIGHT, _BOUNCES = 64, "studio", 2  # side of the frame in pixels, built-in light, bounces
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
_ROOT = "/World"
# A box of side 1: its corners (8, 3), the corners of each face (6, 4), and the UVs of the corners of all faces (24, 2).
_CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)), np.float32)
_BOX = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]], np.int32)
_UVS = np.tile(np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32), (len(_BOX), 1))


def write_quads(file: Path, side: int = 1000) -> None:
    """Write a wavy square of ``side^2`` quads, 2 m wide."""
    stage = _new_stage(file)
    _define_sheet(stage, f"{_ROOT}/sheet", side)
    stage.Save()


def write_instances(file: Path, side: int = 100, faces: int = 100) -> None:
    """Write a point instancer of ``side^2`` wavy sheets, each of ``faces^2`` quads, side by side in a square of 2 m."""
    stage = _new_stage(file)
    instancer = UsdGeom.PointInstancer.Define(stage, f"{_ROOT}/many")
    _define_sheet(stage, f"{_ROOT}/many/sheet", faces)
    instancer.CreatePrototypesRel().SetTargets([f"{_ROOT}/many/sheet"])
    instancer.CreateProtoIndicesAttr(Vt.IntArray.FromNumpy(np.zeros(side * side, np.int32)))
    instancer.CreatePositionsAttr(Vt.Vec3fArray.FromNumpy(_cell_centers(side).astype(np.float32)))
    instancer.CreateScalesAttr(Vt.Vec3fArray.FromNumpy(np.full((side * side, 3), 0.4 / side, np.float32)))
    stage.Save()


def write_meshes(file: Path, count: int = 20_000) -> None:
    """Write `count` boxes, each a mesh, side by side in a square of 2 m. A hundred boxes share a parent prim."""
    stage = _new_stage(file)
    side = int(np.ceil(np.sqrt(count)))
    for number, center in enumerate(_cell_centers(side)[:count].tolist()):
        path = f"{_ROOT}/group{number // 100}"
        if number % 100 == 0:
            UsdGeom.Xform.Define(stage, path)
        mesh = _define_mesh(stage, f"{path}/box{number}", _CORNERS * (0.8 / side), _BOX, _UVS, "faceVarying")
        mesh.AddTranslateOp().Set(Gf.Vec3d(center))
    stage.Save()


def _new_stage(file: Path) -> Any:
    """Create a stage with z up, in metres. Its root prim binds a UsdPreviewSurface material to all descendants."""
    stage = Usd.Stage.CreateNew(str(file))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Xform.Define(stage, _ROOT).GetPrim()
    material = UsdShade.Material.Define(stage, f"{_ROOT}/Grey")
    shader = UsdShade.Shader.Define(stage, f"{_ROOT}/Grey/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set((0.4, 0.4, 0.4))
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(root).Bind(material)
    return stage


def _cell_centers(side: int) -> Floats:
    """Return the centres (side^2, 3), in metres, of ``side^2`` cells in a square of 2 m in the plane z = 0."""
    along = (2.0 * np.arange(side) + 1.0) / side - 1.0
    x, y = np.meshgrid(along, along)
    return np.stack([x.ravel(), y.ravel(), np.zeros(side * side)], axis=-1)


def _define_sheet(stage: Any, path: str, side: int) -> None:
    """Add a wavy square of ``side^2`` quads, 2 m wide, to a stage."""
    u, v = np.meshgrid(*[np.linspace(0.0, 1.0, side + 1)] * 2)
    heights = 0.05 * np.sin(20.0 * u) * np.cos(17.0 * v)
    points = np.stack([2.0 * u - 1.0, 2.0 * v - 1.0, heights], axis=-1).reshape(-1, 3)
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    faces = np.stack([first, first + 1, first + side + 2, first + side + 1], axis=-1)
    _define_mesh(stage, path, points, faces, np.stack([u, v], axis=-1).reshape(-1, 2), "vertex")


def _define_mesh(
    stage: Any, path: str, points: NDArray[Any], faces: NDArray[Any], uvs: NDArray[Any], uvs_of: str
) -> Any:
    """Add a mesh to a stage, with points (n, 3) and faces (f, 4), which are the point numbers of their corners.

    The UVs belong to points or to corners of faces: `uvs_of` is their interpolation in USD, ``vertex`` or
    ``faceVarying``.
    """
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), faces.shape[1], np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.astype(np.int32).ravel()))
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, uvs_of)
    st.Set(Vt.Vec2fArray.FromNumpy(uvs.astype(np.float32)))
    return mesh


CASES: dict[str, Callable[[Path], None]] = {"quads": write_quads, "instances": write_instances, "meshes": write_meshes}
"""The functions that write the measured USD files, by the name of the file."""


@dataclass(frozen=True)
class StartTimes:
    """The times of one run in seconds from its start.

    `case` is a key of `CASES`, and `program` is a key of `IMPORT_MODULES`. `planned` is the time when the frames are
    planned or, with Blender, when the import is done. `sample` is the time of the first sample. `memory` has the peak
    memory of each process of the run, in bytes.
    """

    case: str
    program: ImportProgram
    planned: float
    sample: float
    memory: tuple[int, ...]


@dataclass(kw_only=True)
class ScaleBenchmark(Benchmark):
    """The benchmark of large assets, from the start of a process to the first sample.

    `cases` maps the name of a file to the function that writes it.
    """

    NAME = "scale"
    FILE = "scale.json"
    ROWS = "starts"

    starts: list[StartTimes] = field(default_factory=list)
    cases: Mapping[str, Callable[[Path], None]] = field(default_factory=lambda: CASES)

    def measure(self) -> Iterator[None]:
        with tempfile.TemporaryDirectory(prefix="lookdev-scale-") as scratch:
            root, repeats = Path(scratch), self.options.repeats
            for case, write in self.cases.items():
                self.report(f"scale: writes {case}")
                write(root / f"{case}.usdc")
            write_quads(root / "warm.usdc", side=2)
            (root / "grey.usda").write_text(_LOOK, encoding="utf-8")
            _measure_start(root, "warm", "lookdev")  # puts tables of the light and compiled shaders into the cache
            for repeat, case, way in product(range(repeats), self.cases, IMPORT_MODULES):
                self.report(f"scale: {case}: {way}, {repeat + 1} of {repeats}")
                self.starts.append(_measure_start(root, case, way))
                yield

    def medians(self, case: str, way: ImportProgram) -> tuple[float, float, int]:
        """Return the median of `StartTimes.planned`, the median of `StartTimes.sample`, and the largest memory.

        The memory of a run, in bytes, is the sum over its processes.
        """
        starts = [start for start in self.starts if (start.case, start.program) == (case, way)]
        planned, sample = (
            statistics.median(getattr(start, name) for start in starts) for name in ("planned", "sample")
        )
        return planned, sample, max(sum(start.memory) for start in starts)

    def blocks(self) -> Iterator[str | TextTable]:
        yield from self.header()
        rows = []
        for case, way in dict.fromkeys((start.case, start.program) for start in self.starts):
            planned, sample, memory = self.medians(case, way)
            row = [f"{case}, {way}", f"{planned:.2f}", f"{sample:.2f}", f"{memory / MEGABYTE:.0f}", "", ""]
            if way != "lookdev":
                # The last two cells are the seconds to the first sample and the memory of lookdev, divided by the
                # figures of this row.
                _, ours, our_memory = self.medians(case, "lookdev")
                row[-2:] = f"x{ours / sample:.2f}", f"x{our_memory / memory:.2f}"
            rows.append(row)
        yield TextTable(("", "s to the plan", "s to the first sample", "MB", "lookdev takes", "of the memory"), rows)


def _measure_start(root: Path, case: str, way: ImportProgram) -> StartTimes:
    """Start a process that loads a file, with a cache without assets, and return its times up to the first sample.

    The process prints lines of JSON. Each has the event ``reached``, "planned" or "sample", and maybe the ``memory``.
    """
    cache, log = root / "cache", root / f"{way}.log"
    shutil.rmtree(cache / "assets", ignore_errors=True)
    for stored in cache.glob("content/*.asset"):
        stored.unlink()
    request = _write_job(root, case) if way == "lookdev" else _write_request(root, case)
    reached: dict[str, float] = {}
    memory: list[int] = []
    command = [sys.executable, "-m", IMPORT_MODULES[way], str(request)]
    environment = os.environ | {"LOOKDEV_CACHE": str(cache)}
    started = time.perf_counter()
    with (
        log.open("wb") as stream,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=stream, env=environment) as process,
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
    return StartTimes(case, way, reached["planned"], reached["sample"], tuple(memory))


def _write_job(root: Path, case: str) -> Path:
    """Write the job file for `lookdev.bench.scale_job`."""
    shutil.rmtree(root / "out", ignore_errors=True)
    job = root / f"{case}.toml"
    job.write_text(
        f"""output = "out"
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
    """Write the file with the arguments of `lookdev.cycles.plain_import`."""
    request = root / f"{case}.json"
    fields = {"file": str(root / f"{case}.usdc"), "light": _LIGHT, "resolution": [_SIDE, _SIDE], "bounces": _BOUNCES}
    # At this distance of the camera, in metres, the square of 2 m fills the frame.
    request.write_text(json.dumps(fields | {"distance": 3.0}), encoding="utf-8")
    return request
