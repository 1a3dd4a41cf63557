"""The table of reference props: its faults, and notes on cameras that are not framed."""

from __future__ import annotations

from pathlib import Path

import pytest

from lookdev.asset import load_asset
from lookdev.errors import JobError
from lookdev.job import parse_job
from lookdev.job.charts import JobCharts
from lookdev.scene import Camera

JOB = """
output = "out"
asset = { builtin = "sphere" }
look = [{ name = "NAME", material = "gold.usda" }]
ibl = [{ name = "white", builtin = "white" }]
turntable = [{ kind = "element", frames = 8 }]
"""


@pytest.mark.parametrize(
    ("more", "name", "said"),
    [
        ("render.resolution = [200, 900]", "gold", "along the bottom edge, the frame has 200 (size = 0.066 at most"),
        ("render.backend = 'nodes'", "gold", 'lets the props shadow one another (backend = "exact" or "mitsuba")'),
        ("", "Charts", "a look of the job is called 'charts', the name of the frames of [charts] (rename it)"),
        ("charts.place = 'middle'", "gold", "charts.place: unknown value 'middle'"),
        ("charts.sice = 0.2", "gold", "charts.sice: unknown key (did you mean 'size'?)"),
        ("charts.size = 0.7", "gold", "charts.size: "),
    ],
)
def test_faults_are_found_before_anything_is_read(tmp_path: Path, more: str, name: str, said: str) -> None:
    (tmp_path / "gold.usda").touch()
    text = JOB.replace("NAME", name) + more + ("" if "charts" in more else "\n[charts]\n")
    with pytest.raises(JobError) as error:
        parse_job(text, tmp_path / "job.toml")
    assert said in str(error.value)


def test_patches_of_few_pixels_are_shown_and_not_measured() -> None:
    assert JobCharts().strip((320, 240)).too_small() == ""
    said = JobCharts().strip((128, 128)).too_small()
    assert "2.3 pixels across the middle of a patch are too few; size = 0.156" in said
    assert JobCharts(size=0.156).strip((128, 128)).too_small() == ""


def test_a_camera_of_a_file_is_noted_where_props_hide_the_asset() -> None:
    points = load_asset(builtin="sphere").meshes[0].points.astype(float)
    near, far = (Camera(40.0, 0.0, (0.0, 0.0, 0.0), distance) for distance in (3.0, 8.0))
    arcs = [(0.0, 360.0)]
    (note,) = JobCharts(place="left").hidden(near, points, arcs, (320, 320))
    assert "hides a part of the asset at the left edge" in note
    assert list(JobCharts(place="left").hidden(far, points, arcs, (320, 320))) == []
