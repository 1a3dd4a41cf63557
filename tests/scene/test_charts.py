"""Reference props: published colours, their positions in the frame, and cameras that leave space for them."""

import math
import re
from itertools import pairwise
from typing import get_args

import numpy as np
import pytest

from lookdev.asset import load_asset
from lookdev.build.frame import job_cameras
from lookdev.errors import AssetError
from lookdev.job import parse_job
from lookdev.material import Layer, Look
from lookdev.reference.mesh import MeshScene
from lookdev.scene import Camera, Lens, Pose, camera_rays, frame_camera
from lookdev.scene.charts.colorchecker import PATCHES, patch_colors
from lookdev.scene.charts.props import FrameSide, Strip, asset_of_props, crop_camera, props_camera

# colour-science 0.4.7, "ColorChecker24 - After November 2014", by its own xyY, Bradford and matrix of sRGB, whose
# rounded primaries leave 2e-4.
ORACLE = {
    "dark skin": (0.173683, 0.078793, 0.052856),
    "foliage": (0.105744, 0.150754, 0.050837),
    "orange": (0.745903, 0.202143, 0.029868),
    "blue": (0.020956, 0.047534, 0.284129),
    "cyan": (0.0, 0.233662, 0.377190),
    "white 9.5": (0.879529, 0.885028, 0.834247),
    "neutral 5": (0.190094, 0.190866, 0.189814),
    "black 2": (0.031354, 0.031496, 0.032323),
}


def test_patches_are_those_of_another_implementation() -> None:
    ours = dict(zip(PATCHES, patch_colors(), strict=True))
    for name, expected in ORACLE.items():
        np.testing.assert_allclose(ours[name], expected, atol=2e-4, err_msg=name)
    assert patch_colors().shape == (24, 3)


@pytest.mark.parametrize("side", get_args(FrameSide))
@pytest.mark.parametrize("resolution", [(512, 512), (640, 360), (300, 500)])
def test_props_are_in_their_strip_and_apart(side: str, resolution: tuple[int, int]) -> None:
    strip = Strip(side, 0.12, resolution)
    outer = strip.box
    for box in strip.props:
        assert outer.left <= box.left <= outer.left + outer.width - box.width + 1e-9
        assert outer.top <= box.top <= outer.top + outer.height - box.height + 1e-9
    for a, b in pairwise(strip.props):
        apart = (b.left - a.left - a.width, b.top - a.top - a.height)[strip.is_vertical]
        assert apart > 0.0
    assert len(strip.measured_boxes) == 25
    chart = strip.props[2]
    assert chart.width / 6 == pytest.approx(chart.height / 4)


@pytest.mark.parametrize("side", get_args(FrameSide))
def test_a_strip_that_is_too_thick_names_the_greatest_that_fits(side: str) -> None:
    resolution = (200, 300) if side in ("left", "right") else (300, 200)
    reason, hint = Strip(side, 0.9, resolution).fit_fault()
    assert f"along the {side} edge, the frame has 300" in reason
    most = float(re.fullmatch(r"size = ([\d.]+) at most, or another place, would be right", hint)[1])
    for size, fits in ((most, True), (most + 0.002, False)):
        strip = Strip(side, size, resolution)
        chrome, _, chart = strip.props
        assert (strip.fit_fault() == ("", "")) == fits
        assert ((chrome.top if strip.is_vertical else chrome.left) >= 0.0) == fits
        assert ((chart.top + chart.height if strip.is_vertical else chart.left + chart.width) <= 300.0) == fits


def test_a_chart_has_four_rows_of_six_patches_of_one_size() -> None:
    seen = props_camera(frame_camera((0.3, -0.2, 0.5), 1.4, (320, 240)), (0.0, 0.0, 0.5))
    (mesh,) = asset_of_props(Strip("bottom", 0.2, (320, 240)), seen, ["chart"]).meshes
    faces = mesh.points[mesh.corner_points].reshape(9, 13, 4, 3)  # patches and borders, from the lower left
    areas = np.linalg.norm(np.cross(faces[..., 1, :] - faces[..., 0, :], faces[..., 3, :] - faces[..., 0, :]), axis=-1)
    patches = (slice(1, None, 2), slice(1, None, 2))
    np.testing.assert_allclose(areas[patches] / areas.sum(), 0.76**2 / 24, rtol=1e-4)
    colors = mesh.primvars["reflectance"].reshape(9, 13, 4, 3)[patches]
    np.testing.assert_allclose(colors[::-1], np.tile(patch_colors().reshape(4, 6, 1, 3), (1, 1, 4, 1)), rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=-1), 1.0, rtol=1e-6)


@pytest.mark.parametrize(
    "camera",
    [
        frame_camera((0.3, -0.2, 0.5), 1.4, (320, 240)),
        Camera(60.0, -15.0, (1.0, 2.0, 3.0), 4.0, azimuth=70.0, roll=25.0, axis=(0.8, 2.3), shift=(0.1, -0.2)),
        Camera(30.0, 10.0, (0.0, 0.0, 0.0), 4.0, lens=Lens(0.1, 4.0)),
    ],
)
def test_rays_through_a_prop_meet_it(camera: Camera) -> None:
    strip, pose = Strip("right", 0.3, (320, 240)), Pose(0.0, 40.0)
    seen = props_camera(camera, (*camera.pivot, 0.7))
    assert seen.pivot == camera.pivot  # lights turn about it
    assert seen.lens is None
    np.testing.assert_allclose(seen.frame, camera.frame, atol=1e-12)
    # They are as far as the asset's middle, in the middle of the frame, and a pixel there is as large.
    right, up, depth = camera.frame @ (np.array(seen.target) - camera.position) * (1.0, 1.0, -1.0)
    assert depth == pytest.approx((camera.position - (*camera.pivot, 0.7)) @ camera.frame[2])
    np.testing.assert_allclose(np.array([right, up]) / (2.0 * camera.half_width * depth), camera.shift, atol=1e-8)
    assert seen.half_width * seen.distance == pytest.approx(camera.half_width * depth)
    grey = Look("grey", (Layer("a", "lambert"),))
    for name, box in zip(("chrome", "grey", "chart"), strip.props, strict=True):
        scene = MeshScene(asset_of_props(strip, seen, [name]), [grey])
        u = (np.arange(48) + 0.5) / 48

        def hits(columns, box=box, scene=scene, u=u):
            x, y = np.meshgrid(columns, box.top + u * box.height)
            return scene.intersect(*camera_rays(seen, pose, strip.resolution, x.ravel(), y.ravel()))[0]

        # A ball fills pi / 4 of its box; the long lens brings its silhouette nearer by 1e-4.
        assert hits(box.left + u * box.width).mean() == pytest.approx(1.0 if name == "chart" else math.pi / 4, abs=0.01)
        assert not hits(box.left - 2 + u * 1.5).any()


def test_a_crop_has_the_rays_of_its_part_of_the_frame() -> None:
    camera = Camera(40.0, 12.0, (0.0, 1.0, 0.0), 5.0, azimuth=20.0, roll=5.0)
    box = Strip("bottom", 0.3, (300, 200)).measured_boxes["orange"]
    crop = crop_camera(camera, (300, 200), box)
    u, v = np.array([0.1, 0.5, 0.9]), np.array([0.2, 0.6, 0.7])
    pose = Pose(33.0, 0.0)
    _, inner = camera_rays(crop, pose, (1, 1), u, v)
    _, outer = camera_rays(camera, pose, (300, 200), box.left + u * box.width, box.top + v * box.height)
    np.testing.assert_allclose(inner, outer, atol=1e-12)


def test_an_asset_behind_the_camera_leaves_no_place() -> None:
    with pytest.raises(AssetError, match="behind the camera"):
        props_camera(Camera(40.0, 0.0, (0.0, 10.0, 0.0), 1.0, axis=(0.0, 0.0)), (0.0, 0.0, 0.0))


# The fill of a frame, and whether there is space for a strip beside the asset.
FRAMED = {"fill = 0.7": True, "fill = 1.0": False, "margin = 1.05": False, "": True}


@pytest.mark.parametrize("side", get_args(FrameSide))
@pytest.mark.parametrize("framed", FRAMED)
@pytest.mark.parametrize("builtin", ["suzanne", "plane"])
def test_no_asset_reaches_into_the_strip(tmp_path, side: str, framed: str, builtin: str) -> None:  # type: ignore[no-untyped-def]
    (tmp_path / "gold.usda").touch()
    text = f"""
    output = "out"
    asset = {{ builtin = "{builtin}" }}
    look = [{{ name = "gold", material = "gold.usda" }}]
    ibl = [{{ name = "white", builtin = "white" }}]
    turntable = [{{ kind = "element", frames = 8 }}]
    camera = {{ {framed} }}
    render = {{ resolution = [320, 240] }}
    """
    plain = parse_job(text, tmp_path / "job.toml")
    job = parse_job(f'{text}\ncharts = {{ place = "{side}", size = 0.13 }}', tmp_path / "job.toml")
    asset = load_asset(builtin=builtin)
    camera = job_cameras(job, {"gold": asset})[0]["gold"]
    points = asset.meshes[0].points.astype(np.float64)
    box = job.charts.strip((320, 240)).box
    for angle in range(0, 360, 15):
        seen = camera.orbit(-angle)
        right, up, back = ((points - seen.position) @ seen.frame.T).T
        x = 160 * ((right / -back) / camera.half_width + 1 - 2 * camera.shift[0])
        y = 120 - 160 * ((up / -back) / camera.half_width - 2 * camera.shift[1])
        reach = 1e-4  # pixels: places of cameras are rounded
        inside = (x > box.left + reach) & (x < box.left + box.width - reach)
        inside &= (y > box.top + reach) & (y < box.top + box.height - reach)
        assert not inside.any()
        assert -reach < x.min() <= x.max() < 320 + reach
        assert -reach < y.min() <= y.max() < 240 + reach
    if FRAMED[framed]:  # the frames are those of a job without charts
        assert camera == job_cameras(plain, {"gold": asset})[0]["gold"]
