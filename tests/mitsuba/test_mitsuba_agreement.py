"""Frames of Mitsuba against the float64 reference: every lobe of every model, textures, bounces, and transmission."""

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from agreement import SHAPES, assert_agreement, assert_scene_agreement
from frames import POSE, orbit_camera
from looks import LOOKS, quick_among
from mitsuba_scenes import RenderSeeds, assert_parts_agree, looks_side_by_side, scene_with_look
from painted import painted
from stored_references import StoredReference

from lookdev.asset import Instance, load_asset, make_asset
from lookdev.asset.builtin import make_sphere
from lookdev.material import Layer, Look
from lookdev.scene import Film, Pose, Scene

pytestmark = pytest.mark.mitsuba

REFLECTING = ("diffuse", "cloth", "coated", "brushed", "polished", "painted", "chrome")
TRANSMITTING = ("leaf", "frosted", "tilted", "lacquered", "mixed")
SMOOTH = {
    "polished": LOOKS["polished"],
    "chrome": LOOKS["chrome"],
    **{model: (Layer("Smooth", model, {}),) for model in ("mirror", "glass")},
}
ROUGH = {name: LOOKS[name] for name in (*REFLECTING, *TRANSMITTING) if name not in SMOOTH}
# In this pose the sun of `sunset` is behind the asset.
BACKLIT = Pose(30.0, 126.0)


@pytest.mark.both_pythons
@pytest.mark.parametrize("light", quick_among([(light,) for light in ("city", "sunset", "white")], [("city",)]))
def test_looks_side_by_side_agree(light: str, render_seeds: RenderSeeds, light_of, stored_reference) -> None:
    """The comparison includes the light between them."""
    scene = looks_side_by_side(ROUGH, make_sphere(64, 32), light_of(light), (70, 28))
    pose = Pose(0.0, BACKLIT.lighting)
    frames = render_seeds(scene, pose, 8, samples=64, bounces=2)
    options = {"count": 400, "bounces": 2, "samples": 64}
    assert_parts_agree(f"rough looks {light}", frames, scene, pose, 64, stored_reference, **options)


def test_smooth_looks_agree(render_seeds: RenderSeeds, light_of, stored_reference: StoredReference) -> None:
    scene = looks_side_by_side(SMOOTH, load_asset(builtin="suzanne"), light_of("slopes"), (80, 24))
    frames = render_seeds(scene, Pose(0.0, 75.0), 8, samples=64, bounces=3)
    options = {"count": 240, "bounces": 3, "samples": 64}
    assert_parts_agree("smooth looks", frames, scene, Pose(0.0, 75.0), 64, stored_reference, **options)


@pytest.mark.proof
@pytest.mark.parametrize(("asset", "name"), list(product(SHAPES, TRANSMITTING)))
def test_backlit_shapes_agree(asset: str, name: str, render_seeds: RenderSeeds, light_of) -> None:
    light = light_of("sunset")
    frames = render_seeds(scene_with_look(asset, LOOKS[name], light, size=48), BACKLIT, 8, samples=64, bounces=3)
    assert_agreement(frames, LOOKS[name], asset, light, BACKLIT, bounces=3 if asset == "sphere" else 0)


def test_parts_of_several_looks_agree(render_seeds: RenderSeeds, light_of, stored_reference, tmp_path: Path) -> None:
    """The scene is a card that can be seen through, and a textured ball behind it."""
    card, ball = load_asset(builtin="plane"), load_asset(builtin="sphere")
    upright = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, -1.3], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    slots = tuple(replace(slot, path=f"/{n}") for n, slot in enumerate((*card.slots, *ball.slots)))
    meshes = (*card.meshes, *(replace(mesh, face_slots=mesh.face_slots + len(card.slots)) for mesh in ball.meshes))
    asset = make_asset("parts", meshes, [Instance(0, upright), Instance(1, np.eye(4))], slots)
    net = Layer("Net", "pixar", {"surfaceColor": (0.6, 0.5, 0.4), "roughness": 0.5, "presence": 0.4})
    looks = {"/0": Look("net", (net,)), "/1": Look("painted", painted(tmp_path))}
    camera = orbit_camera(asset.center, asset.radius)
    scene = Scene(asset, looks, (light_of("slopes"),), camera, Film((40, 40)))
    frames = render_seeds(scene, POSE, 6, samples=64, bounces=3)
    options = {"count": 120, "bounces": 3, "samples": 256}
    assert_scene_agreement("card before a ball", frames, scene, 64, stored_reference, **options)


def test_frames_are_the_same_in_any_order_and_after_other_scenes(render_seeds: RenderSeeds, light_of) -> None:
    def halves(name: str, light: str, seeds: int = 1) -> list[np.ndarray]:
        frames = render_seeds(
            scene_with_look("suzanne", LOOKS[name], light_of(light)), POSE, seeds, samples=8, bounces=1
        )
        return [np.stack([frame.a, frame.b]) for frame in frames]

    first, other = halves("coated", "city", 2)
    halves("leaf", "studio")
    (again,) = halves("coated", "city")
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_denoised_frames_are_no_worse(render_seeds: RenderSeeds, light_of) -> None:
    scene = scene_with_look("suzanne", LOOKS["coated"], light_of("city"), size=64)
    (frame,) = render_seeds(scene, POSE, 1, samples=16, denoise="measured")
    assert frame.raw is not None
    assert frame.raw_relmse is not None
    assert frame.relmse < frame.raw_relmse


def test_a_target_is_reached(render_seeds: RenderSeeds, light_of) -> None:
    (frame,) = render_seeds(
        scene_with_look("suzanne", LOOKS["coated"], light_of("city")), POSE, 1, samples=4096, error=2e-3
    )
    assert frame.relmse <= 2e-3
    assert frame.samples < 4096
