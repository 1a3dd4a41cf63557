"""Passes and the space of light in a job file."""

from __future__ import annotations

from pathlib import Path

import pytest

from lookdev.errors import JobError
from lookdev.job import Job, parse_job

JOB = """
output = "out"
asset = { builtin = "sphere" }
ibl = [{ name = "city", builtin = "city" }]
turntable = [{ kind = "element", frames = 1 }]
[[look]]
name = "gold"
material = "gold.usda"
[render]
"""


def job(render: str, folder: Path) -> Job:
    (folder / "gold.usda").touch()
    return parse_job(JOB + render, folder / "job.toml")


def test_what_every_frame_has_may_be_named_and_changes_nothing(tmp_path: Path) -> None:
    assert job('passes = ["lights", "beauty", "error", "alpha"]', tmp_path).render.passes == ("lights",)
    assert job('passes = ["error"]', tmp_path).render == job("", tmp_path).render


def test_the_space_is_rec709_unless_it_is_named(tmp_path: Path) -> None:
    assert job("", tmp_path).render.space == "rec709"
    assert job('space = "acescg"\nbackend = "mitsuba"', tmp_path).render.space == "acescg"


@pytest.mark.parametrize(
    ("render", "words"),
    [
        ('space = "acescg"\nbackend = "nodes"', ['"exact" or "mitsuba"']),
        ('space = "aces"', ["acescg"]),
        ('passes = ["light"]', ["lights"]),
        ('passes = ["lights"]\nbackend = "nodes"', ["no lights", '"exact"']),
    ],
)
def test_what_cannot_be_rendered_is_a_fault_that_names_what_can(render: str, words: list[str], tmp_path: Path) -> None:
    with pytest.raises(JobError) as error:
        job(render, tmp_path)
    for word in words:
        assert word in str(error.value)
