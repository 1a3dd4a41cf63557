"""A rig in USD, through the whole program: a dome of it is the image-based light of the same image, bit for bit."""

from pathlib import Path

import batches
import numpy as np
import pytest

from lookdev.light import load_environment
from lookdev.light.dome.environment import write_exr
from lookdev.output.exr import read_frame, read_header
from lookdev.run.render import render_job

pytestmark = [pytest.mark.cycles, pytest.mark.usefixtures("warm")]

# Longitude 0 of a dome is -y, the middle of an environment map +x.
RIG = """#usda 1.0
( defaultPrim = "Rig"
  upAxis = "Z" )
def Xform "Rig"
{
    def DomeLight_1 "Sky"
    {
        asset inputs:texture:file = @./sky.exr@
        float xformOp:rotateZ = 90
        uniform token[] xformOpOrder = ["xformOp:rotateZ"]
    }
}
"""


def test_a_dome_of_a_rig_is_rendered_as_the_ibl_of_its_image(tmp_path: Path) -> None:
    write_exr(tmp_path / "sky.exr", "RGB", load_environment(builtin="city").radiance)
    (tmp_path / "rig.usda").write_text(RIG)
    job = batches.write_job(
        tmp_path,
        ibl='[{ name = "sky", file = "sky.exr", exposure = -1.0 }]',
        rig='[{ name = "dome", usd = "rig.usda", exposure = -1.0 }]',
    )
    assert render_job(job).exit_code == 0
    files = sorted((tmp_path / "out").glob("*/sky/*.exr"))
    assert len(files) == 8
    for file in files:
        other = tmp_path / "out" / file.parts[-3] / "dome" / file.name
        for one, two in zip(read_frame(file), read_frame(other), strict=True):
            assert (one == two).all()
        assert read_header(other)["ibl"] == "dome"
        assert read_frame(file)[0].max() > 0.01
    first, second = (read_frame(tmp_path / "out" / "red" / "dome" / f"lighting.000{i}.exr")[0] for i in (1, 2))
    assert np.abs(first - second).max() > 0.01  # the rig has turned
