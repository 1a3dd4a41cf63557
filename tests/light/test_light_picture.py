"""Textured rectangles: the texture's orientation, its means, and the variance of sampling by luminance."""

import numpy as np
import pytest
from looks import quick_among

from lookdev.arrays import Floats
from lookdev.light import RectLight, make_environment
from lookdev.light.picture import draw_cell, look_up, mean_pyramid, prepare_texture


def textured(picture: Floats, **fields) -> RectLight:
    texture = prepare_texture(make_environment("picture", picture))
    return RectLight(**{"width": 2.0, "height": 1.0, "texture": texture, **fields})


def spotted(side: int = 64) -> Floats:
    """Return a dim picture with a spot that has a thousandth of the area and emits most of the light."""
    picture = np.full((side, side, 3), 0.02)
    picture[13:15, 40:42] = (60.0, 50.0, 40.0)
    return picture


def test_a_picture_is_upright_for_whom_it_shines_on() -> None:
    picture = np.zeros((2, 4, 3))
    picture[0, 0], picture[1, 3] = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    light = textured(picture)
    point = np.array([0.0, 0.0, -2.0])
    for x, y, color in ((0.8, 0.3, (1.0, 0.0, 0.0)), (-0.8, -0.3, (0.0, 1.0, 0.0)), (0.8, -0.3, (0.0, 0.0, 0.0))):
        towards = np.array([x, y, 2.0])
        got = light.radiance(point, towards / np.linalg.norm(towards))
        np.testing.assert_allclose(got, color, atol=1e-6)


@pytest.mark.parametrize("shape", [(1, 1), (2, 3), (7, 5), (32, 64), (100, 33)])
def test_the_tree_has_the_means_of_bilinear_look_ups(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(3)
    picture = rng.random((*shape, 3)) * (rng.random((*shape, 1)) < 0.3)
    tree = mean_pyramid(picture, 3)
    assert [len(level) for level in tree] == [1, 2, 4, 8]
    # The look-up is bilinear on squares of half a texel. Midpoints give the exact mean if cells are whole squares.
    many = (np.arange(16 * shape[1]) + 0.5) / (16 * shape[1]), (np.arange(16 * shape[0]) + 0.5) / (16 * shape[0])
    values = look_up(picture, *np.meshgrid(*many)).mean(axis=-1)[::-1, ::-1]
    if not values.any():
        values += 1.0
    expected = values.reshape(8, 2 * shape[0], 8, 2 * shape[1]).mean(axis=(1, 3))
    np.testing.assert_allclose(tree[-1], expected, atol=2e-3 * values.max())
    assert tree[0][0, 0] == pytest.approx(values.mean(), rel=1e-9)
    assert ((tree[-1] > 0.0) == (expected > 0.0)).all()


# At the closest point, the spot's cells are seen at all angles.
SPOTS = [
    ((0.3, 0.1, -1.0), 100.0), ((0.0, 0.0, -20.0), 100.0), ((-0.5, 0.2, -0.2), 50.0), ((-0.23, 0.27, -0.05), 2.0),
]  # fmt: skip


@pytest.mark.parametrize(("point", "least"), quick_among(SPOTS, SPOTS[:1]))
def test_a_small_bright_spot_costs_little(point: tuple[float, float, float], least: float) -> None:
    """The variance of irradiance, against directions that are uniform over the solid angle."""
    rng = np.random.default_rng(12)
    light, count = textured(spotted()), 100_000
    plain = RectLight(width=2.0, height=1.0)
    places, u, normal = np.broadcast_to(np.array(point), (count, 3)), rng.random((count, 2)), np.array([0.6, 0.0, 0.8])

    def values(drawn: RectLight) -> Floats:
        wi = drawn.sample(places, u)
        pdf = drawn.pdf(places, wi)
        return light.radiance(places, wi)[:, 0] * np.maximum(wi @ normal, 0.0) / np.where(pdf > 0.0, pdf, np.inf)

    by_luminance, by_solid_angle = values(light), values(plain)
    both = np.sqrt((by_luminance.var() + by_solid_angle.var()) / count)
    assert abs(by_luminance.mean() - by_solid_angle.mean()) < 5.0 * both
    assert by_luminance.var() * least < by_solid_angle.var()


def test_a_point_is_where_its_fractions_are() -> None:
    width, height, position = 2.0, 1.0, np.tile((0.3, 0.1, -1.0), (100, 1))
    u = np.random.default_rng(5).random((100, 2))
    point = draw_cell(textured(spotted()).means, 0, position, width, height, u)
    np.testing.assert_allclose((point.s - 0.5) * width - 0.3, point.x, atol=1e-12)
    np.testing.assert_allclose((point.t - 0.5) * height - 0.1, point.y, atol=1e-12)


def test_a_black_texture_sends_nothing_and_is_sampled_all_the_same() -> None:
    light, point = textured(np.zeros((4, 4, 3))), np.tile((0.0, 0.0, -1.0), (100, 1))
    wi = light.sample(point, np.random.default_rng(1).random((100, 2)))
    assert (light.pdf(point, wi) > 0.0).all()
    assert (light.radiance(point, wi) == 0.0).all()
