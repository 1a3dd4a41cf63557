"""Recesses of glossy looks, with the directions that suit them, of which roulette chooses those that are traced."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from frames import POSE, orbit_camera
from numpy.typing import NDArray

from lookdev.asset import load_asset
from lookdev.checks.finding import Finding
from lookdev.checks.images import check_frame, choose_pixels
from lookdev.codegen import ShaderSource
from lookdev.light import Light
from lookdev.material import Input, Layer, Look
from lookdev.reference.mesh import MeshScene
from lookdev.reference.render import Estimate, frame_pixels
from lookdev.render.scene import scene_task
from lookdev.render.task import one_frame
from lookdev.render.worker import Worker
from lookdev.scene import Sampling, Scene

pytestmark = pytest.mark.cycles

SIZE, SAMPLES, SEEDS = 48, 32, 6
COPPER: dict[str, Input] = {"baseColor": (0.95, 0.64, 0.54), "metallic": 1.0, "roughness": 0.45}
Compare = Callable[[Callable[[str], str]], Finding]


@pytest.fixture(scope="module", params=[0.0, 0.7], ids=["copper", "brushed copper"])
def compare(request: pytest.FixtureRequest, worker: Worker, light_of: Callable[[str], Light]) -> Compare:
    """Return a function that renders a shaderball by altered OSL and compares it with the reference."""
    look, asset = (
        Look("look", (Layer("Metal", "disney", COPPER | {"anisotropic": request.param}),)),
        load_asset(builtin="shaderball"),
    )
    light, camera = light_of("slopes"), orbit_camera(asset.center, asset.radius)
    task = scene_task(Scene.of_look(asset, look, light, (SIZE, SIZE), camera), Sampling(SAMPLES))
    known: dict[bytes, tuple[NDArray[np.int64], Estimate]] = {}

    def found(alter: Callable[[str], str]) -> Finding:
        shaders = [replace(each, osl=alter(each.osl)) for each in task.shaders if isinstance(each, ShaderSource)]
        worker.start()
        altered = replace(task, shaders=tuple(shaders))
        frames = [worker.render(one_frame(altered, POSE, f"{n}", seed=n), lambda progress: None) for n in range(SEEDS)]
        halves, alpha = np.stack([half for frame in frames for half in (frame.a, frame.b)]), frames[0].alpha
        if alpha.tobytes() not in known:
            chosen = choose_pixels(alpha, 80, seed=1)
            scene = MeshScene(asset, [look] * len(asset.slots))
            estimate = frame_pixels(scene, [light], camera, POSE, alpha.shape, chosen, bounces=Sampling.bounces)
            known[alpha.tobytes()] = chosen, estimate
        return check_frame(asset.name, halves, alpha, SEEDS * SAMPLES, *known[alpha.tobytes()])

    return found


def replaced(given: str, planted: str) -> Callable[[str], str]:
    def alter(osl: str) -> str:
        assert given in osl
        return osl.replace(given, planted)

    return alter


OFTEN = replaced("#define LEAST_DENSITY 0.01\n", "#define LEAST_DENSITY 0.3\n")


def test_few_directions_and_roulette_keep_the_mean(compare: Compare) -> None:
    """Also where roulette ends more than half of the light's directions."""
    for alter in (str, OFTEN):
        found = compare(alter)
        assert found.passed, "\n".join((found.summary, *found.details))
        assert found.figures["bias_limit"] < 0.05


def test_survivors_without_their_weight_are_found(compare: Compare) -> None:
    fault = replaced("ratio /= traced;", "")
    assert not compare(lambda osl: fault(OFTEN(osl))).passed
