"""Frames of Mitsuba in ACEScg beside those in linear Rec.709."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lookdev.asset import load_asset
from lookdev.light import load_environment, prepare_light
from lookdev.light.space import in_space
from lookdev.material import Layer, Look
from lookdev.render.scene import scene_task
from lookdev.render.task import one_frame
from lookdev.render.worker import Worker
from lookdev.scene import Film, Pose, Sampling, Scene
from lookdev.space import Space, to_rec709

pytestmark = pytest.mark.mitsuba

RED = Look("red", (Layer("paint", "disney", {"baseColor": (0.8, 0.02, 0.02), "clearcoat": 0.5}),))


def test_under_white_light_colours_agree_after_conversion(worker: Worker) -> None:
    light = prepare_light(load_environment(builtin="white"))
    worker.start()
    shown = {}
    spaces: tuple[Space, ...] = ("rec709", "acescg")
    for space in spaces:
        scene = Scene.of_look(load_asset(builtin="sphere"), RED, in_space(light, space), (24, 18))
        scene = replace(scene, film=Film((24, 18), space))
        task = one_frame(scene_task(scene, Sampling(samples=16), "mitsuba"), Pose(0.0, 0.0), space)
        frame = worker.render(task, lambda progress: None)
        shown[space] = 0.5 * (frame.a + frame.b)
    ours = shown["rec709"]
    # Only float32 differs: both have the same samples.
    off = np.abs(to_rec709(shown["acescg"], "acescg") - ours)
    assert (off <= 5e-5 * (ours.max(axis=-1, keepdims=True) + 1e-3)).all()
    assert ours[..., 0].max() > 0.4
