"""How far native nodes are from the exact pictures, preset by preset: the table of docs/nodes.md.

Run ``python tests/end_to_end/gaps.py`` (about half an hour) to measure all of it again into `gaps.csv`, then
``python tests/test_docs.py``.
"""

import csv
import sys
from collections.abc import Callable, Iterable
from dataclasses import astuple, dataclass, fields
from pathlib import Path

from lookdev.asset import load_asset
from lookdev.cache import atomic_path
from lookdev.checks.albedo import check_albedo
from lookdev.checks.images import measure_gap
from lookdev.light import load_environment, prepare_light
from lookdev.material.library import read_preset
from lookdev.material.library.edit import preset_look
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import FrameTask, frame_task
from lookdev.rendering.worker import open_renderer
from lookdev.scene import Pose, Sampling, Scene

ROOT = Path(__file__).parents[2]
PRESETS = sorted((ROOT / "materials/presets").glob("*.usda"))
RECORD = Path(__file__).with_suffix(".csv")

_SIZE = (96, 96)
_SAMPLING = Sampling(samples=1024, error=5e-4)


@dataclass(frozen=True)
class Gap:
    """What is found of a preset on a sphere under ``studio``: see docs/nodes.md."""

    preset: str
    flip: float
    flip_noise: float
    relmse: float
    albedo: float


def measure(preset: Path, render: Callable[[FrameTask], WorkerFrame]) -> Gap:
    """Render a preset by both backends until noise is no longer seen, or 1024 samples, and check its albedo."""
    look = preset_look(read_preset(preset), preset.stem)
    light = prepare_light(load_environment(builtin="studio"))
    scene = Scene.of_look(load_asset(builtin="sphere"), look, light, _SIZE)
    a, b = (
        render(frame_task(scene_task(scene, _SAMPLING, backend), Pose(0.0, 0.0), f"{preset.stem} {backend}"))
        for backend in ("exact", "nodes")
    )
    gap = measure_gap((a.a, a.b), (b.a, b.b), a.alpha)
    albedo = check_albedo(look, render, backend="nodes")
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
    with open_renderer() as render:
        for number, preset in enumerate(PRESETS):
            measured.append(measure(preset, render))
            sys.stderr.write(f"{number + 1} of {len(PRESETS)}: {measured[-1]}\n")
    write(measured)
