"""Features that Cycles' own lights lack are refused before rendering, with a message that names the light."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from frames import scene_of
from light_cases import dome, sunny

from lookdev.asset import load_asset
from lookdev.cache import Content
from lookdev.errors import EnvironmentMapError
from lookdev.light import LIGHT_KINDS, DiskLight, DistantLight, Light, RectLight, native_images
from lookdev.light.dome.environment import make_environment
from lookdev.light.emission import Emission, Falloff, LightLink, Shadow, Shaping
from lookdev.light.ies import IesProfile
from lookdev.light.native import are_domes_still
from lookdev.light.picture import prepare_texture
from lookdev.material import Layer, Look
from lookdev.rendering.scene import scene_task
from lookdev.scene import Sampling

LOOK = Look("white", (Layer("White", "disney", {"baseColor": (1.0,) * 3}),))
KEY = Emission(group="key", path="/Rig/Key")


def task(backend: str, *lights: Light) -> Any:
    return scene_task(scene_of(load_asset(builtin="sphere"), LOOK, lights, 8), Sampling(), backend)


@pytest.mark.parametrize(
    ("changed", "lacking"),
    [
        ({"diffuse": 0.5}, "a diffuse multiplier"),
        ({"specular": 0.0}, "a specular multiplier"),
        ({"shadow": Shadow(color=(0.1, 0.0, 0.0))}, "a shadow control"),
        ({"shadow": Shadow(enable=False)}, "a shadow control"),
        ({"falloff": Falloff(exponent=1.0)}, "a falloff"),
        ({"shaping": Shaping(profile=IesProfile(Content("a", ".npy"), 1.0, 1.0))}, "an IES profile"),
    ],
)
def test_what_blender_lacks_is_refused(changed: dict[str, Any], lacking: str) -> None:
    lights = sunny(), replace(DiskLight.example(), emission=replace(KEY, **changed))
    with pytest.raises(EnvironmentMapError, match=rf"light /Rig/Key \(disk\): it has {lacking}.*'exact' renders it"):
        task("nodes", *lights)


def test_all_that_a_light_has_is_named_at_once_and_each_light_on_a_line() -> None:
    both = replace(KEY, diffuse=0.5, falloff=Falloff(exponent=1.0), light_link=LightLink(()), camera=True)
    with pytest.raises(EnvironmentMapError) as caught:
        task("nodes", replace(DiskLight.example(), emission=both), DistantLight(angle=270.0))
    first, second = str(caught.value).splitlines()
    every = "a diffuse multiplier, a falloff of its own, a light that the camera sees and light links"
    assert first.startswith(f"light /Rig/Key (disk): it has {every}, which")
    assert second.startswith("light 2 (distant): it has an angle of 270 degrees")


def test_lamps_and_domes_are_refused_together() -> None:
    seen = replace(sunny(), emission=replace(KEY, diffuse=0.5))
    with pytest.raises(EnvironmentMapError) as caught:
        task("nodes-exact", DiskLight.example(), seen)
    lines = [line.split(":")[0] for line in str(caught.value).splitlines()]
    assert lines == ["light 1 (disk)", "light /Rig/Key (dome)"]


@pytest.mark.parametrize("backend", ["nodes", "principled"])
def test_all_else_is_shown(backend: str) -> None:
    supported = [kind.example() for kind in LIGHT_KINDS.values() if not kind.example().native_gap()]
    supported += [DistantLight(angle=180.0)]
    assert {light.kind for light in supported} == {*LIGHT_KINDS} - {"local_dome"}
    assert task(backend, *supported).lights == tuple(supported)


@pytest.mark.parametrize(("backend", "why"), [("nodes-exact", "only domes"), ("mitsuba-principled", "one dome alone")])
def test_backends_that_know_domes_alone_refuse_lamps(backend: str, why: str) -> None:
    with pytest.raises(EnvironmentMapError, match=why):
        task(backend, sunny(), DiskLight.example())


def test_domes_that_turn_and_domes_that_do_not_have_no_common_world() -> None:
    white = dome(np.ones((8, 16, 3)))
    still = replace(sunny(), emission=Emission(turns=False))
    rigs = ([sunny(), white], [still, white], [sunny(), still])
    assert [are_domes_still(domes) for domes in rigs] == [False, True, None]
    with pytest.raises(EnvironmentMapError, match="some domes stand still while others turn"):
        task("nodes", sunny(), still)


def test_images_are_those_of_domes_and_textures() -> None:
    texture = prepare_texture(make_environment("picture", np.ones((2, 2, 3))))
    light, textured = sunny(), replace(RectLight.example(), texture=texture)
    assert native_images([light, textured, RectLight.example()]) == (light.radiance_file, texture)
