"""A scene: the look of every part, its lights, and the split of a mesh for links."""

from dataclasses import replace

import numpy as np
import pytest

from lookdev.asset import Asset, load_asset
from lookdev.asset.mesh import Instance
from lookdev.asset.store import make_asset
from lookdev.errors import EnvironmentMapError
from lookdev.light import LIGHT_KINDS, Emission, Light, RectLight, load_environment, prepare_light
from lookdev.light.dome.local import LocalDome
from lookdev.light.emission import MAX_SHADOW_GROUPS, LightLink
from lookdev.material import Layer, Look
from lookdev.plan.digest import part_digests
from lookdev.rendering.scene import scene_task
from lookdev.scene import Film, Pose, Sampling, Scene
from lookdev.scene.framing import frame_camera
from lookdev.scene.scene import link_lights

GREY, RED = (Look(name, (Layer("l", "disney"),)) for name in ("grey", "red"))


def three() -> Asset:
    """Return three instances of a plane, at /a/one, /a/two and /b."""
    plane = load_asset(builtin="plane")
    mesh = replace(plane.meshes[0], name="/a/one")
    instances = tuple(Instance(0, np.eye(4), path) for path in ("/a/one", "/a/two", "/b"))
    return make_asset("three", (mesh,), instances, tuple(replace(slot, path="/a/one") for slot in plane.slots))


def light(*rules: tuple[str, str], linked: bool = True) -> Light:
    emission = Emission(light_link=LightLink(rules) if linked else None)
    return replace(LIGHT_KINDS["rect"].example(), emission=emission)  # type: ignore[type-var]


def link(lights: tuple[Light, ...]) -> Scene:
    """Return the scene of `three` under linked lights."""
    return link_lights(replace(Scene.of_look(three(), GREY, lights[0], (8, 8)), lights=lights))


@pytest.mark.parametrize(
    ("rules", "meshes", "expected"),
    [
        ((("/", "expandPrims"),), 1, {"/a/one": (0, 1)}),
        ((("/a", "expandPrims"),), 2, {"/a/one": (0, 1), "/b": (1,)}),
        ((("/", "expandPrims"), ("/a/two", "exclude")), 2, {"/a/one": (0, 1), "/a/two": (1,)}),
        ((), 1, {"/a/one": (1,)}),
    ],
)
def test_meshes_are_split_where_instances_are_lit_differently(
    rules: tuple[tuple[str, str], ...], meshes: int, expected: dict[str, tuple[int, ...]]
) -> None:
    linked = link((light(*rules), light(linked=False)))
    assert len(linked.asset.meshes) == meshes
    assert linked.lights_of_slot == expected
    assert linked.look_of_slot == dict.fromkeys(expected, GREY)
    assert not linked.groups


@pytest.mark.parametrize("kind", LIGHT_KINDS)
def test_lights_of_every_kind_are_linked(kind: str) -> None:
    # Without sampling tables, domes take a thousandth of the time.
    white = prepare_light(load_environment(builtin="white"), sampled=False)
    domes = {"dome": white, "local_dome": LocalDome(dome=white, position=(0.5, 0.0, 0.5), radius=3.0)}
    other = domes.get(kind) or LIGHT_KINDS[kind].example()
    linked = link((light(("/a", "expandPrims")), other))
    assert linked.lights_of_slot == {"/a/one": (0, 1), "/b": (1,)}
    assert linked.lights[1].digest == other.digest


def test_without_links_all_is_as_given() -> None:
    asset, look_of_part, lights = three(), {"/a/one": GREY}, (light(linked=False),)
    scene = Scene(asset, look_of_part, lights, frame_camera(asset.center, asset.radius, (8, 8)), Film((8, 8)))
    assert link_lights(scene) is scene


def test_parts_that_cast_shadows_of_the_same_lights_are_a_group() -> None:
    def casting(*paths: str) -> Light:
        rules = tuple((path, "expandPrims") for path in paths)
        return replace(light(linked=False), emission=Emission(shadow_link=LightLink(rules)))  # type: ignore[type-var]

    lights = (casting("/a"), casting("/a", "/b"), casting("/a/one"))
    linked = link(lights)
    assert len(linked.asset.meshes) == 3
    assert linked.groups == {"/a/one": 0, "/a/two": 1, "/b": 2}
    assert [source.emission.shadow_excluded for source in linked.lights] == [(2,), (), (1, 2)]
    assert not linked.lights_of_slot


def test_more_groups_than_a_normal_can_mark_are_refused() -> None:
    asset = three()
    scene = Scene.of_look(asset, GREY, light(linked=False), (8, 8))
    assert scene.slot_groups == (0,) * len(asset.slots)
    groups = {slot.path: MAX_SHADOW_GROUPS + 1 for slot in asset.slots}
    with pytest.raises(EnvironmentMapError, match=r"into 82 groups .* at most 81"):
        scene_task(replace(scene, groups=groups), Sampling())


def test_a_source_is_made_for_each_set_of_lights() -> None:
    lights = (light(("/a", "expandPrims")), light(linked=False))
    task = scene_task(replace(link(lights), groups={}), Sampling())
    assert task.shader_lights == ((0, 1), (1,))
    assert [task.lights_of_shader(number) for number in task.slot_shaders] == [lights, lights[1:]]
    other = replace(task, shader_lights=((0, 1), (0,)))
    one, two = (part_digests(variant, Pose(0.0, 0.0), 0.0) for variant in (task, other))
    assert [part for part in one if one[part] != two[part]] == ["ibl"]


def test_each_light_that_reaches_nothing_has_the_layer_of_its_group() -> None:
    """Digests of frames include this list, a group once for each of its lights: rendered frames depend on it."""
    key, black = (
        replace(RectLight.example(), position=(0.0, 0.0, 3.0), emission=Emission(color, group=group))
        for color, group in (((1.0, 1.0, 1.0), "key"), ((0.0, 0.0, 0.0), "fill"))
    )
    scene = replace(Scene.of_look(three(), GREY, key, (8, 8)), lights=(key, black, black))
    task = scene_task(scene, Sampling(passes=("lights",)))
    assert (task.lights, task.light_groups) == ((key,), ("key", "fill", "fill"))


def test_looks_are_in_the_order_of_the_slots() -> None:
    asset, white = load_asset(builtin="shaderball"), prepare_light(load_environment(builtin="white"))
    body, base = (slot.path for slot in asset.slots)
    camera, film = frame_camera(asset.center, asset.radius, (8, 4)), Film((8, 4))
    assert Scene(asset, {base: RED, body: GREY}, (white,), camera, film).looks == (GREY, RED)
    scene = Scene.of_look(asset, RED, white, (8, 4))
    assert (scene.looks, scene.camera, scene.film) == ((RED, RED), camera, film)
    with pytest.raises(ValueError, match=f"shaderball: no look for {base}$"):
        Scene(asset, {body: RED}, (white,), camera, film)


def test_a_light_is_kept_that_reaches_the_asset_in_any_pose() -> None:
    """Turned by 180 degrees about an axis 3 m aside, the asset is in front of a light that faced away from it."""
    asset = load_asset(builtin="sphere")
    facing_x = ((0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (-1.0, 0.0, 0.0))
    lights = (light(linked=False), RectLight(width=0.1, height=0.1, position=(4.0, 0.0, 0.0), axes=facing_x))
    scene = Scene.of_look(asset, GREY, lights[0], (8, 8))
    for axis, remaining in (((3.0, 0.0), lights), ((0.0, 0.0), lights[:1])):
        turning = replace(scene, lights=lights, camera=replace(scene.camera, axis=axis))
        assert turning.without_idle_lights().lights == remaining
