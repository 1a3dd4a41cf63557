"""Frames of a laptop, of several workers, of Dask and of a session of OpenJD are the same: headers and all pixels."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import batches
import numpy as np
import OpenImageIO as oiio
import pytest

from lookdev.output.exr import read_header

pytestmark = pytest.mark.cycles

OF_THE_RUN = {"time", "seconds", "host"}
JOB = """
output = "out"
asset = { builtin = "suzanne" }
look = [{ name = "red", material = "red.usda" }, { name = "blue", material = "blue.usda" }]
"""
SETTINGS = {
    "error target": """
ibl = [{ name = "studio", builtin = "studio", exposure = -1.0 }]
turntable = [{ kind = "element", frames = 2 }]
render = { resolution = [24, 24], samples = 128, error = 4e-3, bounces = 0 }
""",
    "denoised": """
ibl = [{ name = "studio", builtin = "studio" }, { name = "sunset", builtin = "sunset" }]
turntable = [{ kind = "element", frames = 3 }, { kind = "lighting", frames = 3 }]
render = { resolution = [40, 32], samples = 64, error = 1e-3, denoise = "measured" }
""",
    "passes": """
rig = [{ name = "three_point", builtin = "three_point" }]
turntable = [{ kind = "lighting", frames = 4 }]
[render]
resolution = [32, 40]
samples = 16
passes = ["depth", "normal", "albedo", "samples", "direct", "cryptomatte"]
""",
    "mitsuba": """
ibl = [{ name = "studio", builtin = "studio" }]
turntable = [{ kind = "element", frames = 4 }]
render = { resolution = [32, 32], samples = 64, backend = "mitsuba", denoise = "measured" }
""",
}


def write_job(folder: Path, settings: str) -> Path:
    batches.write_look(folder, "red", "0.7, 0.1, 0.1")
    batches.write_look(folder, "blue", "0.1, 0.1, 0.7")
    (folder / "job.toml").write_text(JOB + SETTINGS[settings])
    return folder / "job.toml"


def lookdev(*arguments: object) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "lookdev", *map(str, arguments)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "retry " not in done.stdout + done.stderr, "a worker crashed"


def openjd(job: Path, out: Path) -> str:
    """Export a job, check the template, run it as it is; return the log of the session."""
    template, program = job.with_name("farm.yaml"), job.with_name("lookdev-here")
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m lookdev "$@"\n')
    program.chmod(0o755)
    lookdev("export", "openjd", job, "-o", template, "--chunks", 2, "--command", program)
    tool = Path(sys.executable).with_name("openjd")
    subprocess.run([tool, "check", template], check=True, capture_output=True)
    steps = ("--step", "Outputs", "--run-dependencies")
    done = subprocess.run(
        [tool, "run", template, *steps, "-p", f"Output={out}"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def frames(out: Path) -> dict[str, object]:
    """Return all of each frame but what is of the run."""
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


@pytest.mark.parametrize(
    ("settings", "workers"),
    [
        ("error target", 2),
        *(pytest.param(name, 4, marks=pytest.mark.proof) for name in ("error target", "denoised", "passes")),
        pytest.param("mitsuba", 4, marks=[pytest.mark.proof, pytest.mark.mitsuba]),
    ],
)
def test_frames_are_the_same_wherever_they_are_rendered(settings: str, workers: int, tmp_path: Path) -> None:
    job = write_job(tmp_path, settings)
    lookdev("render", job, "--workers", 1, "--output", tmp_path / "laptop")
    laptop = frames(tmp_path / "laptop")
    assert len(laptop) >= 4
    lookdev("render", job, "--workers", workers, "--output", tmp_path / "workers")
    lookdev("render", job, "--executor", "dask", "--workers", workers // 2, "--output", tmp_path / "dask")
    ways = ["workers", "dask", "openjd"]
    if workers > 2:
        lookdev("render", job, "--executor", "dask", "--workers", 1, "--shared", "--output", tmp_path / "shared")
        ways.append("shared")
    log = openjd(job, tmp_path / "openjd")
    assert "openjd_progress: 100.0" in log
    assert "openjd_status: rendering " in log
    for other in ways:
        there = frames(tmp_path / other)
        assert list(there) == list(laptop)
        assert [name for name in laptop if there[name] != laptop[name]] == []
        pictures = sorted(path.relative_to(tmp_path / other) for path in (tmp_path / other).rglob("*.png"))
        assert pictures == sorted(
            path.relative_to(tmp_path / "laptop") for path in (tmp_path / "laptop").rglob("*.png")
        )
