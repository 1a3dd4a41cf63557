"""The check "albedo" of `lookdev check`: compares the directional albedo of a look, computed in three ways.

The albedo is computed in NumPy by quadrature and by importance sampling (`lookdev.reference.albedo`), and by Cycles.
Cycles renders a card with the look under light from two sides. Light from the front shows the reflected light. Light
from the back shows the transmitted light. A look that varies over a surface is checked at a few random points. At each
point, the values of its textures replace the textures, so that the look is constant.
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
"""The probability that noise alone fails a look."""

ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 70.0, 80.0, 85.0)
"""Angles of view, degrees from the normal."""

# The relative and the absolute tolerance of the albedo. For exact backends, they allow for float32 rounding, and for
# the blurred edge of the light at the card's horizon. Other backends approximate the models by fits.
_EXACT, _FITTED = (2e-4, 2e-5), (1e-2, 1e-3)
_SIDE = 16  # the side of a render in pixels
_SIZE = (_SIDE, _SIDE)
_SAMPLING = Sampling(samples=64, brdf_samples=4, ibl_samples=0, bounces=0)  # directions are drawn from the BSDF only
_SCRAMBLES, _POINTS = 32, 512  # the number of independent sets of samples, and samples of a set, for `sample_albedo`
# The camera's field of view in degrees, and its distance in metres. Blender has no camera with a smaller field of view:
# the albedo is nearly constant over it.
_FOV, _DISTANCE = 0.4, 6.0
# Width and height of the map of a half-bright light, in texels. Two rows suffice, because the light depends on
# longitude only. The fine columns keep the light of the bright half off the other side of the card.
_LIGHT_SIZE = (16384, 2)
_SIDES = ("reflected", "transmitted")
_ESTIMATORS = ("NumPy's samples", "Cycles")  # the two estimates that are compared with the quadrature
_WORST = 5  # the number of deviations that a finding lists


@dataclass(frozen=True, eq=False)
class _Curves:
    """The albedo of a constant look over the angle of view, by quadrature, by sampling and by Cycles.

    The arrays of each `Albedo` have the shape (views, 2, 3). The axes are the view, the side (reflected, transmitted)
    and the channel.
    """

    look: Look
    azimuth: float  # the azimuth of all views, degrees
    transmits: bool  # whether light passes through the look
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
    """Compare the albedo of a look over the angle of view, by sampling and by Cycles, with the quadrature.

    Parameters
    ----------
    look
        The look. Its textures are read.
    render
        Renders a frame in Cycles.
    points
        The number of random points at which a look that varies over the surface is evaluated. Other looks are evaluated
        once.
    angles
        The angles of view, degrees from the normal, below 90.
    seed
        Seed of the points, the azimuths of the views and all samples.
    backend
        The name of the backend that renders the look. A backend that is not exact may deviate by 1 %, the error of its
        fits.
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
    """Compute the albedo of a constant look in all three ways, at a random azimuth of the views."""
    azimuth = float(rng.uniform(0.0, 360.0))
    # Directions to the viewer, (views, 3), in the card's frame: x right, y up, z towards its front.
    views = spherical_direction(np.radians(angles), np.radians(azimuth))
    # A constant look reads only the cosine of the view from its point.
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
    """Render the card from each view, and return the mean of the pixels as albedo.

    Each pixel has its own scramble of the samples, so the spread of the pixels gives the standard error of their mean.
    """
    # The card is not marked as convex, so its shader has bounces and shadow rays as for any asset.
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
    """Return the camera and the pose that show the card from the direction `wo` (3,) in the card's frame.

    The axes x, y, z of this frame are the world's x, z, -y. The pose turns the light by the same angle as the card, so
    the light does not move relative to the card.
    """
    x, y, z = wo
    element = -90.0 - float(np.degrees(np.arctan2(-z, x)))
    camera = Camera(_FOV, float(np.degrees(np.arcsin(y))), (0.0, 0.0, 0.0), _DISTANCE)
    return camera, Pose(element % 360.0, element % 360.0)


def _half_light(*, front: bool) -> Dome:
    """Return light of radiance 1 from the half of the world in front of the card, or behind it."""
    width, height = _LIGHT_SIZE
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    is_bright = (uv_to_direction(np.stack([u, v], axis=-1))[..., 1] < 0.0) == front
    # The renders do not sample directions of the light, so the tables for that, which would take seconds, are left out.
    return prepare_light(make_environment("half", np.repeat(is_bright[..., None], 3, axis=-1)), sampled=False)


def _excess(curves: list[_Curves], transmits: bool, band: tuple[float, float]) -> Floats:
    """Return the deviations from the quadrature, divided by the deviations that noise and rounding may cause.

    The axes are point, estimator, view, side and channel. `band` is the relative and the absolute tolerance of Cycles.
    """
    sides = 2 if transmits else 1
    count = len(curves) * 2 * curves[0].quadrature.value[:, :sides].size
    # Šidák: with this quantile, noise puts any of all comparisons beyond its limit with FALSE_ALARM_PROBABILITY.
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
    """Return the largest deviation of Cycles from the quadrature, each divided by the quadrature's value plus 0.1."""
    return max(
        float((np.abs(curve.cycles.value - curve.quadrature.value) / (curve.quadrature.value + 0.1)).max())
        for curve in curves
    )


def _describe_case(curves: list[_Curves], angles: tuple[float, ...], excess: Floats, index: int) -> str:
    """Return a line of JSON about one deviation; `index` is its position in the flattened `excess`."""
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
    """Return a plot of the curves, and a plot of their differences, which are too small to see in the first plot."""
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
