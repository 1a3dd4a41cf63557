"""Frames of meshes against the float64 reference: textures, masks and normals of several layers, and bounces."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from agreement import assert_mesh_agreement
from frames import POSE, RenderScene, orbit_camera
from numpy.typing import NDArray
from painted import embossed, image, painted, sparkling

from lookdev.asset import Asset, load_asset
from lookdev.asset.mesh import Instance
from lookdev.asset.store import make_asset
from lookdev.asset.tangents import tangents_of
from lookdev.checks.images import choose_pixels
from lookdev.light import Dome
from lookdev.material import Layer, Look, Texture
from lookdev.reference.mesh import MeshScene
from lookdev.reference.render import frame_pixels

pytestmark = pytest.mark.cycles

SIZE, SAMPLES, SEEDS, BOUNCES = 48, 32, 6, 2


@pytest.mark.parametrize(
    ("name", "look"),
    [
        ("suzanne", painted),
        pytest.param("shaderball", painted, marks=pytest.mark.proof),
        pytest.param("suzanne", embossed, marks=pytest.mark.proof),
        ("shaderball", embossed),
        ("suzanne", sparkling),
        pytest.param("shaderball", sparkling, marks=pytest.mark.proof),
    ],
)
def test_meshes_agree_within_their_own_noise(name: str, look, render: RenderScene, light_of, tmp_path: Path) -> None:
    assert_agreement(render, load_asset(builtin=name), look(tmp_path), light_of("city"))


def test_a_reflected_instance_has_its_bitangent_on_the_other_side(render: RenderScene, light_of) -> None:
    suzanne = load_asset(builtin="suzanne")
    reflected = make_asset("reflected", suzanne.meshes, [Instance(0, np.diag([-1.0, 1.0, 1.0, 1.0]))], suzanne.slots)
    inputs = {"baseColor": (0.5, 0.5, 0.5), "roughness": 0.5, "normal": (0.0, 0.6, 0.8)}
    assert_agreement(render, reflected, (Layer("Leaning", "disney", inputs),), light_of("city"))


@pytest.mark.parametrize("backend", ["exact", "nodes"])
@pytest.mark.parametrize("name", ["brushed", "normal-mapped"])
def test_looks_that_read_tangents_get_them(
    name: str, backend: str, render: RenderScene, light_of, tmp_path: Path
) -> None:
    asset, light = load_asset(builtin="suzanne"), light_of("slopes")
    inputs: dict[str, Any] = {"baseColor": (0.9, 0.7, 0.4), "metallic": 1.0, "roughness": 0.4}
    if name == "brushed":
        inputs["anisotropic"] = 1.0
    else:
        grain = image(tmp_path / "grain.png", 2)
        inputs["normal"] = Texture(grain, "rgb", "raw", scale=(0.8, 0.8, 0.2, 1.0), bias=(-0.1, -0.4, 0.8, 0.0))
    layers = (Layer("Metal", "disney", inputs),)
    frames = [
        render(asset, layers, light, samples=64, seed=seed, size=SIZE, bounces=0, backend=backend) for seed in range(4)
    ]
    alpha = frames[0].alpha
    chosen = choose_pixels(alpha, 200, seed=1)
    columns, rows = chosen.T
    shown = np.mean([(frame.a.astype(np.float64) + frame.b)[rows, columns] / 2.0 for frame in frames], axis=0)

    def reference(tangents: NDArray[np.float32]) -> NDArray[np.float64]:
        scene = MeshScene(replace(asset, meshes=(replace(asset.meshes[0], tangents=tangents),)), [Look("look", layers)])
        camera = orbit_camera(asset.center, asset.radius)
        return frame_pixels(scene, [light], camera, POSE, alpha.shape, chosen).value

    (mesh,), (tangents,) = asset.meshes, tangents_of(asset.meshes)
    right, turned = reference(tangents), reference(np.cross(mesh.normals, tangents))
    assert np.abs(shown - right).mean() < 0.25 * np.abs(turned - right).mean()


def assert_agreement(render: RenderScene, asset: Asset, layers: tuple[Layer, ...], light: Dome) -> None:
    frames = [
        render(asset, layers, light, samples=SAMPLES, seed=seed, size=SIZE, bounces=BOUNCES) for seed in range(SEEDS)
    ]

    found = assert_mesh_agreement(frames, asset, layers, light, samples=SAMPLES, bounces=BOUNCES)
    # The comparison is accurate enough for a fault of a few percent to show.
    assert found.figures["bias_limit"] < 0.05
