"""The shortest job, and the faults of other jobs."""

from pathlib import Path

import pytest

from lookdev.errors import JobError
from lookdev.job import Job, parse_job

MINIMAL = """
output = "out"
[asset]
builtin = "sphere"
[[look]]
name = "paint"
material = "paint.usda"
[[ibl]]
name = "city"
builtin = "city"
[[turntable]]
kind = "element"
frames = 4
"""


def touch_files(folder: Path) -> None:
    """Create the files that the jobs of the tests name, empty."""
    for name in ("paint.usda", "ball.usdc", "sky.exr"):
        (folder / name).touch()


def parse(text: str, folder: Path) -> Job:
    """Return the job of a text, in a folder with the files that it names."""
    touch_files(folder)
    return parse_job(text, folder / "job.toml")


def faults(text: str, folder: Path) -> dict[str, tuple[str, str]]:
    """Return the message and the hint of each fault of a job, by its key."""
    with pytest.raises(JobError) as caught:
        parse(text, folder)
    assert {fault.file for fault in caught.value.faults} == {str(folder / "job.toml")}
    return {fault.where: (fault.what, fault.hint) for fault in caught.value.faults}
