"""A frame is the same wherever, in whatever order, beside whatever else, and however slowly it is rendered."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import batches
import pytest

from lookdev.output.exr import read_frame, read_header, read_layer

pytestmark = pytest.mark.cycles

OF_THE_RUN = {"time", "seconds", "host"}
SETTINGS = "resolution = [40, 40], samples = 2048"
# So that frames of a job take different numbers of samples.
TARGETS = {"off": 2e-3, "measured": 2e-4, "nodes-exact": 2e-2}


def write_job(folder: Path, backend: str, denoise: str) -> Path:
    job = batches.write_job(folder, light="studio")
    lines = [line for line in job.read_text().splitlines() if not line.startswith("render")]
    target = TARGETS.get(backend, TARGETS[denoise])
    lines.append(f'render = {{ backend = "{backend}", denoise = "{denoise}", error = {target}, {SETTINGS} }}')
    job.write_text("\n".join(lines) + "\n")
    return job


def run(job: Path, *options: str, cores: set[int] | None = None) -> subprocess.Popen[bytes]:
    limit = (lambda: os.sched_setaffinity(0, cores)) if cores else None
    command = (sys.executable, "-m", "lookdev", "render", str(job), *options)
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, preexec_fn=limit)


def frames(job: Path) -> dict[str, object]:
    """Return what each frame has but for what is of the run: its header, and the bytes of its pixels and errors."""
    out = job.parent / "out"
    found: dict[str, object] = {}
    for path in sorted(out.glob("*/*/*.exr")):
        header = {key: value for key, value in read_header(path).items() if key not in OF_THE_RUN}
        layer = read_layer(path, "error")
        assert layer is not None
        pixels = [each.tobytes() for each in (*read_frame(path), layer)]
        found[path.relative_to(out).as_posix()] = header, pixels
    return found


@pytest.mark.parametrize(
    ("backend", "denoise"),
    [
        ("exact", "off"),
        pytest.param("exact", "measured", marks=pytest.mark.proof),
        pytest.param("mitsuba", "off", marks=[pytest.mark.mitsuba, pytest.mark.proof]),
        pytest.param("mitsuba", "measured", marks=[pytest.mark.mitsuba, pytest.mark.proof]),
        pytest.param("nodes", "off", marks=pytest.mark.proof),
        pytest.param("nodes-exact", "off", marks=pytest.mark.proof),
    ],
)
def test_frames_are_the_same_in_one_run_and_in_chunks(backend: str, denoise: str, tmp_path: Path) -> None:
    job = write_job(tmp_path, backend, denoise)
    assert run(job).wait() == 0
    whole = frames(job)
    assert len(whole) == 8
    assert len({header["samples"] for header, _ in whole.values()}) > 1  # type: ignore[misc]  # where the error is
    (tmp_path / "out").rename(tmp_path / "first")
    # Of three chunks, two render the same frames as one another, and all are on one core, so slower.
    runs = [run(job, "--chunk", chunk, cores={0}) for chunk in ("2/2", "1/2", "2/2")]
    assert [each.wait() for each in runs] == [0, 0, 0]
    apart = frames(job)
    assert list(apart) == list(whole)
    assert [name for name in whole if apart[name] != whole[name]] == []
    # The last frame alone, in a process that renders nothing else.
    last = sorted(whole)[-1]
    (tmp_path / "out" / last).unlink()
    assert run(job, "--frame", last.removesuffix(".exr")).wait() == 0
    assert frames(job)[last] == whole[last]
