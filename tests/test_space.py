"""The colour spaces of light: their matrices, compared with the primaries and with OpenColorIO's conversion."""

import numpy as np
import PyOpenColorIO as ocio
import pytest

from lookdev.light import DistantLight, Emission, RectLight, Shadow, Shaping, prepare_light
from lookdev.light.dome.environment import make_environment
from lookdev.light.picture import prepare_texture
from lookdev.space import (
    CHROMATICITIES,
    OCIO_CONFIG,
    OCIO_NAMES,
    error_in_rec709,
    matrix_from_rec709,
    to_rec709,
    to_space,
)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def to_xyz(chromaticities: tuple[float, ...]) -> np.ndarray:
    """Return the matrix of primaries (SMPTE RP 177)."""
    xy = np.array(chromaticities).reshape(4, 2)
    xyz = np.column_stack([xy, 1.0 - xy.sum(axis=1)]) / xy[:, 1:]
    return xyz[:3].T * np.linalg.solve(xyz[:3].T, xyz[3])


def test_acescg_is_its_primaries_adapted_by_bradford():
    bradford = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
    rec709, acescg = (to_xyz(CHROMATICITIES[name]) for name in ("rec709", "acescg"))
    cones = [bradford @ matrix @ np.ones(3) for matrix in (rec709, acescg)]
    adapted = np.linalg.solve(bradford, np.diag(cones[1] / cones[0]) @ bradford)
    # OpenColorIO's matrices have seven digits, white points four to five.
    np.testing.assert_allclose(matrix_from_rec709("acescg"), np.linalg.solve(acescg, adapted @ rec709), atol=2e-5)
    np.testing.assert_allclose(matrix_from_rec709("acescg").sum(axis=1), 1.0, atol=1e-15)


def test_colours_are_those_of_opencolorio_and_come_back(rng):
    config = ocio.Config.CreateFromBuiltinConfig(OCIO_CONFIG)
    processor = config.getProcessor(OCIO_NAMES["rec709"], OCIO_NAMES["acescg"]).getDefaultCPUProcessor()
    colors = rng.random((50, 3))
    expected = [processor.applyRGB(color) for color in colors.tolist()]
    np.testing.assert_allclose(to_space(colors, "acescg"), expected, rtol=2e-6)
    np.testing.assert_allclose(to_rec709(to_space(colors, "acescg"), "acescg"), colors, atol=1e-14)
    assert (to_space(colors, "rec709") == colors).all()


def test_errors_are_those_of_converted_noise(rng):
    error = np.array([0.01, 0.03, 0.02])
    noise = to_rec709(rng.normal(size=(200_000, 3)) * error, "acescg")
    # The standard deviation of this number of samples has an error of .16 percent.
    np.testing.assert_allclose(error_in_rec709(error, "acescg"), noise.std(axis=0), rtol=0.01)


def make_map(rng):
    return make_environment("map", rng.random((8, 16, 3)).astype(np.float32))


PLACE = {"width": 1.0, "height": 0.5, "position": (0.0, 0.0, 2.0)}
SHAPING = Shaping(60.0, focus=4.0, focus_tint=(0.9, 0.2, 0.1))
BLUISH = Emission((0.2, 2.0, 1.0))
LIGHTS = {
    "dome": lambda rng: prepare_light(make_map(rng)),
    "lamp": lambda rng: RectLight(**PLACE, emission=Emission((4.0, 2.0, 1.0), shaping=SHAPING)),
    "picture": lambda rng: RectLight(**PLACE, texture=prepare_texture(make_map(rng)), emission=BLUISH),
    "distant": lambda rng: DistantLight(angle=5.0, emission=Emission((1.0, 0.2, 0.1))),
}


@pytest.mark.parametrize("name", LIGHTS)
def test_a_light_sends_the_same_in_another_space(rng, monkeypatch, name):
    for table, size in (("slots.SLOTS", 64), ("points.SIDE", 32), ("bins.COUNT", 4)):
        monkeypatch.setattr(f"lookdev.light.dome.{table}", size)  # small tables of the light take little time
    light = LIGHTS[name](rng)
    other = light.in_space("acescg")
    point = np.zeros(3)
    directions = light.sample(np.zeros((300, 3)), rng.random((300, 2)))
    sent = light.radiance(point, directions)
    assert (sent.max(axis=-1) > 0.0).sum() > 100
    np.testing.assert_allclose(other.radiance(point, directions), to_space(sent, "acescg"), rtol=1e-5, atol=1e-7)
    assert other.digest != light.digest
    assert light.in_space("rec709") is light


def test_a_shadow_leaves_the_same_light():
    emission = Emission((3.0, 1.0, 0.2), shadow=Shadow(color=(0.5, 0.1, 0.0)))
    other = DistantLight(angle=5.0, emission=emission).in_space("acescg").emission
    left = [np.array(light.color) * np.array(light.shadow.color) for light in (emission, other)]
    np.testing.assert_allclose(left[1], to_space(left[0], "acescg"), rtol=1e-12)
