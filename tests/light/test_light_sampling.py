"""Sampling of shapes from their surface to a million sizes away: solid angle, float32, and the variance."""

from typing import Any

import numpy as np
import pytest
from looks import quick_among
from numpy.typing import NDArray

from lookdev.light import CylinderLight, DiskLight, RectLight, SphereLight
from lookdev.light.cylinder import covering_rectangle
from lookdev.light.placed import PlacedLight
from lookdev.light.shape import draw_uniform, orient_to_axis, uniform_pdf
from lookdev.light.sphere import sphere_versine
from lookdev.light.spherical_rectangle import (
    RectanglePoint,
    density,
    directions_to_points,
    draw,
    project_part,
    project_rectangle,
)

Floats = NDArray[Any]

# In fractions of the sides from the middle: inside, at an edge, at a corner, beyond an edge, beyond a corner, far away.
ASIDE = [(0.1, 0.2), (0.5, 0.1), (0.5, 0.5), (0.51, 0.1), (0.52, 0.6), (4.0, 0.3), (-0.1, -3.0)]
ABOVE = [1e-6, 1e-3, 0.03, 0.3, 1.0, 30.0, 1e3, 1e6]
SIDES = [(1.0, 1.0), (20.0, 1.0), (0.05, 1.0)]


def rectangle_places(width: float, height: float) -> Floats:
    """Return points (N, 3) in front of a rectangle, near and far."""
    size = max(width, height)
    # Far points are also aside by as many sizes.
    return np.array([(width * x * max(1.0, z), height * y * max(1.0, z), -size * z) for x, y in ASIDE for z in ABOVE])


def solid_angle(point: Floats, width: float, height: float) -> Floats:
    """Return the solid angle (N,) of a rectangle, by its two triangles (van Oosterom, Strackee 1983)."""
    corners = [
        np.stack([x * width / 2.0 - point[:, 0], y * height / 2.0 - point[:, 1], -point[:, 2]], axis=-1)
        for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    total = np.zeros(len(point))
    volume = width * height * -point[:, 2]  # of the parallelepiped of three corners, without a difference
    for a, b, c in ((corners[0], corners[1], corners[2]), (corners[0], corners[2], corners[3])):
        ra, rb, rc = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
        below = ra * rb * rc + (a * b).sum(-1) * rc + (b * c).sum(-1) * ra + (c * a).sum(-1) * rb
        total += 2.0 * np.arctan2(volume, below)
    return total


@pytest.mark.parametrize(("width", "height"), SIDES)
def test_the_solid_angle_of_a_rectangle_is_right_from_close_to_far(width: float, height: float) -> None:
    light, places, grid = RectLight(width=width, height=height), rectangle_places(width, height), strata(48)
    expected = solid_angle(places, width, height)
    places = np.repeat(places[:, None], len(grid), axis=1)
    pdf = light.pdf(places, light.sample(places, np.broadcast_to(grid, (*places.shape[:2], 2))))
    assert (pdf > 0.0).all()
    weight = 1.0 / (pdf * expected[:, None])
    # 48 strata have 7 times the error of 128.
    np.testing.assert_allclose(weight.mean(axis=-1), 1.0, rtol=1e-3)
    assert weight.std(axis=-1).max() < 0.15
    assert weight.max() < 1.15


def strata(side: int) -> Floats:
    """Return the middles (side^2, 2) of the strata of the unit square."""
    middle = (np.arange(side) + 0.5) / side
    return np.stack(np.meshgrid(middle, middle), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize("above", quick_among([(z,) for z in ABOVE], [(z,) for z in ABOVE[1::2]]))
def test_the_solid_angle_of_round_lights_is_right_from_close_to_far(above: float) -> None:
    """The solid angle of a disk on its axis, of a sphere, and of a long thin cylinder by its outline."""
    grid = strata(256)

    def covered(light: PlacedLight, point: tuple[float, float, float]) -> float:
        places = np.broadcast_to(np.array(point), (len(grid), 3))
        wi = light.sample(places, grid)
        pdf = light.pdf(places, wi)
        is_hit = np.isfinite(light.distance(places, wi))
        assert (pdf[is_hit] > 0.0).all()
        return float((is_hit / np.where(pdf > 0.0, pdf, np.inf)).mean())

    slant = np.hypot(1.0, above)
    disk = 2.0 * np.pi / (slant * (slant + above))
    assert covered(DiskLight(radii=(1.0, 1.0)), (0.0, 0.0, -above)) == pytest.approx(disk, rel=1e-3)

    away = 1.0 + above
    sphere = 2.0 * np.pi / away**2 / (1.0 + np.sqrt(above * (2.0 + above)) / away)
    assert SphereLight(radius=1.0).distance(np.array([0.0, away, 0.0]), np.array([0.0, -1.0, 0.0])) == pytest.approx(
        above, rel=1e-9
    )
    # A direction's rounding, 1e-16, loses half of the edge.
    assert covered(SphereLight(radius=1.0), (0.0, away, 0.0)) == pytest.approx(sphere, rel=1e-6)

    # Of the strip between the planes that touch the cylinder, if that is wide enough not to end in what is seen: the
    # integral over the azimuth of what the ends cut off, which lie between the near side and the outline.
    half, length = np.arcsin(1.0 / away), 1e4 * away
    ends = 2.0 / np.hypot(1.0, 2.0 * np.array([np.sqrt(above * (2.0 + above)), above]) / length)
    cylinder = covered(CylinderLight(length=length, radius=1.0), (0.0, 0.0, -away))
    assert 2.0 * half * ends[0] * (1.0 - 1e-3) <= cylinder <= 2.0 * half * ends[1] * (1.0 + 1e-3)


def single(*values: Any) -> list[Floats]:
    """Return values in float32."""
    return [np.asarray(value, np.float32) for value in values]


def double(*values: Any) -> list[Floats]:
    """Return the same values, rounded to float32, in float64."""
    return [value.astype(np.float64) for value in single(*values)]


@pytest.mark.parametrize(("width", "height"), SIDES)
def test_a_rectangle_is_sampled_in_float32(width: float, height: float) -> None:
    """The pdf of each direction, and the irradiance from all directions, are accurate."""
    grid = strata(32)
    normals = np.random.default_rng(5).normal(size=(8, 3))
    normals[:, 2] = np.abs(normals[:, 2])

    def draw_target(point: Floats, u: Floats, width: Floats, height: Floats) -> tuple[RectanglePoint, Floats, Floats]:
        rectangle = project_part(point, width, height)
        target = draw(rectangle, u)
        pdf, wi = density(rectangle, target), directions_to_points(point, target)
        assert pdf.dtype == wi.dtype == point.dtype
        return target, pdf, wi

    for point in rectangle_places(width, height):
        arguments = (np.tile(point, (len(grid), 1)), grid, width, height)
        target, pdf, wi = draw_target(*single(*arguments))
        points, _, *sides = double(*arguments)
        right = density(project_part(points, *sides), RectanglePoint(*double(*target)))
        np.testing.assert_allclose(pdf, right, rtol=1e-4)
        _, right_pdf, right_wi = draw_target(*double(*arguments))
        got = (np.maximum(wi.astype(np.float64) @ normals.T, 0.0) / pdf[:, None]).mean(axis=0)
        expected = (np.maximum(right_wi @ normals.T, 0.0) / right_pdf[:, None]).mean(axis=0)
        is_significant = expected > 1e-3 * expected.max()
        np.testing.assert_allclose(got[is_significant], expected[is_significant], rtol=1e-4)


@pytest.mark.parametrize("scale", [2.0**-10, 2.0**10])
def test_a_rectangle_of_any_size_is_sampled_alike(scale: float) -> None:
    """In float32: a power of two changes no digit."""
    grid = strata(16)
    for position in np.array([(-0.3, 0.2, -1e-6), (4.0, -0.1, -1e-3), (0.5, 0.5, -0.3)]):
        point, scaled = (
            draw(project_part(places, width, height), u)
            for places, width, height, u in (
                single(np.tile(factor * position, (len(grid), 1)), factor * 10.0, factor * 3.0, grid)
                for factor in (1.0, scale)
            )
        )
        for size, one, other in zip((1.0, 1.0, scale, scale), point, scaled, strict=True):
            np.testing.assert_allclose(size * one, other, rtol=1e-6)


def test_directions_to_a_rectangle_from_behind_are_along_its_z() -> None:
    positions = np.array([(0.3, -0.2, 2.0), (0.3, -0.2, 0.0)])
    towards = directions_to_points(positions, draw(project_part(positions, 2.0, 1.0), np.full((2, 2), 0.25)))
    np.testing.assert_array_equal(towards, np.broadcast_to((0.0, 0.0, 1.0), (2, 3)))


def test_a_rectangle_of_no_size_is_seen_at_no_angle() -> None:
    assert project_rectangle(*np.array([0.0, 0.0, 0.0, 0.0, 1.0])).solid_angle == 0.0


def test_a_cylinder_is_covered_from_a_grid_of_places() -> None:
    places = np.random.default_rng(3).normal(scale=3.0, size=(4, 5, 3))
    for grid, row in zip(
        covering_rectangle(places, 3.0, 1.0), covering_rectangle(places.reshape(-1, 3), 3.0, 1.0), strict=True
    ):
        np.testing.assert_array_equal(np.reshape(grid, (20,)), row)


@pytest.mark.parametrize("above", ABOVE)
def test_a_sphere_and_a_cylinder_are_sampled_in_float32(above: float) -> None:
    grid = strata(32)
    shading_point = np.tile((0.6 * (1.0 + above), 0.0, -0.8 * (1.0 + above)), (len(grid), 1))

    def by_cone(shading_point: Floats, u: Floats) -> tuple[Floats, Floats]:
        versine = sphere_versine(shading_point, 1.0)
        axis = -shading_point / np.sqrt((shading_point * shading_point).sum(axis=-1, keepdims=True))
        return uniform_pdf(versine), orient_to_axis(axis, draw_uniform(versine, u))

    def by_cover(shading_point: Floats, u: Floats) -> tuple[Floats, Floats]:
        turned = shading_point[:, [1, 0, 2]]
        cover = covering_rectangle(turned, 3.0, 1.0)
        point = draw(cover.spherical_rectangle, u)
        return density(cover.spherical_rectangle, point), cover.directions_to(point)

    for method in (by_cone, by_cover):
        pdf, wi = method(*single(shading_point, grid))
        assert pdf.dtype == wi.dtype == np.float32
        right_pdf, right_wi = method(*double(shading_point, grid))
        np.testing.assert_allclose(pdf, right_pdf, rtol=1e-4)
        # As parts of the angle at which the light is seen; float32 directions are 6e-8 apart.
        wide = 1.0 / np.sqrt(right_pdf.max())
        assert np.abs(wi - right_wi).max() < 1e-4 * min(wide, 1.0) + 1e-7
