"""Cameras of a job: one for all looks or one for each look, framed by silhouette or sphere, or from a file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from usd_text import METRES, card, job_toml, material, translate

from lookdev.asset import Asset, load_asset
from lookdev.asset.mesh import Instance
from lookdev.asset.silhouette import hull_points
from lookdev.asset.store import make_asset
from lookdev.asset.usd_camera import read_camera
from lookdev.build.frame import element_arcs, job_cameras
from lookdev.build.scenes import build_scenes
from lookdev.errors import FaultsError
from lookdev.job import Job, parse_job
from lookdev.scene import Camera, frame_camera, frame_fill
from lookdev.stage import open_stage

TURNTABLE = '[{ kind = "element", frames = 8 }]'
KEYS = {"asset": '{ usd = "asset.usda" }', "render": "{ resolution = [160, 90] }", "turntable": TURNTABLE}
JOB = job_toml("small = asset.usda, large = asset.usda", **KEYS) + "[camera]\n"
SHOT = """
def Camera "Shot"
{
    float focalLength = 40
    float horizontalAperture = 32
    float verticalAperture = 18
    TRANSLATE
}
""".replace("TRANSLATE", translate(0, 0, 9))
ASSET = METRES + card("Card") + material() + SHOT


def moved(scale: float, x: float = 0.0) -> Asset:
    ball = load_asset(builtin="suzanne")
    matrix = np.diag([scale, scale, scale, 1.0])
    matrix[0, 3] = x
    return make_asset("ball", ball.meshes, [Instance(0, matrix)], ball.slots)


SHOWN = {"small": moved(0.2), "large": moved(1.0, 3.0)}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "asset.usda").write_text(ASSET)
    return tmp_path


def job_of(folder: Path, camera: str = "") -> Job:
    return parse_job(JOB + camera, folder / "job.toml")


def cameras(folder: Path, camera: str = "") -> dict[str, Camera]:
    framed, notes = job_cameras(job_of(folder, camera), SHOWN)
    assert notes == ()
    assert list(framed) == ["small", "large"]
    return framed


def test_all_looks_share_a_camera_that_frames_what_any_shows_or_each_has_its_own(folder: Path) -> None:
    shared = cameras(folder)
    both = np.concatenate([hull_points(asset.meshes, asset.instances) for asset in SHOWN.values()])
    assert shared["small"] == shared["large"] == frame_fill(both, (160, 90))
    separate = cameras(folder, 'framing = "each"\nfill = 0.5\nfov = 20\nelevation = 5')
    for look, asset in SHOWN.items():
        assert separate[look] == frame_fill(
            hull_points(asset.meshes, asset.instances), (160, 90), fov=20.0, elevation=5.0, fill=0.5
        )


def test_a_margin_frames_bounding_spheres(folder: Path) -> None:
    wide = cameras(folder, 'framing = "each"\nmargin = 1.2\nfov = 70\nelevation = 5')
    separate = cameras(folder, 'framing = "each"\nmargin = 1.2')
    for look, asset in SHOWN.items():
        sphere = asset.center, asset.radius
        assert separate[look] == frame_camera(*sphere, (160, 90), margin=1.2)
        assert wide[look] == frame_camera(*sphere, (160, 90), fov=70.0, elevation=5.0, margin=1.2)
    one = cameras(folder, "margin = 1.2")
    assert one["small"] == one["large"]
    points = np.concatenate([hull_points(asset.meshes, asset.instances) for asset in SHOWN.values()])
    assert one["small"].distance > separate["large"].distance
    assert np.linalg.norm(points - one["small"].target, axis=1).max() < one["small"].distance


def test_the_angles_are_those_of_the_turntables(folder: Path) -> None:
    turntables = """[{ kind = "element", frames = 8 }, { kind = "lighting", name = "sun", frames = 4 },
        { kind = "element", name = "part", frames = 5, start = 30, degrees = -90 },
        { kind = "element", name = "still", frames = 1, start = 70 }]"""
    job = parse_job(JOB.replace(TURNTABLE, turntables) + "azimuth = 20", folder / "job.toml")
    assert element_arcs(job) == ((-20.0, 360.0), (-20.0, 0.0), (10.0, -90.0), (50.0, 0.0))


def test_a_camera_of_a_file_is_read(folder: Path) -> None:
    prepared = build_scenes(job_of(folder, 'usd = "/Shot"'))
    (camera,) = {scene.camera for scene in prepared.scenes.values()}
    np.testing.assert_allclose(camera.position, [0.0, 0.0, 9.0], atol=1e-9)
    assert (camera.elevation, camera.half_width, camera.pivot) == (90.0, pytest.approx(0.4), (0.0, 0.0))
    assert prepared.notes == ()
    (folder / "shot.usda").write_text(ASSET.replace("(0, 0, 9)", "(0, 0, 7)").replace("= 18", "= 32"))
    prepared = build_scenes(job_of(folder, 'usd = "/Shot"\nfile = "shot.usda"'))
    (camera,) = {scene.camera for scene in prepared.scenes.values()}
    assert camera.position[2] == pytest.approx(7.0)
    assert "/Shot: its frame is 1 times as wide as high" in prepared.notes[-1]
    with pytest.raises(FaultsError, match=r"asset\.usda: /Shto: there is no such prim \(did you mean '/Shot'\?\)"):
        build_scenes(job_of(folder, 'usd = "/Shto"'))


def test_props_that_hide_what_a_camera_of_a_file_sees_are_noted(folder: Path) -> None:
    """The camera is above the asset: from afar the asset is in the middle of the frame, from close by it fills it."""
    shot = read_camera(open_stage(folder / "asset.usda"), "/Shot")
    job = job_of(folder, 'usd = "/Shot"\n[charts]\nplace = "left"')
    for scale, hides in ((1.0, False), (4.0, True)):
        _, notes = job_cameras(job, {"one": moved(scale)}, shot)
        assert [note.partition(",")[0] for note in notes] == [
            "[charts] hides a part of the asset at the left edge of the frame"
        ] * hides


def test_props_too_small_to_measure_are_noted_and_an_asset_behind_the_camera_is_a_fault(folder: Path) -> None:
    (note,) = build_scenes(job_of(folder, 'usd = "/Shot"\n[charts]')).notes
    assert note.startswith("[charts] is not measured: ")
    (folder / "behind.usda").write_text(ASSET.replace("(0, 0, 9)", "(0, 0, -0.5)"))
    with pytest.raises(FaultsError, match=r"job\.toml: charts: the middle of the asset is behind the camera"):
        build_scenes(job_of(folder, 'usd = "/Shot"\nfile = "behind.usda"\n[charts]'))


def test_equal_assets_share_a_camera(folder: Path) -> None:
    asset = SHOWN["large"]
    framed, _ = job_cameras(job_of(folder, 'framing = "each"'), {"a": asset, "b": replace(asset, name="again")})
    assert framed["a"] is framed["b"]
