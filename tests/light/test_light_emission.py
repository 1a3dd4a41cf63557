"""The emission of lights, against the formulas of UsdLux and the definition of the falloff."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from closed_forms import Floats, by_sampling

from lookdev.errors import EnvironmentMapError
from lookdev.light import CylinderLight, DiskLight, DistantLight, Light, RectLight, SphereLight
from lookdev.light.dome import example_dome, example_map
from lookdev.light.dome.local import LocalDome
from lookdev.light.emission import Emission, Falloff, LightLink, Shadow, Shaping, azimuth, emitted_color
from lookdev.light.placed import PlacedLight
from lookdev.light.placement import placement

BELOW, UP = np.array([0.0, 0.0, -3.0]), np.array([0.0, 0.0, 1.0])
PLACED = (RectLight, DiskLight, SphereLight, CylinderLight)


def off_axis(degrees: float, azimuth: float = 0.0) -> Floats:
    """Return the direction to a light that emits at an angle off its axis, -z."""
    theta, phi = np.radians(degrees), np.radians(azimuth)
    return -np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), -np.cos(theta)])


def factor(shaping: Shaping, degrees: float) -> Floats:
    return Emission(shaping=shaping).radiance_towards(off_axis(degrees))


@pytest.mark.parametrize("angle", [0.0, 1e-3, 0.53, 40.0, 180.0])
def test_a_normalized_distant_light_keeps_its_irradiance(angle: float) -> None:
    bare = DistantLight(angle=angle)
    light = replace(bare, emission=Emission(emitted_color((1.0,) * 3, intensity=7.0, size=bare.size_factor)))
    assert by_sampling(light, BELOW, UP, 16) == pytest.approx(7.0, rel=1e-9)


def test_a_colour_is_scaled_by_powers_of_two() -> None:
    assert emitted_color((1.0, 0.5, 0.25), exposure=3.0) == (8.0, 4.0, 2.0)


def test_size_factors_are_those_of_usdlux() -> None:
    assert RectLight(width=2.0, height=3.0).size_factor == 6.0
    assert DiskLight(radii=(2.0, 3.0)).size_factor == pytest.approx(6.0 * np.pi)
    assert SphereLight(radius=2.0).size_factor == pytest.approx(16.0 * np.pi)
    assert CylinderLight(length=3.0, radius=2.0).size_factor == pytest.approx(12.0 * np.pi)
    for angle, expected in ((60.0, 0.25), (180.0, 1.0), (300.0, 1.75), (360.0, 2.0)):
        assert DistantLight(angle=angle).size_factor == pytest.approx(expected * np.pi)
    assert DistantLight(angle=0.0).size_factor == 1.0


@pytest.mark.parametrize("kind", PLACED)
def test_an_example_is_warm(kind: type[PlacedLight]) -> None:
    red, green, blue = kind.example().emission.color  # type: ignore[attr-defined]
    assert red > green > blue


def test_the_example_of_a_dome_is_a_dim_sky_a_sun_and_a_black_ground() -> None:
    zenith, sun, ground = (example_map().radiance[rows] for rows in (slice(3), slice(3, 6), slice(12, None)))
    assert (np.argsort(zenith) == (0, 1, 2)).all()  # it is blue
    assert zenith.max() < 0.1 * sun.max()
    assert not ground.any()


def test_the_azimuth_is_from_x_to_y() -> None:
    for degrees in (0.0, 30.0, 135.0, 225.0, 300.0):
        assert azimuth(off_axis(60.0, degrees)) == pytest.approx(degrees, abs=1e-9)


def test_the_cone_cuts_off_and_softens() -> None:
    hard = Shaping(cone_angle=40.0)
    assert factor(hard, 39.9)[0] == 1.0
    assert factor(hard, 40.1)[0] == 0.0
    soft = Shaping(cone_angle=40.0, cone_softness=0.25)
    for degrees, share in ((29.9, 1.0), (32.5, 1.0 - 0.15625), (35.0, 0.5), (37.5, 0.15625), (40.1, 0.0)):
        assert factor(soft, degrees)[0] == pytest.approx(share, abs=1e-12)
    # Values beyond [0, 1] are clamped.
    assert factor(replace(soft, cone_softness=7.0), 20.0)[0] == pytest.approx(0.5)
    assert factor(replace(hard, cone_softness=-1.0), 39.9)[0] == 1.0


def test_focus_is_a_power_of_the_cosine_and_tints_what_it_takes() -> None:
    tint = (0.0, 0.25, 1.0)
    for degrees in (0.0, 20.0, 60.0, 85.0, 120.0):
        focused = abs(np.cos(np.radians(degrees))) ** 3.5
        got = factor(Shaping(focus=3.5, focus_tint=tint), degrees)
        np.testing.assert_allclose(got, focused + (1.0 - focused) * np.array(tint), rtol=1e-12)
    assert (factor(Shaping(focus=-2.0), 60.0) == 1.0).all()


def test_the_beam_follows_the_axes() -> None:
    axes = ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    light = SphereLight(radius=0.1, axes=axes, emission=Emission(shaping=Shaping(cone_angle=30.0)))
    for point, radiance in (((-2.0, 0.0, 0.0), 1.0), ((2.0, 0.0, 0.0), 0.0), ((0.0, 0.0, -2.0), 0.0)):
        assert light.radiance(np.array(point), -np.array(point) / 2.0)[0] == radiance


@pytest.mark.parametrize("exponent", [0.0, 1.0, 2.0, 3.0, 4.5])
@pytest.mark.parametrize("beyond", [0.0, 2.5])
def test_a_small_light_falls_with_the_exponent_of_the_virtual_distance(exponent: float, beyond: float) -> None:
    falloff = Falloff(virtual_distance=beyond, exponent=exponent)
    light = SphereLight(radius=1e-3, emission=Emission(falloff=falloff))
    for distance in (0.5, 1.0, 3.0, 40.0):
        expected = np.pi * 1e-6 * (distance + beyond) ** -exponent
        got = by_sampling(light, np.array([0.0, 0.0, -distance]), UP, 4)
        assert got == pytest.approx(expected, rel=1e-3)


def test_a_falloff_fades_from_start_to_end() -> None:
    falloff = Falloff(start=2.0, end=4.0)
    for distance, share in ((0.0, 1.0), (1.0, 1.0), (2.5, 1.0 - 0.15625), (3.0, 0.5), (4.0, 0.0), (9.0, 0.0)):
        assert falloff.factor(np.array(distance)) == pytest.approx(share, abs=1e-12)


def test_a_shadow_passes_its_colour_and_fades_before_its_distance() -> None:
    distance = np.array([0.5, 2.0, 3.0, 3.5, 4.0, 5.0])
    assert (Shadow().transmittance(distance) == 0.0).all()
    assert (Shadow(enable=False).transmittance(distance) == 1.0).all()
    np.testing.assert_allclose(Shadow(color=(0.5, 0.0, 1.0)).transmittance(distance), np.tile((0.5, 0.0, 1.0), (6, 1)))
    np.testing.assert_allclose(Shadow(distance=4.0).transmittance(distance)[:, 0], [0, 0, 0, 0, 0, 1])
    fading = Shadow(distance=4.0, falloff=2.0, falloff_gamma=2.0, color=(0.2, 0.0, 0.0))
    strength = np.array([1.0, 1.0, 0.25, 0.0625, 0.0, 0.0])
    np.testing.assert_allclose(fading.transmittance(distance)[:, 1], 1.0 - strength)
    np.testing.assert_allclose(fading.transmittance(distance)[:, 0], 1.0 - 0.8 * strength)
    # The zone is limited to the whole distance.
    np.testing.assert_allclose(Shadow(distance=4.0, falloff=9.0).transmittance(np.array([1.0]))[0], 0.25)


def test_a_placement_is_taken_apart_and_put_together() -> None:
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]]) @ np.diag((1.0, -1.0, 1.0))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn @ np.diag((2.0, 3.0, 0.5)), (1.0, 2.0, 3.0)
    position, axes, scale = placement(matrix)
    assert position == (1.0, 2.0, 3.0)
    np.testing.assert_allclose(axes, turn.T, atol=1e-15)
    np.testing.assert_allclose(scale, (2.0, 3.0, 0.5))
    matrix[0, 1] += 0.5
    with pytest.raises(EnvironmentMapError, match=r"skewed: two of its axes have a cosine of 0\.\d+"):
        placement(matrix)
    matrix[:3, 2] = 0.0
    with pytest.raises(EnvironmentMapError, match="flat or not finite"):
        placement(matrix)


def local_dome(**fields: Any) -> LocalDome:
    return LocalDome(**{"dome": example_dome(), "position": (0.0, 0.0, 0.0), "radius": 1.0, "edge": 0.0, **fields})


WRONG = [
    (lambda: RectLight(width=0.0, height=1.0), "width 0: a number that is more than 0 would be right"),
    (lambda: RectLight(width=1.0, height=float("nan")), "height nan"),
    (lambda: DiskLight(radii=(1.0, -2.0)), "radius -2"),
    (lambda: SphereLight(radius=float("inf")), "radius inf"),
    (lambda: CylinderLight(length=1.0, radius=0.0), "radius 0"),
    (lambda: CylinderLight(length=0.0, radius=1.0), "length 0"),
    *(
        (lambda kind=kind: replace(kind.example(), position=(0.0, float("nan"), 0.0)), "position nan")
        for kind in PLACED
    ),
    (lambda: SphereLight(radius=1.0, axes=((1.0, 0.0, 0.0),) * 3), "three unit vectors at right angles"),
    (lambda: DistantLight(angle=-1.0), "angle -1: a number that is at least 0 would be right"),
    (lambda: DistantLight(emission=Emission(falloff=Falloff())), "a distant light has no falloff"),
    (lambda: replace(example_dome(), emission=Emission(shaping=Shaping())), "a dome light has neither"),
    (lambda: Emission((1.0, -1.0, 0.0)), r"colour times intensity \(1, -1, 0\): finite channels, none negative"),
    (lambda: Emission(diffuse=-1.0), "diffuse multiplier -1"),
    (lambda: Emission(specular=float("nan")), "specular multiplier nan"),
    (lambda: emitted_color((1.0,) * 3, intensity=-1.0), "intensity -1"),
    (lambda: emitted_color((1.0,) * 3, exposure=float("inf")), "exposure inf"),
    (lambda: Emission(emitted_color((1.0,) * 3, intensity=1e9, exposure=1e9)), r"intensity \(inf, inf, inf\)"),
    (lambda: local_dome(radius=0.0), "radius 0"),
    (lambda: local_dome(edge=1.5), "edge 1.5: a part"),
    (lambda: local_dome(position=(0.0, float("nan"), 0.0)), "position"),
    (lambda: Falloff(start=3.0, end=3.0), "falloff end 3: more than its start, 3, would be right"),
    (lambda: Falloff(exponent=-1.0), "falloff exponent -1"),
    (lambda: Falloff(start=-1.0), "falloff start -1: a number that is at least 0"),
    (lambda: Shaping(cone_angle=-1.0), "cone angle -1"),
    (lambda: Shadow(falloff_gamma=-1.0), "shadow falloff gamma -1"),
]


@pytest.mark.parametrize(("make", "message"), WRONG, ids=[message[:20] for _, message in WRONG])
def test_what_no_light_can_be_is_refused(make, message: str) -> None:
    with pytest.raises(EnvironmentMapError, match=message):
        make()


def test_every_value_is_part_of_the_digest() -> None:
    light = SphereLight(radius=1.0)
    others: list[Light] = [
        replace(light, radius=2.0),
        replace(light, position=(1.0, 0.0, 0.0)),
        replace(light, emission=Emission(diffuse=0.5)),
        replace(light, emission=Emission(shadow=Shadow(enable=False))),
        replace(light, emission=Emission(turns=False)),
        replace(light, emission=Emission(shadow_excluded=(1,))),
    ]
    dome = example_dome()
    others += [dome, replace(dome, emission=Emission((2.0, 1.0, 1.0))), replace(dome, axes=RectLight.example().axes)]
    assert dome.digest == dome.map_digest
    assert light.digest == replace(light, emission=Emission(group="key", light_link=LightLink(()))).digest
    assert len({light.digest, *(other.digest for other in others)}) == 1 + len(others)
