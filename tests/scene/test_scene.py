"""A scene: every part wears a look, and one look can cover all."""

from __future__ import annotations

import pytest

from lookdev.asset import load_asset
from lookdev.light import load_environment, prepare_light
from lookdev.material import Layer, Look
from lookdev.scene import Film, Scene, frame_camera

RED, BLUE = (Look(name, (Layer("Base", "disney"),)) for name in ("red", "blue"))


def test_looks_are_in_the_order_of_the_slots() -> None:
    asset, light = load_asset(builtin="shaderball"), prepare_light(load_environment(builtin="white"))
    body, base = (slot.path for slot in asset.slots)
    camera, film = frame_camera(asset.center, asset.radius, (8, 4)), Film((8, 4))
    assert Scene(asset, {base: RED, body: BLUE}, (light,), camera, film).looks == (BLUE, RED)
    scene = Scene.of_look(asset, RED, light, (8, 4))
    assert (scene.looks, scene.camera, scene.film) == ((RED, RED), camera, film)
    with pytest.raises(ValueError, match=f"shaderball: no look for {base}$"):
        Scene(asset, {body: RED}, (light,), camera, film)
