"""Asserts that rendered frames agree with the float64 reference, within the noise that the frames themselves estimate.

A frame is two independent halves. The halves of several frames with different seeds are independent values of each
pixel, and their spread gives the noise. If a pixel agrees with the reference, its difference over its error follows
Student's t.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from failed_pictures import comparison
from frames import POSE, orbit_camera
from scipy import stats
from scipy.ndimage import binary_erosion
from shapes import Plane, Sphere
from stored_references import Arrays, StoredReference

from lookdev.arrays import Floats, Ints
from lookdev.brdf import StackLayer, complete_parameters, stack_bsdf
from lookdev.checks.finding import CheckFinding
from lookdev.checks.images import check_frame, choose_pixels
from lookdev.light import Dome, Light
from lookdev.material import Layer
from lookdev.metrics import EPSILON
from lookdev.reference.mesh import MeshScene
from lookdev.reference.render import Estimate, ReferenceScene, frame_pixels
from lookdev.rendering.results import WorkerFrame
from lookdev.scene import Camera, Pose, Scene, camera_rays

# Shapes about the origin, and the radii of their bounding spheres.
SHAPES = {"plane": (Plane(), 2.0**0.5), "sphere": (Sphere(), 1.0)}


def scene_pixels(scene: Scene, pose: Pose, count: int, **options: int) -> Arrays:
    """Compute random pixels of a scene of meshes by the reference; pixels beside silhouettes are included.

    The returned arrays are `pixels` (P, 2), column and row, and the fields of `Estimate` by name. `options` are
    arguments of `frame_pixels`.
    """
    meshes = MeshScene(scene.asset, scene.looks, scene.slot_lights, scene.slot_groups)
    camera, size = scene.camera, scene.film.resolution
    pixels = choose_pixels(coverage(meshes, camera, pose, size), count, seed=1)
    return _arrays(pixels, frame_pixels(meshes, scene.lights, camera, pose, size, pixels, **options))


def shape_pixels(
    shape: str, layers: Sequence[Layer], light: Light, pose: Pose, side: int, count: int, least: float, **options: int
) -> Arrays:
    """Compute random pixels of a square frame of one of `SHAPES` by the reference; `layers` have constant inputs.

    Only pixels are chosen of which the shape covers a share of more than `least`. The returned arrays are those of
    `scene_pixels`.
    """
    surface, radius = SHAPES[shape]
    stack = [
        StackLayer(layer.model, complete_parameters(layer.model, layer.inputs), layer.mask, layer.mode)
        for layer in layers
    ]
    camera, scene = orbit_camera((0.0, 0.0, 0.0), radius), replace(surface, bsdf=stack_bsdf(stack))
    covered = np.argwhere(coverage(scene, camera, pose, (side, side)) > least)
    pixels = np.random.default_rng(1).permutation(covered)[:count, ::-1]
    return _arrays(pixels, frame_pixels(scene, [light], camera, pose, (side, side), pixels, **options))


def coverage(scene: ReferenceScene, camera: Camera, pose: Pose, size: tuple[int, int]) -> Floats:
    """Return the share (H, W) of 8 x 8 rays of each pixel that hit a scene."""
    (width, height), rays = size, 8
    x, y = ((np.arange(rays * pixels) + 0.5) / rays for pixels in size)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    lens = np.random.default_rng(0).random(points.shape) if camera.lens else None
    origin, ray = camera_rays(camera, pose, size, *points.T, lens)
    hit, _ = scene.intersect(origin, ray)
    return np.asarray(hit.reshape(height, rays, width, rays).mean(axis=(1, 3)))


def _arrays(pixels: Ints, estimate: Estimate) -> Arrays:
    """Return pixels and an estimate of them as arrays by name."""
    samples, scrambles = np.array(estimate.samples), np.array(estimate.scrambles)
    return {
        "pixels": pixels,
        "value": estimate.value,
        "error": estimate.error,
        "samples": samples,
        "scrambles": scrambles,
    }


def estimate_of(arrays: Arrays) -> Estimate:
    """Return the estimate in the arrays of `scene_pixels`."""
    return Estimate(arrays["value"], arrays["error"], int(arrays["samples"]), int(arrays["scrambles"]))


def compute_live(name: str, compute: Callable[..., Arrays], **inputs: Any) -> Arrays:
    """Compute a reference without storing it. The fixture `stored_reference` does this in tests of the tier `proof`."""
    return compute(**inputs)


def assert_agreement(
    frames: Sequence[WorkerFrame],
    layers: Sequence[Layer],
    name: str,
    light: Dome,
    pose: Pose = POSE,
    *,
    bounces: int = 0,
    scrambles: int = 4,
    stored: StoredReference = compute_live,
) -> None:
    """Assert that random pixels of square frames of one of `SHAPES` agree with the reference.

    `frames` are renders with different seeds, and `name` is the name of the shape. `stored` returns the reference.
    """
    options = {"bounces": bounces, "samples": 1024, "scrambles": scrambles}
    case = {"shape": name, "layers": layers, "light": light, "pose": pose, "side": len(frames[0].alpha)}
    arrays = stored(f"{name} {layers[0].name}", shape_pixels, **case, count=300, least=0.0, **options)
    reference, pixels = estimate_of(arrays), arrays["pixels"][:, ::-1]
    with comparison(_mean(frames), arrays["value"], arrays["pixels"]):
        _assert_alike(frames, reference, pixels)


def _assert_alike(frames: Sequence[WorkerFrame], reference: Estimate, pixels: Ints) -> None:
    """Assert that frames agree with the reference at `pixels` (P, 2), which are row and column, by several tests."""
    halves = np.stack([half[tuple(pixels.T)] for frame in frames for half in (frame.a, frame.b)]).astype(np.float64)
    # The channels of a pixel share their samples, so their mean is compared: one number for each pixel.
    values, expected = halves.mean(axis=-1), reference.value.mean(axis=-1)
    error = np.sqrt(values.var(axis=0, ddof=1) / len(values) + reference.error.mean(axis=-1) ** 2)
    t = (values.mean(axis=0) - expected) / np.maximum(error, 1e-6)
    freedom = len(values) - 1

    # There is no bias: the mean of t is 0 within four standard errors. Pixels are scrambled independently, so the mean
    # is normal.
    spread = np.sqrt(freedom / (freedom - 2) / len(pixels))
    assert abs(t.mean()) < 4.0 * spread
    # No pixel differs by more than noise. By Sidak's correction, noise alone fails this with a probability of 1e-3 for
    # all pixels together. At a silhouette, coverage is a binary variable, whose tails Student's t underestimates: the
    # limit is a quarter larger there.
    limit = stats.t.ppf(1.0 - (1.0 - (1.0 - 1e-3) ** (1.0 / len(pixels))) / 2.0, freedom)
    interior = binary_erosion(frames[0].alpha > 0.0, np.ones((3, 3)))[tuple(pixels.T)]
    assert np.abs(t[interior]).max() < limit
    assert np.abs(t).max() < 1.25 * limit
    # Not more pixels than expected are beyond the quantiles of 5 %, within four standard errors of a binomial.
    beyond = (np.abs(t) > stats.t.ppf(0.975, freedom)).mean()
    assert beyond < 0.05 + 4.0 * np.sqrt(0.05 * 0.95 / len(pixels))

    # The error that the halves of a frame estimate is the true error over these pixels, within a factor of 2.
    a, b = halves[0::2], halves[1::2]
    scale = reference.value**2 + EPSILON
    true, claimed = ((((a + b) / 2.0 - reference.value) ** 2) / scale).mean(), (((a - b) / 2.0) ** 2 / scale).mean()
    assert 0.5 < claimed / true < 2.0


def check_scene(
    name: str,
    frames: Sequence[WorkerFrame],
    scene: Scene,
    per_frame: int,
    stored: StoredReference = compute_live,
    **options: Any,
) -> CheckFinding:
    """Compare frames of a scene with the reference by `check_frame`, and return its finding.

    Each frame has `per_frame` samples of each pixel. `options` are arguments of `scene_pixels`.
    """
    return _check_pixels(name, frames, per_frame, _scene_reference(name, scene, stored, options))


def _scene_reference(name: str, scene: Scene, stored: StoredReference, options: dict[str, Any]) -> Arrays:
    return stored(name, scene_pixels, **{"scene": scene, "pose": POSE, "count": 100} | options)


def _check_pixels(name: str, frames: Sequence[WorkerFrame], per_frame: int, reference: Arrays) -> CheckFinding:
    halves = np.stack([half for frame in frames for half in (frame.a, frame.b)])
    count = len(frames) * per_frame
    return check_frame(name, halves, frames[0].alpha, count, reference["pixels"], estimate_of(reference))


def assert_scene_agreement(
    name: str,
    frames: Sequence[WorkerFrame],
    scene: Scene,
    per_frame: int,
    stored: StoredReference = compute_live,
    **options: Any,
) -> CheckFinding:
    """Assert that frames of a scene pass `check_scene`, and return its finding."""
    reference = _scene_reference(name, scene, stored, options)
    finding = _check_pixels(name, frames, per_frame, reference)
    if not finding.passed:
        with comparison(_mean(frames), reference["value"], reference["pixels"]):
            raise AssertionError("\n".join((finding.summary, *finding.details)))
    return finding


def relative_difference(
    frames: Sequence[WorkerFrame], layers: Sequence[Layer], light: Dome, stored: StoredReference = compute_live
) -> Floats:
    """Return the relative difference between the mean of frames of a sphere and the reference, (300, 3).

    The 300 random pixels are completely covered by the sphere.
    """
    case = {"shape": "sphere", "layers": layers, "light": light, "pose": POSE, "side": len(frames[0].alpha)}
    name, options = f"covered {layers[0].name}", {"samples": 4096, "scrambles": 4}
    arrays = stored(name, shape_pixels, **case, count=300, least=1.0 - 1e-9, **options)
    columns, rows = arrays["pixels"].T
    return np.asarray(_mean(frames)[rows, columns] / arrays["value"] - 1.0)


def _mean(frames: Sequence[WorkerFrame]) -> Floats:
    """Return the mean picture (H, W, 3) of frames."""
    return np.asarray(np.mean([(frame.a.astype(np.float64) + frame.b) / 2.0 for frame in frames], axis=0))
