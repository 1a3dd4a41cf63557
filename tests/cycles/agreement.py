"""What it means that frames of Cycles agree with the float64 reference: within the noise that they themselves claim.

Frames of different seeds are independent halves of every pixel, whose spread is their noise. Student's t of each pixel
against the reference must then be distributed as noise alone makes it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from conftest import POSE, orbit_camera
from numpy.typing import NDArray
from scipy import stats
from scipy.ndimage import binary_erosion

from lookdev.asset import Asset
from lookdev.brdf import Bsdf, StackLayer, complete_parameters, stack_bsdf
from lookdev.checks.finding import Finding
from lookdev.checks.images import check_frame, choose_pixels
from lookdev.light import Dome
from lookdev.material import Layer, Look
from lookdev.metrics import EPSILON
from lookdev.reference.render import Estimate, frame_pixels, shape_pixels
from lookdev.reference.shapes import Shape
from lookdev.render.worker import Rendered
from lookdev.scene import Pose


def constant_bsdf(layers: Sequence[Layer]) -> Bsdf:
    """Return the BSDF of layers whose inputs are constants, on an asset whose UVs are not mirrored."""
    return stack_bsdf(
        [
            StackLayer(layer.model, complete_parameters(layer.model, layer.inputs), layer.mask, layer.mode)
            for layer in layers
        ]
    )


def _reference(
    frame: Rendered,
    layers: Sequence[Layer],
    shape: Shape,
    radius: float,
    light: Dome,
    pose: Pose,
    chosen: NDArray[np.int64],
    **options: int,
) -> Estimate:
    """Estimate pixels (P, 2), row and column, of a square frame of a shape about the origin."""
    size = frame.alpha.shape[0]
    camera = orbit_camera((0.0, 0.0, 0.0), radius)
    bsdf = constant_bsdf(layers)
    return shape_pixels(bsdf, shape, light, camera, pose, (size, size), chosen[:, ::-1], **options)


def assert_agreement(
    frames: Sequence[Rendered],
    layers: Sequence[Layer],
    shape: Shape,
    radius: float,
    light: Dome,
    pose: Pose,
    *,
    bounces: int = 0,
    scrambles: int = 4,
    pixels: int = 300,
) -> None:
    """Compare `pixels` random pixels of square frames of a shape about the origin with the reference."""
    covered = np.argwhere(frames[0].alpha > 0.0)
    chosen = np.random.default_rng(1).permutation(covered)[:pixels]
    reference = _reference(frames[0], layers, shape, radius, light, pose, chosen, bounces=bounces, scrambles=scrambles)
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
    # The usual number of pixels beyond 5 %, within four sigma of a binomial.
    beyond = (np.abs(t) > stats.t.ppf(0.975, freedom)).mean()
    assert beyond < 0.05 + 4.0 * np.sqrt(0.05 * 0.95 / len(chosen))

    # What the halves say of a frame's error, over these pixels, is what it is.
    a, b = halves[0::2], halves[1::2]
    scale = reference.value**2 + EPSILON
    true, claimed = ((((a + b) / 2.0 - reference.value) ** 2) / scale).mean(), (((a - b) / 2.0) ** 2 / scale).mean()
    assert 0.5 < claimed / true < 2.0


def check_mesh(
    frames: Sequence[Rendered],
    asset: Asset,
    layers: Sequence[Layer],
    light: Dome,
    *,
    samples: int,
    bounces: int,
    pixels: int = 80,
) -> Finding:
    """Compare random pixels of square frames at `POSE`, `samples` of each, with the reference."""
    alpha = frames[0].alpha
    chosen = choose_pixels(alpha, pixels, seed=1)
    reference = frame_pixels(
        asset,
        [Look("look", tuple(layers))] * len(asset.slots),
        light,
        orbit_camera(asset.center, asset.radius),
        POSE,
        (alpha.shape[1], alpha.shape[0]),
        chosen,
        bounces=bounces,
    )
    halves = np.stack([half for frame in frames for half in (frame.a, frame.b)])
    return check_frame(asset.name, halves, alpha, len(frames) * samples, chosen, reference)


def relative_difference(
    frames: Sequence[Rendered], layers: Sequence[Layer], shape: Shape, radius: float, light: Dome, pose: Pose
) -> NDArray[np.float64]:
    """Return how far the mean of frames is off the reference, of it, at 300 pixels that the shape fills."""
    filled = np.argwhere(frames[0].alpha >= 1.0)
    chosen = np.random.default_rng(1).permutation(filled)[:300]
    reference = _reference(frames[0], layers, shape, radius, light, pose, chosen, samples=4096)
    mean = np.mean([(frame.a.astype(np.float64) + frame.b) / 2.0 for frame in frames], axis=0)[tuple(chosen.T)]
    return np.asarray(mean / reference.value - 1.0)
