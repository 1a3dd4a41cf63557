"""The shipped rigs: they fit any asset, expose a grey sphere well, and have the images that they state."""

import numpy as np
import pytest

from lookdev.light.dome.environment import read_exr
from lookdev.light.rig import load_rig
from lookdev.shipped import BUILTIN_RIGS, rig_file, shipped_folder

DIRECTIONS = 64  # for each point and light: the mean over 300 points has an error of a few percent


def test_every_shipped_file_is_a_built_in_rig() -> None:
    assert {file.stem for file in shipped_folder().joinpath("rigs").glob("*.usda")} == set(BUILTIN_RIGS)


@pytest.mark.parametrize("name", BUILTIN_RIGS)
def test_a_grey_sphere_is_well_exposed(name: str) -> None:
    rig = load_rig(rig_file(name), sampled=False)
    assert rig.fit
    assert rig.notes == ()
    rng = np.random.default_rng(6)
    point = rng.normal(size=(600, 3))
    point /= np.linalg.norm(point, axis=-1, keepdims=True)
    point = point[point[:, 1] < 0.0]  # the half of the unit sphere that the camera sees
    irradiance = np.zeros(len(point))
    for light in rig.lights:
        for _ in range(DIRECTIONS):
            towards = light.sample(point, rng.random((len(point), 2)))
            pdf, cosine = light.pdf(point, towards), np.maximum((towards * point).sum(axis=-1), 0.0)
            radiance = light.radiance(point, towards).mean(axis=-1)
            irradiance += np.where(pdf > 0.0, radiance * cosine / np.where(pdf > 0.0, pdf, 1.0), 0.0) / DIRECTIONS
    # The picture of 18 % grey has a mean within a stop of 18 %, and little of white paint is above 2.
    seen = irradiance / np.pi
    assert 0.09 < 0.18 * np.average(seen, weights=-point[:, 1]) < 0.36
    assert 0.9 * np.quantile(seen, 0.98) < 2.0


def test_the_sky_is_the_overcast_sky_of_the_cie() -> None:
    """CIE S 011: L = Lz (1 + 2 sin elevation) / 3; below it a ground of a tenth."""
    elevation = np.pi * (0.5 - (np.arange(32) + 0.5) / 32)
    expected = np.where(elevation > 0.0, (1.0 + 2.0 * np.sin(elevation)) / 3.0, 0.1)
    sky = read_exr(shipped_folder() / "rigs" / "textures" / "overcast.exr", "RGB")
    assert sky == pytest.approx(np.broadcast_to(expected[:, None, None], (32, 64, 3)), rel=1e-6)


def test_the_softbox_is_brightest_amid_and_falls_to_its_seam() -> None:
    box = read_exr(shipped_folder() / "rigs" / "textures" / "softbox.exr", "RGB")
    amid, seam = box[31:33, 31:33].mean(), box[[0, -1]].mean()
    assert amid == pytest.approx(box.max(), rel=1e-6)
    assert amid == pytest.approx(1.0, abs=0.01)
    assert 0.2 < seam < 0.4 * amid
    assert box == pytest.approx(box[::-1, ::-1])
