"""A job with wedges, movies and burn-in, rendered by Cycles through the command line's own door."""

from pathlib import Path

import batches
import numpy as np
import pytest

from lookdev.output.exr import read_frame
from lookdev.run.render import render_job

pytestmark = [pytest.mark.cycles, pytest.mark.usefixtures("warm")]

MORE = """
[[wedge]]
rig = "city"
parameter = "roughness"
values = [0.25, 0.5]
by = { parameter = "exposure", values = [-1, 2] }
[[wedge]]
rig = "three"
parameter = "light:key.intensity"
values = [0.0, 20.0, 40.0]
[outputs]
movie = true
grid = true
slate = 0.5
burn_in = ["movie"]
"""


def test_wedges_movies_and_sheets_of_one_job(tmp_path: Path) -> None:
    pytest.importorskip("av")
    job = batches.write_job(
        tmp_path,
        asset='{ builtin = "sphere" }',
        look='[{ name = "paint", material = "paint.usda" }]',
        ibl='[{ name = "city", builtin = "city" }]',
        rig='[{ name = "three", builtin = "three_point" }]',
        turntable='[{ kind = "lighting", frames = 2 }]',
        render="{ resolution = [16, 16], samples = 16 }",
        more=MORE,
    )
    batches.write_look(tmp_path, "paint", (0.6, 0.3, 0.1), roughness=0.5, specular=0.5)
    result = render_job(job)
    assert result.failures == ()
    assert result.done == result.total == 2 * (2 + 4 + 3)
    out = tmp_path / "out"

    def frame(look: str, light: str) -> np.ndarray:
        return read_frame(out / look / light / "lighting.0001.exr")[0].astype(np.float64)

    base = frame("paint", "city")
    half, four = (frame("paint_roughness_0.5", f"city_exposure_{stops}") for stops in (-1, 2))
    # Of the value that the look has itself: the same digests of look and light but for exposure, the same samples. A
    # constant that is read and one that is compiled in differ by a few float32 roundings.
    np.testing.assert_allclose(half, base / 2.0, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(four, base * 4.0, rtol=1e-4, atol=1e-6)
    smooth = frame("paint_roughness_0.25", "city_exposure_2")
    assert np.abs(smooth - four).max() > 0.05 * four.max()
    dark, one, two = (frame("paint", f"three_key.intensity_{value}") for value in (0, 20, 40))
    assert dark.sum() < one.sum() < two.sum()
    # Light adds: what 20 adds, 40 adds twice, within the noise of 16 samples of the mean of the picture.
    assert (two - dark).mean() == pytest.approx(2.0 * (one - dark).mean(), rel=0.1)

    files = {path.relative_to(out).as_posix(): path.read_bytes() for path in sorted(out.rglob("lighting.*"))}
    assert "paint/city/lighting.roughness_exposure.wedge.png" in files
    assert "paint/three/lighting.key.intensity.wedge.png" in files
    assert "paint_roughness_0.25/city_exposure_2/lighting.mp4" in files
    assert "city/lighting.looks.mp4" in files
    assert render_job(job).rendered == 0
    assert files == {path.relative_to(out).as_posix(): path.read_bytes() for path in sorted(out.rglob("lighting.*"))}
