"""Plots of shapes: the lobe of the BSDF f in three dimensions, and spheres under lights.

`wo` and `wi` are unit directions to the viewer and to the light, in a frame whose z is the normal.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import Normalize

from lookdev.arrays import Floats
from lookdev.brdf import bsdf_for_views, evaluate_cosine, pdf, sample
from lookdev.brdf.angles import spherical_direction
from lookdev.brdf.vectors import cross, normalize, vector
from lookdev.light import load_environment, prepare_light
from lookdev.plotting.curves import evaluate_f
from lookdev.plotting.figure import (
    LUMINANCE,
    Plot,
    PlotValues,
    create_figure,
    encode_srgb,
    legend_label,
    rgb_columns,
    unique_labels,
)
from lookdev.plotting.options import PlotOptions
from lookdev.plotting.subject import PlotSubject

_DECADES = 4.0  # powers of ten that the radius of a lobe shows with a log scale
_PIXELS = 160  # pixels along a side of the picture of a sphere
_DOME = "studio"  # the built-in environment map that lights spheres
_SAMPLES = 48  # samples of a pixel: this number of the surface, and the same number of the dome
_RECURRENCE_ROOT = 1.1673039782614187
"""Positive root of x^5 = x + 1: its inverse powers are the steps of the recurrence in 4 dimensions (Roberts 2018).

The recurrence is a sequence of evenly distributed points: each point is the previous point plus the steps, modulo 1.
"""


def plot_lobes(subjects: Sequence[PlotSubject], options: PlotOptions) -> Plot:
    """Plot f for one view as a surface whose radius, in the direction to the light, is f; the view is a line."""
    theta, phi, view = lobe_grid(options)
    figure, axes = create_figure(len(subjects), size=(4.6, 4.4), projection="3d")
    columns = {"theta_i (degrees)": np.repeat(np.degrees(theta), len(phi))}
    columns["phi_i (degrees)"] = np.tile(np.degrees(phi), len(theta))
    for ax, label, subject in zip(axes[0], unique_labels(subjects), subjects, strict=True):
        wi, f = lobe_values(subject, options).values()
        luminance = f @ LUMINANCE
        peak = float(luminance.max()) or 1.0
        if options.scale == "log":
            radius = np.maximum(np.log10(np.maximum(luminance / peak, 1e-30)) / _DECADES + 1.0, 0.0)
        else:
            radius = np.sqrt(luminance / peak) if options.scale == "sqrt" else luminance / peak
        x, y, z = np.moveaxis(wi * radius[..., None], -1, 0)
        colors = encode_srgb(f / np.maximum(f.max(axis=-1, keepdims=True), 1e-300), PlotOptions())
        shade = 0.55 + 0.45 * Normalize(0.0, 1.0)(radius)[..., None]
        ax.plot_surface(x, y, z, facecolors=np.clip(colors * shade, 0.0, 1.0), rcount=200, ccount=200, shade=False)
        ax.plot(*(np.array([[0.0, 0.0, 0.0], view]).T), color="black", linewidth=1.2)
        ax.text(*view, "view", fontsize=8)
        ax.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(0, 1), xticks=(-1, 0, 1), yticks=(-1, 0, 1), zticks=(0, 1))
        ax.set_box_aspect((2, 2, 1))
        ax.view_init(elev=22, azim=-60)
        ax.set_title(f"{legend_label(label)}\npeak {peak:.3g} /sr, {options.scale}", fontsize=8)
        columns |= rgb_columns(label, f)
    figure.suptitle(f"θo = {options.theta:g}°" + (", times cos θi" if options.cosine else ""), fontsize=9)
    return Plot(figure, columns)


def lobe_grid(options: PlotOptions) -> tuple[Floats, Floats, Floats]:
    """Return theta (n,) and phi (m,) of directions to the light in radians, and the view (3,).

    The angles are denser near the mirror direction of the view, where lobes are narrow.
    """
    count = options.size or 96
    theta = _graded_grid(0.0, 0.5 * np.pi, np.radians(options.theta), count)
    phi = _graded_grid(-np.pi, np.pi, 0.0, 2 * count) + np.radians(options.phi)
    return theta, phi, spherical_direction(np.radians(options.theta), np.radians(options.phi) + np.pi)


def lobe_values(subject: PlotSubject, options: PlotOptions) -> PlotValues:
    """Return directions to the light, ``wi``, at the angles of `lobe_grid`, and ``f`` for them, both (n, m, 3)."""
    theta, phi, view = lobe_grid(options)
    wi = spherical_direction(theta[:, None], phi[None, :])
    return {"wi": wi, "f": evaluate_f(subject, np.broadcast_to(view, wi.shape), wi, options.cosine)}


def plot_spheres(subjects: Sequence[PlotSubject], options: PlotOptions) -> Plot:
    """Plot spheres as seen from far away: above, lit by a distant point light; below, by the built-in dome ``studio``.

    The point light is `options.theta` degrees from the view, at an azimuth of `options.phi`, with an irradiance of pi.
    The light of the dome is integrated by multiple importance sampling: in a pixel, 48 directions are sampled by the
    surface, and 48 by the dome.
    """
    figure, axes = create_figure(len(subjects), 2, size=(3.0, 3.0))
    columns: dict[str, Floats] = {}
    for index, (label, subject) in enumerate(zip(unique_labels(subjects), subjects, strict=True)):
        values = sphere_values(subject, options)
        pixels, count = values.pop("pixel"), options.size or _PIXELS
        columns |= {"row": (pixels // count).astype(float), "column": (pixels % count).astype(float)}
        for row, (name, radiance) in enumerate(values.items()):
            image = np.zeros((count * count, 3))
            image[pixels] = radiance
            ax = axes[row, index]
            ax.imshow(encode_srgb(image.reshape(count, count, 3), options), origin="lower", interpolation="nearest")
            ax.set_axis_off()
            columns |= rgb_columns(f"{label}.{name}", radiance)
        axes[0, index].set_title(legend_label(label), fontsize=8)
    title = f"point light at {options.theta:g}°, and the dome '{_DOME}'; exposure {options.exposure:+g}"
    figure.suptitle(title, fontsize=9)
    return Plot(figure, columns)


def sphere_values(subject: PlotSubject, options: PlotOptions) -> PlotValues:
    """Return the radiances (n, 3) of the n pixels inside a sphere, under the ``point`` light and under the ``dome``.

    ``pixel`` (n,) has the numbers of these pixels, which count row by row from the lowest row.
    """
    count = options.size or _PIXELS
    x, y = np.meshgrid(*[(np.arange(count) + 0.5) / count * 2.0 - 1.0] * 2)
    inside = x * x + y * y < 1.0
    x, y = x[inside], y[inside]
    # The camera looks along -z. The up axis of the picture is y, which is also the pole of the sphere's tangents.
    normal = vector(x, y, np.sqrt(1.0 - x * x - y * y))
    tangent = normalize(cross(np.broadcast_to([0.0, 1.0, 0.0], normal.shape), normal))
    bitangent = cross(normal, tangent)
    frame = np.stack([np.asarray(axis) for axis in (tangent, bitangent, normal)], axis=1)
    wo = np.ascontiguousarray(frame[..., 2])
    toward_light = frame @ spherical_direction(np.radians(options.theta), np.radians(options.phi))
    point = np.zeros(wo.shape) if subject.is_delta else np.pi * evaluate_cosine(subject.bsdf, wo, toward_light)
    # Light from below the horizon of a point does not reach it.
    point = point * (toward_light[:, 2:] > 0.0)
    return {"pixel": np.flatnonzero(inside.ravel()), "point": point, "dome": _radiance_under_dome(subject, wo, frame)}


def _radiance_under_dome(subject: PlotSubject, wo: Floats, frame: Floats) -> Floats:
    """Return the radiance (n, 3) towards views `wo` (n, 3) under the dome, by samples of the surface and of the dome.

    The rows of `frame` (n, 3, 3) are the tangent, bitangent and normal of each pixel, in the axes of the picture: to
    the right, up, and to the viewer. The random numbers are an additive recurrence with a random shift for each pixel.
    """
    dome = prepare_light(load_environment(builtin=_DOME), sampled=False)
    shift = np.random.default_rng(0).random((len(wo), 4))
    step = (1.0 / _RECURRENCE_ROOT ** np.arange(1.0, 5.0)) % 1.0
    total = np.zeros(wo.shape)
    origin = np.zeros(wo.shape)
    # The same vectors in the axes of the dome, whose up axis is z; the up axis of the picture is y.
    dome_frame = frame[..., [0, 2, 1]] * (1.0, -1.0, 1.0)

    def to_dome(wi: Floats) -> Floats:
        """Convert directions (n, 3) from the frames of the pixels to the axes of the dome."""
        return np.asarray(np.einsum("nkc,nk->nc", dome_frame, wi))

    for delta in subject.bsdf.deltas(wo, np.zeros(len(wo), np.bool_)):
        if not delta.transmits:
            total += np.asarray(delta.value) * dome.radiance(origin, to_dome(np.asarray(delta.direction)))
    if not subject.bsdf.lobes(wo[:1]):
        return total
    bsdf = bsdf_for_views(subject.bsdf, wo)
    for number in range(_SAMPLES):
        u = (shift + number * step) % 1.0
        # Directions that the dome samples, converted to the frames of the pixels.
        by_light = np.einsum("nkc,nc->nk", dome_frame, dome.sample(origin, u[:, 2:]))
        for wi in (sample(bsdf, wo, u[:, :2]), by_light):
            dome_direction = to_dome(wi)
            # The balance heuristic (Veach 1997, eq. 9.8) for the same number of samples of each.
            density = (pdf(bsdf, wo, wi) + dome.pdf(origin, dome_direction)) * _SAMPLES
            is_drawn = (density > 0.0) & (wi[:, 2] != 0.0)
            weight = np.where(is_drawn, 1.0 / np.where(is_drawn, density, 1.0), 0.0)
            total += evaluate_cosine(bsdf, wo, wi) * weight[:, None] * dome.radiance(origin, dome_direction)
    return total


def _graded_grid(low: float, high: float, centre: float, count: int) -> Floats:
    """Return about `count` increasing numbers from low to high: a third evenly spaced, the rest dense near `centre`."""
    even = np.linspace(low, high, max(count // 3, 2))
    graded = centre + 0.5 * (high - low) * np.linspace(-1.0, 1.0, count - len(even)) ** 3
    return np.asarray(np.unique(np.clip(np.concatenate([even, graded]), low, high)))
