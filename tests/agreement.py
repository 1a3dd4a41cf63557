"""Agreement of Cycles' frames with the float64 reference, within the noise that the frames themselves estimate.

Frames of different seeds are independent halves of every pixel, whose spread is their noise. Student's t of each pixel
against the reference then has the distribution of noise alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from frames import POSE, orbit_camera
from numpy.typing import NDArray
from scipy import stats
from scipy.ndimage import binary_erosion
from shapes import Plane, Sphere

from lookdev.asset import Asset
from lookdev.brdf import StackLayer, complete_parameters, stack_bsdf
from lookdev.checks.finding import Finding
from lookdev.checks.images import check_frame, choose_pixels
from lookdev.light import Dome
from lookdev.material import Layer, Look
from lookdev.metrics import EPSILON
from lookdev.reference.mesh import MeshScene
from lookdev.reference.render import Estimate, frame_pixels
from lookdev.render.results import Rendered
from lookdev.scene import Pose

Ints = NDArray[np.int64]

# Shapes about the origin, and the radii of their bounding spheres.
SHAPES = {"plane": (Plane(), 2.0**0.5), "sphere": (Sphere(), 1.0)}


def _reference(
    frame: Rendered, layers: Sequence[Layer], name: str, light: Dome, pose: Pose, chosen: Ints, **options: int
) -> Estimate:
    """Estimate pixels (P, 2), row and column, of a square frame of a shape whose layers have constant inputs."""
    shape, radius = SHAPES[name]
    stack = [
        StackLayer(each.model, complete_parameters(each.model, each.inputs), each.mask, each.mode) for each in layers
    ]
    camera, scene = orbit_camera((0.0, 0.0, 0.0), radius), replace(shape, bsdf=stack_bsdf(stack))
    return frame_pixels(scene, [light], camera, pose, frame.alpha.shape, chosen[:, ::-1], **options)


def assert_agreement(
    frames: Sequence[Rendered],
    layers: Sequence[Layer],
    name: str,
    light: Dome,
    pose: Pose = POSE,
    *,
    bounces: int = 0,
    scrambles: int = 4,
) -> None:
    """Compare random pixels of square frames of a shape of `SHAPES` with the reference."""
    covered = np.argwhere(frames[0].alpha > 0.0)
    chosen = np.random.default_rng(1).permutation(covered)[:300]
    options = {"bounces": bounces, "samples": 1024, "scrambles": scrambles}
    reference = _reference(frames[0], layers, name, light, pose, chosen, **options)
    halves = np.stack([half[tuple(chosen.T)] for frame in frames for half in (frame.a, frame.b)]).astype(np.float64)
    # Channels share their samples: one number a pixel.
    values, expected = halves.mean(axis=-1), reference.value.mean(axis=-1)
    error = np.sqrt(values.var(axis=0, ddof=1) / len(values) + reference.error.mean(axis=-1) ** 2)
    t = (values.mean(axis=0) - expected) / np.maximum(error, 1e-6)
    freedom = len(values) - 1

    # No bias: pixels are scrambled independently, so the mean of their t is normal. Four sigma.
    spread = np.sqrt(freedom / (freedom - 2) / len(chosen))
    assert abs(t.mean()) < 4.0 * spread
    # No pixel is off by more than noise makes it, Sidak-corrected to 1e-3 over all pixels; coverage of a silhouette is
    # a binary variable, whose tails a t-distribution underestimates: these get a quarter more.
    limit = stats.t.ppf(1.0 - (1.0 - (1.0 - 1e-3) ** (1.0 / len(chosen))) / 2.0, freedom)
    interior = binary_erosion(frames[0].alpha > 0.0, np.ones((3, 3)))[tuple(chosen.T)]
    assert np.abs(t[interior]).max() < limit
    assert np.abs(t).max() < 1.25 * limit
    # The expected number of pixels beyond 5 %, within four sigma of a binomial.
    beyond = (np.abs(t) > stats.t.ppf(0.975, freedom)).mean()
    assert beyond < 0.05 + 4.0 * np.sqrt(0.05 * 0.95 / len(chosen))

    # The halves estimate a frame's error over these pixels.
    a, b = halves[0::2], halves[1::2]
    scale = reference.value**2 + EPSILON
    true, claimed = ((((a + b) / 2.0 - reference.value) ** 2) / scale).mean(), (((a - b) / 2.0) ** 2 / scale).mean()
    assert 0.5 < claimed / true < 2.0


def assert_mesh_agreement(
    frames: Sequence[Rendered], asset: Asset, layers: Sequence[Layer], light: Dome, *, samples: int, bounces: int
) -> Finding:
    """Compare random pixels of square frames at `POSE`, `samples` of each, with the reference."""
    alpha = frames[0].alpha
    chosen = choose_pixels(alpha, 80, seed=1)
    halves = np.stack([half for frame in frames for half in (frame.a, frame.b)])
    scene = MeshScene(asset, [Look("look", tuple(layers))] * len(asset.slots))
    camera = orbit_camera(asset.center, asset.radius)

    def agreement(bounces: int) -> Finding:
        reference = frame_pixels(scene, [light], camera, POSE, alpha.shape, chosen, bounces=bounces)
        return check_frame(asset.name, halves, alpha, len(frames) * samples, chosen, reference)

    found = agreement(bounces)
    assert found.passed, "\n".join((found.summary, *found.details))
    # Without its indirect light the frame is another.
    assert not agreement(0).passed
    return found


def relative_difference(frames: Sequence[Rendered], layers: Sequence[Layer], light: Dome) -> NDArray[np.float64]:
    """Return the relative difference of the mean of frames of a sphere to the reference, at 300 covered pixels."""
    filled = np.argwhere(frames[0].alpha >= 1.0)
    chosen = np.random.default_rng(1).permutation(filled)[:300]
    reference = _reference(frames[0], layers, "sphere", light, POSE, chosen, samples=4096, scrambles=4)
    mean = np.mean([(frame.a.astype(np.float64) + frame.b) / 2.0 for frame in frames], axis=0)[tuple(chosen.T)]
    return np.asarray(mean / reference.value - 1.0)
