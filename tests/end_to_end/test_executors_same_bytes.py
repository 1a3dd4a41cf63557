"""A frame is the same wherever, in whatever order, beside whatever else, and however slowly it is rendered.

Frames of one worker, of several, of Dask, of a session of OpenJD and of chunks are compared by headers and all pixels.
"""

import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import batches
import pytest

from lookdev.export.openjd import HostRequirements, export_openjd
from lookdev.plan.chunks import Division
from lookdev.processes import end_with_parent
from lookdev.rendering.executors.choice import ExecutorOptions
from lookdev.run.render import render_job

pytestmark = [pytest.mark.cycles, pytest.mark.both_pythons]

# With a target error, frames of a job take different numbers of samples.
SETTINGS = {
    "denoised": {
        "ibl": '[{ name = "studio", builtin = "studio" }, { name = "sunset", builtin = "sunset" }]',
        "turntable": '[{ kind = "element", frames = 3 }, { kind = "lighting", frames = 3 }]',
        "render": '{ resolution = [40, 32], samples = 64, error = 1e-3, denoise = "measured" }',
    },
    "passes": {
        "ibl": "",
        "rig": '[{ name = "three_point", builtin = "three_point" }]',
        "turntable": '[{ kind = "lighting", frames = 4 }]',
        "render": "{ resolution = [32, 40], samples = 16, "
        'passes = ["depth", "normal", "albedo", "samples", "direct", "cryptomatte"] }',
    },
    **{
        f"{backend}, {denoise}": {
            "turntable": '[{ kind = "element", frames = 2 }, { kind = "lighting", frames = 2 }]',
            "render": f'{{ backend = "{backend}", denoise = "{denoise}", error = {error}, resolution = [40, 40], '
            "samples = 2048, bounces = 0 }",
        }
        for backend, denoise, error in (
            ("exact", "off", 2e-3),
            ("exact", "measured", 2e-4),
            ("mitsuba", "off", 2e-3),
            ("mitsuba", "measured", 2e-4),
            ("nodes", "off", 2e-3),
            ("nodes-exact", "off", 0.2),
        )
    },
}


def lookdev(*arguments: object, cores: set[int] | None = None) -> subprocess.Popen[str]:
    """Start the program, on some cores; it ends with this process."""

    def prepare() -> None:
        end_with_parent()
        os.sched_setaffinity(0, cores or os.sched_getaffinity(0))

    command = [sys.executable, "-m", "lookdev", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, preexec_fn=prepare)


def done(*processes: subprocess.Popen[str]) -> None:
    """Wait for processes to end well, without a worker that crashed."""
    for process in processes:
        output, _ = process.communicate(timeout=600)
        assert process.returncode == 0, output
        assert "retry " not in output, output


def by_workers(job: Path, out: Path, workers: int) -> None:
    assert render_job(job, output=out, executor_options=ExecutorOptions(workers=workers)).exit_code == 0


def by_dask(job: Path, out: Path, workers: int, *options: str) -> None:
    done(lookdev("render", job, "--executor", "dask", "--workers", workers // 2, *options, "--output", out))


def by_openjd(job: Path, out: Path, workers: int) -> None:
    """Export a job, in as many chunks as half of the workers, and run the template as it is, on one core."""
    template, program = job.with_name("farm.yaml"), job.with_name("lookdev-here")
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m lookdev "$@"\n')
    program.chmod(0o755)
    export_openjd(job, template, Division(workers // 2), HostRequirements(command=str(program)))
    tool = Path(sys.executable).with_name("openjd")
    steps = ("--step", "Outputs", "--run-dependencies")
    run = subprocess.run(
        [tool, "run", template, *steps, "-p", f"Output={out}"], capture_output=True, text=True, check=False,
        preexec_fn=lambda: os.sched_setaffinity(0, {min(os.sched_getaffinity(0))}),
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr
    assert "openjd_progress: 100.0" in run.stdout
    assert "openjd_status: rendering " in run.stdout


def by_chunks(job: Path, out: Path, workers: int) -> None:
    """Render three chunks at once on one core, of which two are the same frames, and the last frame alone."""
    options, core = ("render", job, "--output", out), {min(os.sched_getaffinity(0))}
    done(*(lookdev(*options, "--chunk", chunk, cores=core) for chunk in ("2/2", "1/2", "2/2")))
    last = sorted(out.glob("*/*/*.exr"))[-1]
    last.unlink()
    done(lookdev(*options, "--frame", last.relative_to(out).with_suffix("")))
    done(lookdev(*options, "--outputs-only"))


WAYS: dict[str, Callable[[Path, Path, int], None]] = {
    "workers": by_workers,
    "dask": by_dask,
    "shared": lambda job, out, workers: by_dask(job, out, workers, "--shared"),
    "openjd": by_openjd,
    "chunks": by_chunks,
}
# Processes of its own, on one core; the first frames are of a worker that was warm, on all cores.
QUICK = ("openjd",)


def _cases() -> list[object]:
    fewer = {"turntable": '[{ kind = "element", frames = 2 }]'}
    found: list[object] = [pytest.param(SETTINGS["exact, off"] | fewer, 2, QUICK, id="quick")]
    for name in SETTINGS:
        marks = [pytest.mark.proof, *[pytest.mark.mitsuba] * name.startswith("mitsuba")]
        found.append(pytest.param(SETTINGS[name], 4, tuple(WAYS), id=name, marks=marks))
    return found


@pytest.mark.usefixtures("warm")
@pytest.mark.parametrize(("settings", "workers", "ways"), _cases())
def test_frames_are_the_same_wherever_they_are_rendered(
    settings: Mapping[str, str], workers: int, ways: tuple[str, ...], tmp_path: Path
) -> None:
    job = batches.write_job(tmp_path, **settings)
    by_workers(job, tmp_path / "one", 1)
    one = batches.contents(tmp_path / "one")
    assert len(one) >= 4
    if "error = " in settings["render"]:
        assert len({header["samples"] for header, _ in one.values()}) > 1  # where the error is
    pictures = sorted(path.relative_to(tmp_path / "one") for path in (tmp_path / "one").rglob("*.png"))
    for way in ways:
        out = tmp_path / way
        WAYS[way](job, out, workers)
        there = batches.contents(out)
        assert list(there) == list(one), way
        assert [name for name in one if there[name] != one[name]] == [], way
        assert sorted(path.relative_to(out) for path in out.rglob("*.png")) == pictures, way
