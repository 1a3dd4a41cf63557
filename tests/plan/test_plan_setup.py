"""Setups: an asset that looks the same all around does so only about its own axis."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lookdev.asset import load_asset
from lookdev.light import load_environment, prepare_light
from lookdev.material import Layer, Look
from lookdev.plan import make_setup
from lookdev.scene import Camera, Sampling, Scene


@pytest.mark.parametrize(("axis", "around"), [(None, True), ((0.0, 1e-7), True), ((0.0, 0.5), False)])
def test_a_ball_looks_the_same_all_around_its_axis(axis: tuple[float, float] | None, around: bool) -> None:
    ball, plain = load_asset(builtin="sphere"), Look("plain", (Layer("Base", "disney"),))
    camera = replace(Camera(40.0, 10.0, ball.center, 5.0), axis=axis)
    scene = Scene.of_look(ball, plain, prepare_light(load_environment(builtin="white")), (8, 8), camera)
    assert make_setup("plain", "white", scene, Sampling()).around is around
