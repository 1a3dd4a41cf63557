"""How far native nodes are from the exact pictures, preset by preset: the table of docs/nodes.md.

Run ``python tests/end_to_end/gaps.py`` (about half an hour) to measure all of it again into `gaps.csv`, then
``python tests/test_docs.py``.
"""

from __future__ import annotations

import csv
import sys
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path

from lookdev.asset import read_asset
from lookdev.batch.prepare import make_scene, prepare_job
from lookdev.cache import atomic_path
from lookdev.checks.albedo import check_albedo
from lookdev.checks.gap import measure_gap
from lookdev.material.library import read_preset
from lookdev.material.library.edit import new_look
from lookdev.render.task import FrameTask
from lookdev.render.worker import Rendered, renderer

ROOT = Path(__file__).parents[2]
PRESETS = sorted((ROOT / "materials/presets").glob("*.usda"))
RECORD = Path(__file__).with_suffix(".csv")

_JOB = """
output = "out"
[asset]
builtin = "sphere"
[[look]]
name = "{name}"
material = "{material}"
[[ibl]]
name = "studio"
builtin = "studio"
[[turntable]]
kind = "element"
frames = 1
[render]
backend = "nodes"
resolution = [96, 96]
error = 5e-4
samples = 1024
"""


@dataclass(frozen=True)
class Gap:
    """What is found of a preset on a sphere under ``studio``: see docs/nodes.md."""

    preset: str
    flip: float
    flip_noise: float
    relmse: float
    albedo: float


def measure(preset: Path, render: Callable[[FrameTask], Rendered]) -> Gap:
    """Render a preset by both backends until noise is no longer seen, or 1024 samples, and check its albedo."""
    with tempfile.TemporaryDirectory() as folder:
        file, job = Path(folder, preset.name), Path(folder, "job.toml")
        new_look(file, read_preset(preset))
        job.write_text(_JOB.format(name=preset.stem, material=file), encoding="utf-8")
        prepared = prepare_job(job)
    (frame,) = prepared.plan.frames
    nodes = frame.task.scene
    looks = prepared.looks[preset.stem]
    asset, size = read_asset(nodes.asset_file), nodes.resolution
    exact = make_scene(asset, nodes.asset_file, looks, nodes.light, nodes.camera, size, nodes.sampling)
    a, b = (
        render(replace(frame.task, scene=scene, digest=f"{preset.stem} {name}"))
        for name, scene in (("exact", exact), ("nodes", nodes))
    )
    gap = measure_gap((a.a, a.b), (b.a, b.b), a.alpha)
    albedo = check_albedo(looks[0], render, backend="nodes")
    return Gap(preset.stem, gap.flip, gap.noise, gap.relmse, albedo.figures["cycles_error"])


def read() -> list[Gap]:
    """Return what was recorded, worst first."""
    with RECORD.open(newline="", encoding="utf-8") as stream:
        return [
            Gap(row.pop("preset"), **{key: float(value) for key, value in row.items()})
            for row in csv.DictReader(stream)
        ]


def write(gaps: Iterable[Gap]) -> None:
    """Record gaps, worst first."""
    with atomic_path(RECORD) as file, file.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(field.name for field in fields(Gap))
        for gap in sorted(gaps, key=lambda gap: -gap.flip):
            name, *figures = astuple(gap)
            rows.writerow([name, *(f"{figure:.3g}" for figure in figures)])


if __name__ == "__main__":
    measured = []
    with renderer() as render:
        for number, preset in enumerate(PRESETS):
            measured.append(measure(preset, render))
            sys.stderr.write(f"{number + 1} of {len(PRESETS)}: {measured[-1]}\n")
    write(measured)
