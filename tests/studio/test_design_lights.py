"""The lights of the Designer: settings of the view, which change numbers and no shader."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lookdev.asset import load_asset
from lookdev.codegen.glsl.rig import rig_functions
from lookdev.errors import LookdevError
from lookdev.light import LIGHT_KINDS, RigOrigin
from lookdev.light.dome.maps import load_dome
from lookdev.light.emission import Emission
from lookdev.light.rig.emission import black_body
from lookdev.material import Layer, Look
from lookdev.scene import Scene
from lookdev.studio.designer.lights import LightSetting, LightSettings, parse_setting

KINDS = ("rect", "sphere", "distant")


@pytest.fixture(scope="module")
def scene() -> Scene:
    asset, look = load_asset(builtin="plane"), Look("grey", (Layer("base", "disney", {}),))
    emissions = [(kind, Emission((3.0, 1.0, 4.0), path=f"/Rig/{kind}")) for kind in KINDS]
    lamps = [replace(LIGHT_KINDS[kind].example(), emission=emission) for kind, emission in emissions]
    dome = load_dome(builtin="city").dome
    return replace(Scene.of_look(asset, look, dome, (8, 6)), lights=(*lamps, dome))


def test_a_setting_multiplies_the_radiance(scene: Scene) -> None:
    lights = LightSettings()
    settings = [LightSetting(stops=2.0), LightSetting(on=False), LightSetting(color=(0.5, 1.0, 0.25), kelvin=3000.0)]
    for number, setting in enumerate(settings):
        lights.set("rig", scene, number, setting)
    colors = [light.emission.color for light in lights.apply("rig", scene).lights]
    before = np.array([light.emission.color for light in scene.lights])
    warm = np.multiply((0.5, 1.0, 0.25), black_body(3000.0))
    np.testing.assert_allclose(colors, before * np.array([[4.0] * 3, [0.0] * 3, warm, [1.0] * 3]), rtol=1e-12)
    assert lights.apply("another", scene) is scene
    lights.reset("rig")
    assert lights.apply("rig", scene) is scene


def test_numbers_change_and_no_shader_does(scene: Scene) -> None:
    lights, lights_of_parts = LightSettings(), [list(range(len(scene.lights)))]
    before = rig_functions(scene.lights, lights_of_parts, RigOrigin())
    described = lights.describe("rig", scene)
    lights.set("rig", scene, 1, LightSetting(on=False))
    lights.set("rig", scene, 3, LightSetting(stops=1.0))
    assert rig_functions(lights.apply("rig", scene).lights, lights_of_parts, RigOrigin()).text == before.text
    changed = lights.describe("rig", scene)
    assert [light["on"] for light in changed["lights"]] == [True, False, True, True]
    assert [light["name"] for light in changed["lights"]] == [*KINDS, "dome 4"]
    # The numbers of the page are the first ones of its texture.
    stand = RigOrigin(scene.asset.center, scene.camera.pivot)
    whole = rig_functions(lights.apply("rig", scene).lights, lights_of_parts, stand).numbers
    np.testing.assert_array_equal(np.float32(changed["rows"]), whole[: len(changed["rows"])])
    assert changed["rows"] != described["rows"]


def test_a_setting_of_no_sense_is_refused(scene: Scene) -> None:
    body: dict[str, Any] = {"light": 0, "on": True, "stops": 0, "color": [1, 1, 1], "kelvin": None}
    for change, message in (
        ({"light": 9}, "has 4 lights, none of number 9"),
        ({"on": 1}, "is on or not"),
        ({"stops": 40}, "stops is a number from -10 to 10"),
        ({"stops": float("nan")}, "stops is a number"),
        ({"color": [1, 1]}, "three numbers"),
        ({"color": [1, 1, -1]}, "colour is a number from 0 to 100"),
        ({"kelvin": 20}, "temperature is a number from 1000 to 10000"),
    ):
        with pytest.raises(LookdevError, match=message):
            LightSettings().set("rig", scene, *parse_setting(body | change))
