"""The table of the ground: its faults, and where the ground is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lookdev.asset import load_asset
from lookdev.errors import FaultsError, JobError
from lookdev.job import parse_job
from lookdev.job.ground import JobGround
from lookdev.job.scenes import job_scenes
from lookdev.scene import Camera
from lookdev.scene.ground import GREY, PATH, on_ground

MATERIALS = Path(__file__).parents[2] / "materials"
JOB = f"""
output = "out"
asset = {{ builtin = "suzanne" }}
look = [{{ name = "metal", material = "{MATERIALS}/classic/mirror.usda" }}]
ibl = [{{ name = "white", builtin = "white" }}]
rig = [{{ name = "fitted", builtin = "overcast_plus_sun" }}]
turntable = [{{ kind = "element", frames = 1 }}]
"""


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("render.backend = 'nodes'", "ground: backend 'nodes' renders no shadow catcher (backend = \"exact\", or kind"),
        ("render.denoise = 'measured'", "the alpha of a shadow catcher is not denoised"),
        ("render.passes = ['uv', 'direct', 'lobes']", "a shadow catcher has no lobes and no direct"),
        ("ground.kind = 'floor'", "ground.kind: unknown value 'floor'"),
        ("ground.prim = '/A'", "ground.prim: has no meaning without 'material'"),
        ("ground.material = 'none.usda'", "ground.material: no readable file"),
        ("ground.size = 0", "ground.size: "),
    ],
)
def test_faults_are_found_before_anything_is_read(tmp_path: Path, more: str, said: str) -> None:
    with pytest.raises(JobError) as error:
        parse_job(f"{JOB}{more}\n" + ("" if "ground" in more else "[ground]\n"), tmp_path / "job.toml")
    assert said in str(error.value)
    if "render" in more:
        parse_job(f'{JOB}{more}\n[ground]\nkind = "plane"\n', tmp_path / "job.toml")


def test_a_camera_below_the_ground_is_a_fault(tmp_path: Path) -> None:
    job = parse_job(f"{JOB}camera.elevation = -30\n[ground]\n", tmp_path / "job.toml")
    with pytest.raises(FaultsError, match="m below the ground, and sees none of the asset; a greater elevation"):
        job_scenes(job)


@pytest.mark.parametrize("kind", ["catcher", "plane"])
def test_the_asset_stands_on_it_and_all_else_is_as_without(tmp_path: Path, kind: str) -> None:
    plain = job_scenes(parse_job(JOB, tmp_path / "job.toml")).scenes
    shown = job_scenes(parse_job(f'{JOB}[ground]\nkind = "{kind}"\nsize = 5\n', tmp_path / "job.toml")).scenes
    for key, scene in shown.items():
        assert scene.camera == plain[key].camera
        assert [light.digest for light in scene.lights] == [light.digest for light in plain[key].lights]
        asset, before = scene.asset, plain[key].asset
        assert scene.wears[PATH] is GREY
        assert scene.catchers == (frozenset([PATH]) if kind == "catcher" else frozenset())
        disc = asset.meshes[-1].points + asset.instances[-1].matrix[:3, 3]
        lowest = before.meshes[0].points[:, 2].min()
        np.testing.assert_allclose(disc[:, 2], lowest, atol=1e-6)
        np.testing.assert_allclose(disc[:, :2].mean(axis=0), scene.camera.pivot, atol=1e-5)
        assert np.ptp(disc[:, 0]) == pytest.approx(10.0 * before.radius, rel=1e-6)
        assert len(asset.instances) == len(before.instances) + 1
        assert not asset.convex


def test_a_ground_of_a_height_and_of_a_revolved_asset() -> None:
    sphere = load_asset(builtin="sphere")
    wears = {"/sphere": GREY}
    ground = JobGround(height=-3.0).under(sphere, None, Camera(40.0, 10.0, (0.0, 0.0, 0.0), 5.0))
    assert (ground.height, ground.radius) == (-3.0, 10.0 * sphere.radius)
    assert on_ground(sphere, wears, ground, (0.0, 0.0))[0].revolved
    assert not on_ground(sphere, wears, ground, (0.5, 0.0))[0].revolved
