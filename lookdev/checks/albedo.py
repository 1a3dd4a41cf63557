"""Directional albedo of a look over the angle of view, computed in three ways.

By quadrature and by importance sampling in NumPy (`lookdev.reference.albedo`), and by Cycles: a card with the look,
under light from its front, then from its back. A look that varies over a surface is taken at a few random points, as
the constant look that it is there: its own shader with numbers for textures.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from lookdev.asset import load_asset
from lookdev.brdf import Bsdf
from lookdev.checks.finding import Finding, Plot, Series
from lookdev.checks.frames import Alter, Render, altered, unaltered
from lookdev.checks.samples import case_layer, constant, constant_looks, tokens
from lookdev.light import Dome, load_environment, make_environment, prepare_light
from lookdev.light.mapping import uv_to_direction
from lookdev.material import Look
from lookdev.material.points import ImagePoints
from lookdev.material.values import look_bsdf, look_layers
from lookdev.reference.albedo import Albedo, integrate_albedo, sample_albedo
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import one_frame
from lookdev.scene import Camera, Pose, Sampling, Scene

Floats = NDArray[np.float64]

FALSE_ALARM = 1e-3
"""Probability that noise alone fails a look."""

ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 70.0, 80.0, 85.0)
"""Angles of view, degrees from the normal."""

# Relative and absolute. Of exact backends: float32 rounding, as at points, and the blurred edge of the light at the
# card's horizon. Of others: the error of their fits.
_EXACT, _FITTED = (2e-4, 2e-5), (1e-2, 1e-3)
_SIDE = 16
_SIZE = (_SIDE, _SIDE)
_SAMPLING = Sampling(samples=64, brdf_samples=4, ibl_samples=0, bounces=0)
_SCRAMBLES, _POINTS = 32, 512
# The narrowest of Blender's cameras: the albedo is nearly constant over it.
_FOV, _DISTANCE = 0.4, 6.0
# A half of the sphere depends on longitude only; a fine edge keeps light from the other side of the card.
_LIGHT_SIZE = (16384, 2)
_SIDES = ("reflected", "transmitted")
_WAYS = ("NumPy's samples", "Cycles")
_WORST = 5


@dataclass(frozen=True, eq=False)
class _Curves:
    """One sample point: quadrature, sampling and Cycles over the views, value and error (views, 2, 3)."""

    look: Look
    azimuth: float
    transmits: bool
    quadrature: Albedo
    sampled: Albedo
    cycles: Albedo


def check_albedo(
    look: Look,
    render: Render,
    *,
    points: int = 3,
    angles: tuple[float, ...] = ANGLES,
    seed: int = 0,
    backend: str = "exact",
    alter: Alter = unaltered,
) -> Finding:
    """Compare the albedo curves of a look.

    Parameters
    ----------
    look, render
        Its textures are read, and it is rendered in Cycles.
    points
        Random points of the surface at which a look that varies over it is taken; any other has a single curve.
    angles
        Views, degrees from the normal, below 90.
    seed
        Chooses the points, the azimuths of the views and all samples.
    backend
        Renders the look. One that is not exact may be off by 1 %, the error of its fits.
    alter
        Alters the text of the shader.

    Raises
    ------
    CodegenError, RenderError, WorkerError
        The backend cannot show the look, or Cycles failed.
    """
    rng = np.random.default_rng(seed)
    looks = constant_looks(look, points, rng)
    varies = len(looks) > 1
    curves = [_measure(each, render, angles, rng, backend, alter) for each in looks]
    transmits = any(each.transmits for each in curves)
    excess = _excess(curves, transmits, _EXACT if BACKENDS[backend].exact else _FITTED)
    worst = np.unravel_index(int(np.argmax(excess)), excess.shape)
    largest = float(excess[worst])
    point, way, view, side, _ = (int(index) for index in worst)
    at = f" of point {point}" if varies else ""
    places = f"{len(curves)} random point{'s' * (len(curves) > 1)}" if varies else "a constant look"
    return Finding(
        check="albedo",
        subject=look.name,
        passed=largest <= 1.0,
        summary=(
            f"{places}, {len(angles)} views; largest "
            f"deviation {largest:.2f} of its band: {_WAYS[way]}, {_SIDES[side]}{at} at {angles[view]:g} degrees"
        ),
        figures={
            "largest_deviation": largest,
            "curves": float(len(curves)),
            "cycles_error": _cycles_error(curves),
            "largest_albedo": float(max(each.quadrature.value.sum(axis=1).max() for each in curves)),
        },
        details=tuple(_line(curves, angles, excess, int(index)) for index in np.argsort(-excess.ravel())[:_WORST]),
        plots=tuple(
            plot for number, each in enumerate(curves) for plot in _plots(each, angles, f", point {number}" * varies)
        ),
        skipped="" if transmits else "no light passes through: no curve of transmission",
    )


def _measure(
    look: Look, render: Render, angles: tuple[float, ...], rng: np.random.Generator, backend: str, alter: Alter
) -> _Curves:
    azimuth = float(rng.uniform(0.0, 360.0))
    views = _views(angles, azimuth)
    bsdfs = [look_bsdf(look, _Seen(wo[2])) for wo in views]
    seen = list(zip(bsdfs, views, strict=True))
    quadrature = _stacked([integrate_albedo(bsdf, wo) for bsdf, wo in seen])
    sampled = _stacked([sample_albedo(bsdf, wo, _POINTS, _SCRAMBLES, rng) for bsdf, wo in seen])
    transmits = any(map(_transmits, bsdfs))
    seed = int(rng.integers(1 << 16))  # exact as a float32, as Blender requires
    rendered = _rendered(look, render, views, transmits, seed, backend, alter)
    return _Curves(look, azimuth, transmits, quadrature, sampled, rendered)


@dataclass(frozen=True)
class _Seen(ImagePoints):
    """A point of a constant look, which reads its handedness and view only."""

    cosine: float

    def uv(self, name: str) -> NoReturn:
        raise AssertionError(f"a constant look reads the UV set {name}")

    def primvar(self, primvar: object) -> NoReturn:
        raise AssertionError(f"a constant look reads {primvar}")

    def handedness(self) -> Floats:
        return np.ones(())

    def view(self) -> Floats:
        return np.asarray(self.cosine)


def _views(angles: tuple[float, ...], azimuth: float) -> Floats:
    """Return views (n, 3) in the card's frame: x right, y up, z towards its front."""
    theta, phi = np.radians(angles), np.radians(azimuth)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def _stacked(albedos: list[Albedo]) -> Albedo:
    return Albedo(np.stack([each.value for each in albedos]), np.stack([each.error for each in albedos]))


def _transmits(bsdf: Bsdf) -> bool:
    view = np.array([0.0, 0.0, 1.0])
    deltas = bsdf.deltas(view, np.asarray(False))
    return any(each.transmits for each in deltas) or any(
        lobe.transmits and bool(np.any(lobe.share > 0.0)) for lobe in bsdf.lobes(view)
    )


def _rendered(
    look: Look, render: Render, views: Floats, transmits: bool, seed: int, backend: str, alter: Alter
) -> Albedo:
    """Render the views; pixels are scrambled independently, so their spread gives the error of their mean."""
    # Not convex, so that the shader has bounces and shadow rays as for any asset.
    card = replace(load_asset(builtin="plane"), convex=False, digest="")
    value, error = np.zeros((2, len(views), 2, 3))
    for side, light in enumerate((_half_light(front=True), _half_light(front=False)) if transmits else (_white(),)):
        scene = altered(scene_task(Scene.of_look(card, look, light, _SIZE), _SAMPLING, backend), alter)
        for number, wo in enumerate(views):
            camera, pose = _standpoint(wo)
            name = f"albedo {look.name} {seed} {side} {number}"
            halves = render(one_frame(replace(scene, camera=camera), pose, name, seed=seed))
            pixels = ((halves.a.astype(np.float64) + halves.b) / 2.0).reshape(-1, 3)
            value[number, side] = pixels.mean(axis=0)
            error[number, side] = pixels.std(axis=0, ddof=1) / np.sqrt(len(pixels))
    return Albedo(value, error)


def _standpoint(wo: Floats) -> tuple[Camera, Pose]:
    """Return camera and pose of the view `wo`, whose x, y, z are the world's x, z, -y; the light is fixed."""
    x, y, z = wo
    element = -90.0 - float(np.degrees(np.arctan2(-z, x)))
    camera = Camera(_FOV, float(np.degrees(np.arcsin(y))), (0.0, 0.0, 0.0), _DISTANCE)
    return camera, Pose(element % 360.0, element % 360.0)


def _white() -> Dome:
    return prepare_light(load_environment(builtin="white"))


def _half_light(*, front: bool) -> Dome:
    """Return light of radiance 1 from the half of the world before the card's front, or behind it."""
    width, height = _LIGHT_SIZE
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    lit = (uv_to_direction(np.stack([u, v], axis=-1))[..., 1] < 0.0) == front
    # No directions are drawn of it: the tables of these would take seconds.
    return prepare_light(make_environment("half", np.repeat(lit[..., None], 3, axis=-1)), sampled=False)


def _excess(curves: list[_Curves], transmits: bool, band: tuple[float, float]) -> Floats:
    """Return deviations from the quadrature over noise and rounding: (points, ways, views, sides, 3)."""
    sides = 2 if transmits else 1
    count = len(curves) * 2 * curves[0].quadrature.value[:, :sides].size
    # Šidák: over all comparisons together, the probability of one beyond the limit is FALSE_ALARM.
    quantile = 1.0 - (1.0 - (1.0 - FALSE_ALARM) ** (1.0 / count)) / 2.0
    limits = [float(stats.t.ppf(quantile, freedom)) for freedom in (_SCRAMBLES - 1, _SIDE * _SIDE - 1)]
    excess = []
    for each in curves:
        exact = each.quadrature
        for way, limit, (relative, absolute) in zip((each.sampled, each.cycles), limits, (_EXACT, band), strict=True):
            floor = exact.error + relative * exact.value + absolute
            excess.append(np.abs(way.value - exact.value) / (limit * way.error + floor))
    stacked: Floats = np.stack(excess)[:, :, :sides].reshape(len(curves), 2, -1, sides, 3)
    return stacked


def _cycles_error(curves: list[_Curves]) -> float:
    """Return the largest deviation of Cycles, over the value and 0.1."""
    return max(
        float((np.abs(each.cycles.value - each.quadrature.value) / (each.quadrature.value + 0.1)).max())
        for each in curves
    )


def _line(curves: list[_Curves], angles: tuple[float, ...], excess: Floats, index: int) -> str:
    point, way, view, side, channel = (int(i) for i in np.unravel_index(index, excess.shape))
    each = curves[point]
    found = (each.sampled, each.cycles)[way]
    wo = _views(angles, each.azimuth)[view]
    layers = look_layers(each.look, _Seen(wo[2]))
    case = {
        "deviation": float(excess[point, way, view, side, channel]),
        "by": _WAYS[way],
        "side": _SIDES[side],
        "channel": "rgb"[channel],
        "angle": angles[view],
        "wo": wo.tolist(),
        "quadrature": float(each.quadrature.value[view, side, channel]),
        "found": float(found.value[view, side, channel]),
        "standard_error": float(found.error[view, side, channel]),
        "layers": [case_layer(layer.model, tokens(layer) | constant(layer), layer.mode) for layer in layers],
    }
    return json.dumps(case)


def _plots(curves: _Curves, angles: tuple[float, ...], suffix: str) -> tuple[Plot, Plot]:
    """Return plots of the curves, and of their differences, which are too small to see there."""
    x = np.array(angles)
    whole, apart = [], []
    for side, name in enumerate(_SIDES[: 1 + curves.transmits]):
        exact = curves.quadrature.value[:, side].mean(axis=-1)
        whole.append(Series(f"{name}, quadrature", x, exact))
        for way, found in zip(_WAYS, (curves.sampled, curves.cycles), strict=True):
            y, band = found.value[:, side].mean(axis=-1), 3.0 * found.error[:, side].mean(axis=-1)
            whole.append(Series(f"{name}, {way}", x, y, y - band, y + band, "points"))
            y = y - exact
            apart.append(Series(f"{name}, {way}", x, y, y - band, y + band))
    x_label, what = "angle of view, degrees", "mean of the channels, three standard errors"
    return (
        Plot(f"Albedo{suffix}: {what}", x_label, "albedo", tuple(whole)),
        Plot(f"Minus the quadrature{suffix}: {what}", x_label, "difference", tuple(apart)),
    )
