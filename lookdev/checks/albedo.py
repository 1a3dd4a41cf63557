"""Directional albedo of a look over the angle of view, computed in three ways.

They are quadrature and importance sampling in NumPy (`lookdev.reference.albedo`), and Cycles, which renders a card with
the look, first under light from its front, then from its back. A look that varies over a surface is evaluated at a few
random points, as the constant look there: the same shader with numbers in place of textures.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from lookdev.arrays import Floats
from lookdev.asset import load_asset
from lookdev.brdf.angles import spherical_direction
from lookdev.brdf.frames import ZENITH
from lookdev.checks.finding import CheckFinding, FindingPlot, PlotCurve
from lookdev.checks.frames import AlterShader, RenderHalves, alter_shaders, keep_shader
from lookdev.checks.samples import case_layer, constant_looks, constant_numbers, layer_tokens
from lookdev.light import Dome, load_environment, make_environment, prepare_light
from lookdev.light.mapping import uv_to_direction
from lookdev.material import Look
from lookdev.material.points import SinglePoint
from lookdev.material.values import look_bsdf, look_layers
from lookdev.reference.albedo import Albedo, integrate_albedo, sample_albedo
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import frame_task
from lookdev.scene import Camera, Pose, Sampling, Scene

FALSE_ALARM_PROBABILITY = 1e-3
"""Probability that noise alone fails a look."""

ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 70.0, 80.0, 85.0)
"""Angles of view, degrees from the normal."""

# Relative and absolute tolerance. Exact backends: float32 rounding, as at points, and the blurred edge of the light at
# the card's horizon. Other backends: the error of their fits.
_EXACT, _FITTED = (2e-4, 2e-5), (1e-2, 1e-3)
_SIDE = 16
_SIZE = (_SIDE, _SIDE)
_SAMPLING = Sampling(samples=64, brdf_samples=4, ibl_samples=0, bounces=0)
_SCRAMBLES, _POINTS = 32, 512
# The narrowest field of view of Blender's cameras: the albedo is nearly constant over it.
_FOV, _DISTANCE = 0.4, 6.0
# Half of the sphere depends on longitude only; a fine edge keeps its light off the other side of the card.
_LIGHT_SIZE = (16384, 2)
_SIDES = ("reflected", "transmitted")
_ESTIMATORS = ("NumPy's samples", "Cycles")
_WORST = 5


@dataclass(frozen=True, eq=False)
class _Curves:
    """The albedo at a sample point by quadrature, sampling and Cycles; value and error have the shape (views, 2, 3)."""

    look: Look
    azimuth: float
    transmits: bool
    quadrature: Albedo
    sampled: Albedo
    cycles: Albedo


def check_albedo(
    look: Look,
    render: RenderHalves,
    *,
    points: int = 3,
    angles: tuple[float, ...] = ANGLES,
    seed: int = 0,
    backend: str = "exact",
    alter: AlterShader = keep_shader,
) -> CheckFinding:
    """Compare the albedo curves of a look: those by sampling and by Cycles with that by quadrature.

    Parameters
    ----------
    look
        The look, whose textures are read.
    render
        Renders it in Cycles.
    points
        The number of random points at which a look that varies over the surface is evaluated. Other looks have a single
        curve.
    angles
        Views, degrees from the normal, below 90.
    seed
        Seed of the points, the azimuths of the views and all samples.
    backend
        Name of the backend that renders the look. One that is not exact may deviate by 1 %, the error of its fits.
    alter
        Alters the text of the shader.

    Raises
    ------
    CodegenError, RenderError, WorkerError
        The backend cannot show the look, or Cycles fails.
    """
    rng = np.random.default_rng(seed)
    looks = constant_looks(look, points, rng)
    varies = len(looks) > 1
    curves = [_measure_curves(constant_look, render, angles, rng, backend, alter) for constant_look in looks]
    transmits = any(curve.transmits for curve in curves)
    excess = _excess(curves, transmits, _EXACT if BACKENDS[backend].exact else _FITTED)
    worst = np.unravel_index(int(np.argmax(excess)), excess.shape)
    largest = float(excess[worst])
    point, estimator, view, side, _ = (int(index) for index in worst)
    point_text = f" of point {point}" if varies else ""
    points_text = f"{len(curves)} random point{'s' * (len(curves) > 1)}" if varies else "a constant look"
    return CheckFinding(
        check="albedo",
        subject=look.name,
        passed=largest <= 1.0,
        summary=(
            f"{points_text}, {len(angles)} views; largest "
            f"deviation {largest:.2f} of its band: {_ESTIMATORS[estimator]}, {_SIDES[side]}{point_text} "
            f"at {angles[view]:g} degrees"
        ),
        figures={
            "largest_deviation": largest,
            "curves": float(len(curves)),
            "cycles_error": _cycles_error(curves),
            "largest_albedo": float(max(curve.quadrature.value.sum(axis=1).max() for curve in curves)),
        },
        details=tuple(
            _describe_case(curves, angles, excess, int(index)) for index in np.argsort(-excess.ravel())[:_WORST]
        ),
        plots=tuple(
            plot
            for number, curve in enumerate(curves)
            for plot in _plot_curves(curve, angles, f", point {number}" * varies)
        ),
        skipped="" if transmits else "no light passes through: no curve of transmission",
    )


def _measure_curves(
    look: Look,
    render: RenderHalves,
    angles: tuple[float, ...],
    rng: np.random.Generator,
    backend: str,
    alter: AlterShader,
) -> _Curves:
    azimuth = float(rng.uniform(0.0, 360.0))
    # In the card's frame: x right, y up, z towards its front.
    views = spherical_direction(np.radians(angles), np.radians(azimuth))
    # Of a constant look, only the view is read.
    bsdfs = [look_bsdf(look, SinglePoint(wo[2])) for wo in views]
    surfaces = list(zip(bsdfs, views, strict=True))
    quadrature = _stack_albedos([integrate_albedo(bsdf, wo) for bsdf, wo in surfaces])
    sampled = _stack_albedos([sample_albedo(bsdf, wo, _POINTS, _SCRAMBLES, rng) for bsdf, wo in surfaces])
    transmits = any(bsdf.transmits(ZENITH) for bsdf in bsdfs)
    seed = int(rng.integers(1 << 16))  # exact as a float32, as Blender requires
    rendered = _render_albedo(look, render, views, transmits, seed, backend, alter)
    return _Curves(look, azimuth, transmits, quadrature, sampled, rendered)


def _stack_albedos(albedos: list[Albedo]) -> Albedo:
    return Albedo(np.stack([albedo.value for albedo in albedos]), np.stack([albedo.error for albedo in albedos]))


def _render_albedo(
    look: Look, render: RenderHalves, views: Floats, transmits: bool, seed: int, backend: str, alter: AlterShader
) -> Albedo:
    """Render the views. Pixels are scrambled independently, so their spread gives the error of their mean."""
    # Not marked as convex, so that the shader has bounces and shadow rays as for any asset.
    card = replace(load_asset(builtin="plane"), convex=False, digest="")
    value, error = np.zeros((2, len(views), 2, 3))
    white = prepare_light(load_environment(builtin="white"))
    for side, light in enumerate((_half_light(front=True), _half_light(front=False)) if transmits else (white,)):
        scene = alter_shaders(scene_task(Scene.of_look(card, look, light, _SIZE), _SAMPLING, backend), alter)
        for number, wo in enumerate(views):
            camera, pose = _camera_and_pose(wo)
            name = f"albedo {look.name} {seed} {side} {number}"
            halves = render(frame_task(replace(scene, camera=camera), pose, name, seed=seed))
            pixels = ((halves.a.astype(np.float64) + halves.b) / 2.0).reshape(-1, 3)
            value[number, side] = pixels.mean(axis=0)
            error[number, side] = pixels.std(axis=0, ddof=1) / np.sqrt(len(pixels))
    return Albedo(value, error)


def _camera_and_pose(wo: Floats) -> tuple[Camera, Pose]:
    """Return camera and pose for the view `wo`, whose x, y, z are the world's x, z, -y; the light stands still."""
    x, y, z = wo
    element = -90.0 - float(np.degrees(np.arctan2(-z, x)))
    camera = Camera(_FOV, float(np.degrees(np.arcsin(y))), (0.0, 0.0, 0.0), _DISTANCE)
    return camera, Pose(element % 360.0, element % 360.0)


def _half_light(*, front: bool) -> Dome:
    """Return light of radiance 1 from the half of the world in front of the card, or behind it."""
    width, height = _LIGHT_SIZE
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    is_bright = (uv_to_direction(np.stack([u, v], axis=-1))[..., 1] < 0.0) == front
    # Its directions are not sampled: the tables for sampling would take seconds.
    return prepare_light(make_environment("half", np.repeat(is_bright[..., None], 3, axis=-1)), sampled=False)


def _excess(curves: list[_Curves], transmits: bool, band: tuple[float, float]) -> Floats:
    """Return deviations from the quadrature, relative to noise and rounding: (points, estimators, views, sides, 3)."""
    sides = 2 if transmits else 1
    count = len(curves) * 2 * curves[0].quadrature.value[:, :sides].size
    # Šidák: the probability that any of all comparisons is beyond the limit is FALSE_ALARM.
    quantile = 1.0 - (1.0 - (1.0 - FALSE_ALARM_PROBABILITY) ** (1.0 / count)) / 2.0
    limits = [float(stats.t.ppf(quantile, freedom)) for freedom in (_SCRAMBLES - 1, _SIDE * _SIDE - 1)]
    excess = []
    for curve in curves:
        exact = curve.quadrature
        estimates = curve.sampled, curve.cycles
        for estimate, limit, (relative, absolute) in zip(estimates, limits, (_EXACT, band), strict=True):
            floor = exact.error + relative * exact.value + absolute
            excess.append(np.abs(estimate.value - exact.value) / (limit * estimate.error + floor))
    stacked: Floats = np.stack(excess)[:, :, :sides].reshape(len(curves), 2, -1, sides, 3)
    return stacked


def _cycles_error(curves: list[_Curves]) -> float:
    """Return the largest deviation of Cycles, divided by the value plus 0.1."""
    return max(
        float((np.abs(curve.cycles.value - curve.quadrature.value) / (curve.quadrature.value + 0.1)).max())
        for curve in curves
    )


def _describe_case(curves: list[_Curves], angles: tuple[float, ...], excess: Floats, index: int) -> str:
    point, estimator, view, side, channel = (int(i) for i in np.unravel_index(index, excess.shape))
    curve = curves[point]
    estimate = (curve.sampled, curve.cycles)[estimator]
    wo = spherical_direction(np.radians(angles), np.radians(curve.azimuth))[view]
    layers = look_layers(curve.look, SinglePoint(wo[2]))
    case = {
        "deviation": float(excess[point, estimator, view, side, channel]),
        "by": _ESTIMATORS[estimator],
        "side": _SIDES[side],
        "channel": "rgb"[channel],
        "angle": angles[view],
        "wo": wo.tolist(),
        "quadrature": float(curve.quadrature.value[view, side, channel]),
        "found": float(estimate.value[view, side, channel]),
        "standard_error": float(estimate.error[view, side, channel]),
        "layers": [
            case_layer(layer.model, {**layer_tokens(layer), **constant_numbers(layer)}, layer.mode) for layer in layers
        ],
    }
    return json.dumps(case)


def _plot_curves(curves: _Curves, angles: tuple[float, ...], suffix: str) -> tuple[FindingPlot, FindingPlot]:
    """Return a plot of the curves and one of their differences, which are too small to see in the first."""
    x = np.array(angles)
    albedos, differences = [], []
    for side, name in enumerate(_SIDES[: 1 + curves.transmits]):
        exact = curves.quadrature.value[:, side].mean(axis=-1)
        albedos.append(PlotCurve(f"{name}, quadrature", x, exact))
        for estimator, estimate in zip(_ESTIMATORS, (curves.sampled, curves.cycles), strict=True):
            y, band = estimate.value[:, side].mean(axis=-1), 3.0 * estimate.error[:, side].mean(axis=-1)
            albedos.append(PlotCurve(f"{name}, {estimator}", x, y, y - band, y + band, "points"))
            y = y - exact
            differences.append(PlotCurve(f"{name}, {estimator}", x, y, y - band, y + band))
    x_label, note = "angle of view, degrees", "mean of the channels, three standard errors"
    return (
        FindingPlot(f"Albedo{suffix}: {note}", x_label, "albedo", tuple(albedos)),
        FindingPlot(f"Minus the quadrature{suffix}: {note}", x_label, "difference", tuple(differences)),
    )
