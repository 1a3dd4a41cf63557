"""Every job that ships renders: its own assets, looks, lights and camera, at a few pixels, samples and frames."""

import re
from pathlib import Path

import numpy as np
import pytest

from lookdev.job import Job, load_job
from lookdev.material.usd import expand_variants
from lookdev.output.exr import read_frame, read_header
from lookdev.plan.prepare import PlannedJob, plan_job
from lookdev.run.render import render_job

pytestmark = [pytest.mark.cycles, pytest.mark.usefixtures("warm")]

JOBS = sorted(Path(__file__).parents[2].joinpath("jobs").glob("*.toml"))
# Variants. Jobs of props, a ground, passes, rigs and looks of parts have tests in their rooms.
QUICK = ("figure_19",)
MOST_LOOKS = 4


def some_looks(job: Job, tables: str) -> str:
    """Return a job's looks, each variant counted, as tables; of more than `MOST_LOOKS` the first and the last.

    Looks of a job that dresses the parts of its asset are all as they were.
    """
    if any(look.material is None for look in job.look):
        return tables
    looks = [(look, chosen) for look in job.look for chosen in expand_variants(look.material, look.prim, look.variants)]
    tables = ""
    for number, (look, chosen) in enumerate(looks if len(looks) <= MOST_LOOKS else (looks[0], looks[-1])):
        assert look.prim is look.parts is None
        tables += f'[[look]]\nname = "{look.name}_{number}"\nmaterial = "{look.material}"\n'
        tables += "".join(f'variants.{name} = "{choice}"\n' for name, choice in chosen.items())
    return tables


@pytest.fixture(
    params=[pytest.param(job, id=job.stem, marks=[] if job.stem in QUICK else pytest.mark.proof) for job in JOBS]
)
def tiny(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Return a copy of a job with little to render, which names the files of the original."""
    path: Path = request.param
    text, given = path.read_text(), load_job(path)
    for pattern, replacement, least in (
        (r'"\.\./', f'"{path.parents[1]}/', 2),
        (r'"(?=assets/)', f'"{path.parent}/', 0),
        (r"(?m)^output = .*$", 'output = "out"', 1),
        (r"(?m)^resolution = .*$", "resolution = [24, 16]", 1),
        (r"(?m)^samples = .*$", "samples = 4", 1),
        (r"(?m)^frames = .*$", "frames = 1", 1),
        (r"(?ms)^\[\[look\]\].*?(?=^\[\[(?:ibl|rig)\]\])", lambda looks: some_looks(given, looks[0]), 1),
    ):
        text, count = re.subn(pattern, replacement, text)
        assert count >= least, f"{path}: {pattern}"
    job = tmp_path / path.name
    job.write_text(text)
    return job


def test_job_renders(tiny: Path) -> None:
    planned: list[PlannedJob] = []

    def plan(*given: object) -> PlannedJob:
        planned.append(plan_job(*given))  # type: ignore[arg-type]
        return planned[0]

    result = render_job(tiny, prepare=plan)
    (prepared,) = planned
    assert (result.exit_code, result.done) == (0, len(prepared.plan.frames))
    looks: dict[str, list[np.ndarray]] = {}
    for frame in prepared.plan.frames:
        beauty, alpha = read_frame(frame.task.files[0])
        assert beauty.shape == (16, 24, 3)
        assert np.isfinite(beauty).all()
        # Light that a shadow catcher takes away is a difference, which is rounded.
        assert (beauty >= (-1e-6 if frame.task.scene.has_catcher else 0.0)).all()
        assert (0.01 if frame.task.labels["look"] == "charts" else 0.05) < alpha.mean() < 0.95
        assert beauty[alpha == 1.0].mean() > 0.01
        assert read_header(frame.task.files[0])["digest"] == frame.task.digest
        looks.setdefault(frame.task.labels["ibl"], []).append(beauty)
    assert len(prepared.job.look) >= 2
    overviews = {path.parent.name for path in prepared.job.output.glob("*/*.looks.png")}
    assert overviews == (set(looks) if prepared.job.outputs.overview else set())
    for pictures in looks.values():  # no two looks are one
        assert np.abs(pictures[0] - pictures[-1]).mean() > 1e-3
