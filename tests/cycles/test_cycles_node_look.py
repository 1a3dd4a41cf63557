"""Looks as closures in Cycles: as bright as the exact backend has them, and none too big for Cycles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import POSE, orbit_camera
from looks import LOOKS

from lookdev.asset import load_asset
from lookdev.light import Dome
from lookdev.material import Layer, Look
from lookdev.material.usd import read_look
from lookdev.render.scene import scene_task
from lookdev.render.task import one_frame
from lookdev.render.worker import Rendered, Worker
from lookdev.scene import Sampling, Scene

pytestmark = pytest.mark.cycles

SHEEN = (Layer("sheen", "disney", {"baseColor": (0.0, 0.0, 0.0), "sheen": 1.0, "specular": 0.0}),)
MATERIALS = Path(__file__).parents[2] / "materials"


def shoot(worker: Worker, look: Look, light: Dome, backend: str, *, samples: int, size: int) -> Rendered:
    asset = load_asset(builtin="sphere")
    scene = Scene.of_look(asset, look, light, (size, size), orbit_camera(asset.center, asset.radius))
    worker.start()
    task = one_frame(scene_task(scene, Sampling(samples, bounces=1), backend), POSE, "")
    return worker.render(task, lambda progress: None)


def mean(frame: Rendered) -> Any:
    picture = (frame.a.astype(np.float64) + frame.b) / 2.0
    return picture[frame.alpha > 0.5].mean(axis=0)


@pytest.mark.parametrize("name", ["coated", "lacquered", "brushed", "sheen"])
def test_white_light_comes_back_as_from_the_exact_lobes(name: str, worker: Worker, light_of) -> None:
    look = Look(name, SHEEN if name == "sheen" else LOOKS[name])
    exact, nodes = (
        mean(shoot(worker, look, light_of("white"), backend, samples=64, size=32)) for backend in ("exact", "nodes")
    )
    # The albedo over all views: 1 % is what is promised of any. The noise of some 600 pixels is a tenth of that.
    np.testing.assert_allclose(nodes, exact, rtol=0.01)


def test_an_example_of_many_nodes_fits_into_cycles(worker: Worker, light_of) -> None:
    look = read_look(MATERIALS / "leaf.usda", None, {})
    frame = shoot(worker, look, light_of("white"), "nodes", samples=4, size=16)
    assert mean(frame).min() > 0.01
