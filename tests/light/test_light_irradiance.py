"""Irradiance on a Lambert plane by quadrature of each light's sampling, against closed forms or its surface's area."""

from typing import Any

import numpy as np
import pytest
from closed_forms import Floats, by_sampling, of_cone, of_polygon

from lookdev.light import CylinderLight, DiskLight, DistantLight, Light, RectLight, SphereLight
from lookdev.light.placement import Axes, to_world

AXES: Axes = ((0.8, 0.6, 0.0), (-0.6, 0.8, 0.0), (0.0, 0.0, 1.0))
POSITION = (0.3, -0.2, 2.0)
STANDS: dict[str, Any] = {"position": POSITION, "axes": AXES}
# Points and normals for a light 2 m above: below it, at its edge, aside, far, close, in all tilts.
PLACES = np.array(
    [
        (0.3, -0.2, 0.0), (0.5, 0.1, 1.5), (1.4, 0.3, 1.9), (-0.6, -0.5, 1.99), (0.31, -0.21, 1.999),
        (4.0, 1.0, 1.0), (0.0, 30.0, -40.0), (-2.0, 0.4, 1.7), (0.9, 0.25, 1.0), (300.0, 10.0, -500.0),
    ]
)  # fmt: skip
NORMALS = np.array(
    [
        (0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (-0.8, 0.0, 0.6), (0.0, 0.6, 0.8), (0.6, -0.64, 0.48),
        (-1.0, 0.0, 0.0), (0.0, -0.6, 0.8), (1.0, 0.0, 0.0), (-0.48, -0.64, -0.6), (-0.36, 0.48, 0.8),
    ]
)  # fmt: skip
FACING = np.where(np.arange(10)[:, None] == 4, NORMALS * (-1.0, -1.0, 1.0), NORMALS)
"""Normals at points from which the middle of the light is visible, or nearly so."""
ANGLE = 2.0 * np.pi * np.arange(2048) / 2048
SQUARE = np.array([(-0.8, -0.35, 0.0), (0.8, -0.35, 0.0), (0.8, 0.35, 0.0), (-0.8, 0.35, 0.0)])
# A polygon of the ellipse's area.
ELLIPSE = np.sqrt(ANGLE[1] / np.sin(ANGLE[1])) * np.stack(
    [0.8 * np.cos(ANGLE), 0.35 * np.sin(ANGLE), 0.0 * ANGLE], axis=-1
)


def light_corners(corners: Floats) -> Floats:
    return np.array(POSITION) + to_world(AXES, corners)


RADII = {
    "sphere": (1.9, 0.2, 0.7, 0.3, 0.01, 1.0, 30.0, 1.5, 0.1, 1e-3),
    "cylinder": (0.2, 0.1, 0.15, 0.05, 0.004, 0.8, 10.0, 1.0, 0.3, 50.0),
}


def light_and_irradiance(kind: str, number: int) -> tuple[Light, Floats, float]:
    """Return a light, a normal, and the irradiance: in closed form, or as an integral over the light's surface."""
    point, normal, facing = PLACES[number], NORMALS[number], FACING[number]
    match kind:
        case "rect":
            return RectLight(width=1.6, height=0.7, **STANDS), normal, of_polygon(light_corners(SQUARE), point, normal)
        case "disk":
            return DiskLight(radii=(0.8, 0.35), **STANDS), normal, of_polygon(light_corners(ELLIPSE), point, normal)
        case "sphere":
            towards = np.array(POSITION) - point
            away = float(np.linalg.norm(towards))
            sphere = SphereLight(radius=RADII[kind][number], position=POSITION)
            assert away > sphere.radius
            return sphere, facing, of_cone(sphere.radius / away, float(towards @ facing) / away)
    light = CylinderLight(length=1.5, radius=RADII[kind][number], **STANDS)
    x = light.length * ((np.arange(1000) + 0.5) / 1000 - 0.5)
    x, angle = (values.ravel() for values in np.meshgrid(x, 2.0 * np.pi * (np.arange(500) + 0.5) / 500))
    outward = np.stack([0.0 * angle, np.cos(angle), np.sin(angle)], axis=-1)
    towards = light_corners(np.stack([x, 0.0 * x, 0.0 * x], axis=-1) + light.radius * outward) - point
    sent = np.maximum(-(towards * to_world(AXES, outward)).sum(axis=-1), 0.0) * np.maximum(towards @ facing, 0.0)
    return light, facing, (sent / (towards**2).sum(axis=-1) ** 2).mean() * light.size_factor


# Gauss' rule, 16 x 8 nodes a side, is exact if the light fills the square of random numbers. If the horizon cuts the
# light, its error is up to 3e-5, 1 mm away. A rim within the square is resolved to one node.
RIM, CUT, WHOLE = 1e-3, 5e-5, 1e-9
ALL_CUT = {"rect": (1, 2, 3, 4, 5, 8), "sphere": (3, 8)}


@pytest.mark.parametrize("number", range(10))
@pytest.mark.parametrize("kind", ["rect", "disk", "sphere", "cylinder"])
def test_a_light_sends_what_lambert_has_or_what_its_surface_sends(kind: str, number: int) -> None:
    light, normal, expected = light_and_irradiance(kind, number)
    assert expected > 0.0
    # From afar, the directions that miss the cylinder are in few panels.
    panels = {"disk": 32, "cylinder": 64 if number in (6, 9) else 32}.get(kind, 16)
    tolerance = (CUT if number in ALL_CUT[kind] else WHOLE) if kind in ALL_CUT else RIM
    assert by_sampling(light, PLACES[number], normal, panels) == pytest.approx(expected, rel=tolerance)


@pytest.mark.parametrize("angle", [0.01, 0.53, 3.0, 20.0, 60.0, 90.0, 120.0, 150.0, 170.0, 179.9])
def test_a_distant_light_is_a_cone(angle: float) -> None:
    light = DistantLight(angle=angle, axes=AXES)
    for normal in NORMALS:
        expected = of_cone(np.sin(np.radians(angle / 2.0)), normal[2])
        assert by_sampling(light, PLACES[0], normal, 16) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.003])
def test_a_distant_light_that_is_too_narrow_is_drawn_wider(angle: float) -> None:
    light = DistantLight(angle=angle, axes=AXES)
    expected = np.pi * np.sin(np.radians(angle / 2.0)) ** 2 if angle else 1.0
    for tilt in (0.0, 0.5, 1.5):
        normal = np.array((np.sin(tilt), 0.0, np.cos(tilt)))
        assert by_sampling(light, PLACES[0], normal, 4) == pytest.approx(expected * np.cos(tilt), rel=1e-6)
