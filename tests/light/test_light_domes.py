"""Domes with axes and a colour, and local domes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from light_cases import make_tables_small, overcast, sunny

from lookdev.light import Emission
from lookdev.light.dome.local import LocalDome, directions_to_ball
from lookdev.light.mapping import rotate_z
from lookdev.light.placement import Axes, to_local, to_world
from lookdev.space import to_space

PLACE = np.array([0.3, -0.2, 0.5])
MIRRORED: Axes = ((0.0, 0.8, 0.6), (1.0, 0.0, 0.0), (0.0, -0.6, 0.8))


def test_a_dome_is_turned_by_its_axes_and_multiplied_by_its_colour() -> None:
    plain = sunny()
    dome = replace(plain, axes=MIRRORED, emission=Emission((2.0, 1.0, 0.5)))
    u = np.random.default_rng(2).random((1000, 2))
    places = np.broadcast_to(PLACE, (1000, 3))
    wi = dome.sample(places, u)
    local = to_local(MIRRORED, wi)
    np.testing.assert_allclose(local, plain.sample(places, u), atol=1e-14)
    np.testing.assert_allclose(to_world(MIRRORED, local), wi, atol=1e-14)
    np.testing.assert_allclose(dome.radiance(places, wi), plain.radiance(places, local) * (2.0, 1.0, 0.5))
    np.testing.assert_allclose(dome.pdf(places, wi), plain.pdf(places, local))
    # A quarter turn to the left moves the map to the left.
    quarter = replace(plain, axes=((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    np.testing.assert_allclose(quarter.radiance(places, rotate_z(wi, 90.0)), plain.radiance(places, wi), atol=1e-9)


def local(**fields) -> LocalDome:
    return LocalDome(**{"dome": overcast(), "position": (0.5, 0.0, 0.2), "radius": 2.0, "edge": 0.0, **fields})


def test_a_local_dome_shows_what_its_sphere_has_there() -> None:
    light = local()
    rng = np.random.default_rng(8)
    onto = rng.normal(size=(1000, 3))
    onto /= np.linalg.norm(onto, axis=-1, keepdims=True)
    for offset in ((0.0, 0.0, 0.0), (1.2, -0.4, 0.3)):
        point = np.array(light.position) + offset
        towards = light.radius * onto - offset
        away = np.linalg.norm(towards, axis=-1)
        wi = towards / away[:, None]
        np.testing.assert_allclose(light.distance(point, wi), away, rtol=1e-12)
        np.testing.assert_allclose(light.radiance(point, wi), light.dome.radiance(point, onto), rtol=1e-9)


def test_a_place_on_the_sphere_has_a_direction_to_where_it_is() -> None:
    assert directions_to_ball(np.array([0.0, 2.0, 0.0]), np.array([0.0, 1.0, 0.0]), 2.0).tolist() == [0.0, 0.0, 1.0]


def test_a_local_dome_in_another_space_sends_the_same_light(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_tables_small(monkeypatch)
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path))
    emission = Emission((2.0, 1.0, 0.5), diffuse=0.5, group="sky")
    light = local().with_emission(emission)
    moved = light.in_space("acescg")
    assert replace(moved.emission, color=emission.color) == emission
    u = np.random.default_rng(2).random((100, 2))
    places = np.broadcast_to(PLACE, (100, 3))
    wi = light.sample(places, u)
    expected = to_space(light.radiance(places, wi), "acescg")
    np.testing.assert_allclose(moved.radiance(places, wi), expected, rtol=1e-6)


def test_a_local_dome_ends_softly() -> None:
    light, direction = local(edge=0.5, dome=overcast()), np.array([0.0, 0.0, 1.0])
    full = local().radiance
    for away, share in ((0.9, 1.0), (1.25, 1.0 - 0.15625), (1.5, 0.5), (1.75, 0.15625), (2.0, 0.0), (3.0, 0.0)):
        point = np.array(light.position) + np.array((away, 0.0, 0.0))
        np.testing.assert_allclose(light.radiance(point, direction), share * full(point, direction), rtol=1e-9)
        pdf = light.pdf(point, direction)
        assert pdf > 0.0 if away < 2.0 else pdf == 0.0
        assert np.isfinite(light.distance(point, direction)) == (away < 2.0)
