"""The ground of a job and its position; reference props that are not measured, or hide the asset."""

from pathlib import Path

import numpy as np
import pytest
from usd_text import job_toml

from lookdev.asset import load_asset
from lookdev.build.frame import ground_under, overlap_notes
from lookdev.build.scenes import build_scenes
from lookdev.errors import AssetError, FaultsError
from lookdev.job import parse_job
from lookdev.job.surroundings import JobCharts, JobGround
from lookdev.scene import Camera
from lookdev.scene.charts.props import Strip
from lookdev.scene.ground import GREY_LOOK, GROUND_PATH, add_ground

MATERIALS = Path(__file__).parents[2] / "materials"
LOOK = f"metal = {MATERIALS}/classic/mirror.usda"
JOB = job_toml(LOOK, asset='{ builtin = "suzanne" }', rig='[{ name = "fitted", builtin = "three_point" }]')


def test_a_camera_below_the_ground_is_a_fault(tmp_path: Path) -> None:
    job = parse_job(f"{JOB}camera.elevation = -30\n[ground]\n", tmp_path / "job.toml")
    with pytest.raises(FaultsError, match="m below the ground, and sees none of the asset; a greater elevation"):
        build_scenes(job)


def test_what_its_material_loses_is_noted(tmp_path: Path) -> None:
    surface = 'uniform token info:id = "UsdPreviewSurface"\ncolor3f inputs:emissiveColor = (1, 0, 0)\n'
    shader = f'token outputs:surface.connect = </M/S.outputs:surface>\ndef Shader "S"\n{{\n{surface}}}\n'
    (tmp_path / "lava.usda").write_text(f'#usda 1.0\n(\n    defaultPrim = "M"\n)\ndef Material "M"\n{{\n{shader}}}\n')
    job = parse_job(f'{JOB}[ground]\nmaterial = "lava.usda"\n', tmp_path / "job.toml")
    assert any("lava.usda: /M/S.inputs:emissiveColor: " in note for note in build_scenes(job).notes)


@pytest.mark.parametrize("kind", ["catcher", "plane"])
def test_the_asset_stands_on_it_and_all_else_is_as_without(tmp_path: Path, kind: str) -> None:
    plain = build_scenes(parse_job(JOB, tmp_path / "job.toml")).scenes
    grounded = build_scenes(parse_job(f'{JOB}[ground]\nkind = "{kind}"\nsize = 5\n', tmp_path / "job.toml")).scenes
    for key, scene in grounded.items():
        assert scene.camera == plain[key].camera
        assert [light.digest for light in scene.lights] == [light.digest for light in plain[key].lights]
        asset, before = scene.asset, plain[key].asset
        assert scene.look_of_slot[GROUND_PATH] is GREY_LOOK
        assert scene.catchers == (frozenset([GROUND_PATH]) if kind == "catcher" else frozenset())
        disc = asset.meshes[-1].points + asset.instances[-1].matrix[:3, 3]
        lowest = before.meshes[0].points[:, 2].min()
        np.testing.assert_allclose(disc[:, 2], lowest, atol=1e-6)
        np.testing.assert_allclose(disc[:, :2].mean(axis=0), scene.camera.pivot, atol=1e-5)
        assert np.ptp(disc[:, 0]) == pytest.approx(10.0 * before.radius, rel=1e-6)
        assert len(asset.instances) == len(before.instances) + 1
        assert not asset.convex


def test_a_ground_of_a_height_and_of_a_revolved_asset() -> None:
    sphere = load_asset(builtin="sphere")
    look_of_part = {"/sphere": GREY_LOOK}
    camera = Camera(40.0, 10.0, (0.0, 0.0, 0.0), 5.0)
    ground_under(JobGround(height=camera.position[2] - 0.1), sphere, None, camera)
    with pytest.raises(AssetError, match=r"the camera is 0\.1 m below the ground"):
        ground_under(JobGround(height=camera.position[2] + 0.1), sphere, None, camera)
    ground = ground_under(JobGround(height=-3.0), sphere, None, camera)
    assert (ground.height, ground.radius) == (-3.0, 10.0 * sphere.radius)
    grounded = add_ground(sphere, look_of_part, ground, (0.0, 0.0))[0]
    assert grounded.revolved
    assert {*map(tuple, grounded.meshes[-1].tangents.tolist())} == {(1.0, 0.0, 0.0)}
    assert not add_ground(sphere, look_of_part, ground, (0.5, 0.0))[0].revolved


def test_patches_of_few_pixels_are_shown_and_not_measured() -> None:
    assert JobCharts().strip((320, 240)).size_note() == ""
    said = JobCharts().strip((128, 128)).size_note()
    assert "2.3 pixels across the middle of a patch are too few; size = 0.156" in said
    assert JobCharts(size=0.156).strip((128, 128)).size_note() == ""


def test_a_camera_of_a_file_is_noted_where_props_hide_the_asset() -> None:
    points = load_asset(builtin="sphere").meshes[0].points.astype(float)
    near, far = (Camera(40.0, 0.0, (0.0, 0.0, 0.0), distance) for distance in (3.0, 8.0))
    arcs, left = [(0.0, 360.0)], Strip("left", 0.12, (320, 320))
    (note,) = overlap_notes(left, near, points, arcs)
    assert "hides a part of the asset at the left edge" in note
    assert list(overlap_notes(left, far, points, arcs)) == []


@pytest.mark.parametrize(("edge", "covered"), [("left", 0.22680), ("bottom", 0.20395)])
def test_props_hide_what_is_at_their_pixels(edge: str, covered: float) -> None:
    """The point is at x / W = (1 + x / (d tan 30)) / 2 - shift, y / H = 1 / 2 - W / H (z / (d tan 30) / 2 - shift)."""
    camera = Camera(60.0, 0.0, (0.0, 0.0, 0.0), 2.0, shift=(0.1, -0.05))
    points = np.array([(-0.4, 0.0, -0.5)])
    for size, hides in ((covered + 0.002, True), (covered - 0.002, False)):
        notes = overlap_notes(Strip(edge, size, (3200, 1800)), camera, points, [(0.0, 0.0)])
        assert bool([*notes]) == hides
