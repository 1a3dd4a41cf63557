"""Looks whose parameters, masks and presence depend on the view: frames against the float64 reference, and albedos."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from agreement import assert_mesh_agreement
from frames import POSE, RenderScene, orbit_camera

from lookdev.asset import load_asset
from lookdev.checks.albedo import check_albedo
from lookdev.checks.images import check_frame, choose_pixels
from lookdev.material import Bump, Formula, Layer, Look, Texture, View
from lookdev.material.expression import parse
from lookdev.reference.mesh import MeshScene
from lookdev.reference.render import frame_pixels

pytestmark = pytest.mark.cycles

SIZE, SAMPLES, SEEDS = 48, 32, 6


def of_view(text: str, **inputs: Any) -> Formula:
    return Formula(parse(text), {"view": View(), **inputs}, {"view": "float", **dict.fromkeys(inputs, "float")})


def pearl(bump: Bump | None = None, exponent: int = 2) -> tuple[Layer, ...]:
    """Two-tone paint, rougher where it faces the viewer, under dust that is seen where the view grazes."""
    inputs = {
        "baseColor": of_view(f"mix([.8, .1, .05], [.05, .2, .8], (1 - view) ^ {exponent})"),
        "roughness": of_view("0.2 + 0.5 * view"),
        "metallic": 0.5,
    }
    dust = Layer("Dust", "pixar", {"surfaceColor": (0.6, 0.5, 0.3)}, of_view("smoothstep(1 - view, 0.4, 0.9)"))
    return Layer("Paint", "disney", inputs | ({"normal": bump} if bump else {})), dust


VEIL = (Layer("Veil", "pixar", {"presence": of_view("0.9 - 0.6 * view"), "clear": 0.4, "back": of_view("1 - view")}),)


@pytest.fixture
def bump(tmp_path: Path) -> Bump:
    blocks = np.kron(np.random.default_rng(1).integers(0, 256, (8, 8)), np.ones((2, 2))).astype(np.uint8)
    assert oiio.ImageBuf(blocks[..., None]).write(str(tmp_path / "height.png"))
    return Bump(Texture(tmp_path / "height.png", "r", "raw"), 0.02)


@pytest.mark.parametrize(("name", "bounces"), [("shaderball", 2), pytest.param("suzanne", 2, marks=pytest.mark.proof)])
def test_a_mesh_agrees(name: str, bounces: int, bump: Bump, render: RenderScene, light_of) -> None:
    light, asset, layers = light_of("city"), load_asset(builtin=name), pearl(bump)
    frames = [render(asset, layers, light, samples=SAMPLES, seed=k, size=SIZE, bounces=bounces) for k in range(SEEDS)]
    assert_mesh_agreement(frames, asset, layers, light, samples=SAMPLES, bounces=bounces)

    # Another dependence on the view is another frame.
    alpha = frames[0].alpha
    chosen = choose_pixels(alpha, 80, seed=1)
    scene = MeshScene(asset, [Look("other", pearl(bump, exponent=3))] * len(asset.slots))
    camera = orbit_camera(asset.center, asset.radius)
    other = frame_pixels(scene, [light], camera, POSE, alpha.shape, chosen, bounces=bounces)
    halves = np.stack([half for frame in frames for half in (frame.a, frame.b)])
    assert not check_frame(name, halves, alpha, SEEDS * SAMPLES, chosen, other).passed


def test_a_view_behind_a_hole_is_that_of_the_ray(render: RenderScene, light_of) -> None:
    light, asset = light_of("city"), load_asset(builtin="suzanne")
    frames = [render(asset, VEIL, light, samples=SAMPLES, seed=k, size=SIZE, bounces=2) for k in range(SEEDS)]
    assert_mesh_agreement(frames, asset, VEIL, light, samples=SAMPLES, bounces=2)


def test_nodes_that_are_exact_agree(bump: Bump, render: RenderScene, light_of) -> None:
    light, asset, layers = light_of("slopes"), load_asset(builtin="shaderball"), pearl(bump)
    options = {"backend": "nodes-exact", "samples": 128, "size": SIZE, "bounces": 2}
    frames = [render(asset, layers, light, seed=seed, **options) for seed in range(8)]
    assert_mesh_agreement(frames, asset, layers, light, samples=128, bounces=2)


@pytest.mark.parametrize("backend", ["exact", "nodes"])
def test_albedos_are_those_of_each_view(backend: str, worker) -> None:
    def render(task: Any) -> Any:
        worker.start()
        return worker.render(task, lambda progress: None)

    found = check_albedo(Look("pearl", pearl()), render, angles=(0.0, 45.0, 80.0), backend=backend)
    assert found.figures["curves"] == 1.0
    assert found.passed, "\n".join((found.summary, *found.details))
