"""Plots of the BSDF f or of the albedo over one angle: cartesian, polar, retro, Fresnel and albedo.

Each kind has a function that plots surfaces, and a function that returns the values of one surface. `wo` and `wi` are
unit directions to the viewer and to the light. theta_h is the polar angle of their half vector; theta_d and phi_d are
the angles of their difference vector (Rusinkiewicz 1998); theta_o and theta_i are the angles of `wo` and `wi` to the
normal.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lookdev.arrays import Floats
from lookdev.brdf import Bsdf, evaluate
from lookdev.brdf.angles import half_difference, spherical_direction
from lookdev.brdf.fresnel import schlick_weight
from lookdev.codegen.program.arrays import PART_SIZE, run_in_parts
from lookdev.errors import LookdevError
from lookdev.plotting.figure import (
    Plot,
    PlotValues,
    create_figure,
    draw_curves,
    draw_legend,
    scale_values,
    split_channels,
)
from lookdev.plotting.options import PlotOptions
from lookdev.plotting.subject import PlotSubject
from lookdev.reference.albedo import CELLS, integrate_albedo

_AXIS_LABELS = {"theta_h": "θh", "theta_d": "θd", "theta_i": "θi"}
_HORIZON_MARGIN = 1e-6  # smallest angle between a direction and the horizon, in degrees
_MIN_COSINE = np.sin(np.radians(1.0))  # cosine of a direction that is a degree above the horizon
_DECADES = 4.0  # powers of ten that a polar plot with a log scale shows
_ALBEDO_VIEWS = 19  # points of an albedo curve
_DRAFT_CELLS = (16, 8)  # cells of the quadrature by `integrate_albedo`, for a draft

FRESNEL_RANGE = (-0.5, 8.0)
"""Range of the value axis of Fresnel plots whose curves are offset and scaled, see `plot_fresnel`."""


def plot_cartesian(subjects: Sequence[PlotSubject], options: PlotOptions) -> Plot:
    """Plot f against one of the angles theta_h, theta_d and theta_i (Burley 2012, figure 9).

    theta_d is fixed if theta_h varies, and theta_h if theta_d varies. If theta_i varies, the view is fixed; theta_i is
    in the plane of incidence, negative on the viewer's side.
    """
    figure, ax, (*_, values), columns = _draw_subjects(subjects, options, cartesian_values)
    if options.axis == "theta_i":
        fixed_angles_text = f"view θo = {options.theta:g}°"
    else:
        other = "θd" if options.axis == "theta_h" else "θh"
        fixed_angles_text = f"{other} = {options.theta:g}°, φd = {options.phi:g}°"
    ax.set(xlabel=f"{_AXIS_LABELS[options.axis]} (degrees)", ylabel=_f_label(options), title=fixed_angles_text)
    scale_values(ax, options, values["inner"])
    draw_legend(ax)
    return Plot(figure, {f"{options.axis} (degrees)": values["x"], **columns})


def cartesian_values(subject: PlotSubject, options: PlotOptions) -> PlotValues:
    """Return ``f`` (n, 3) at the angles ``x`` (n,) in degrees.

    ``inner`` (n,) is whether both directions are more than a degree above the horizon.
    """
    count = options.size or 721
    low = -options.limit if options.axis == "theta_i" else 0.0
    # theta_h is evenly spaced in its square root, as in a MERL file: densely at the peak of most surfaces.
    unit = np.linspace(0.0, 1.0, count)
    degrees = options.limit * unit**2 if options.axis == "theta_h" else np.linspace(low, options.limit, count)
    angle, fixed, phi = np.radians(degrees), np.radians(options.theta), np.radians(options.phi)
    if options.axis == "theta_i":
        wo, wi = np.broadcast_to(spherical_direction(fixed, np.pi), (count, 3)), spherical_direction(angle)
    else:
        h, d = (angle, fixed) if options.axis == "theta_h" else (fixed, angle)
        wo, wi = half_difference(h, d, phi)
    inner = np.minimum(wo[:, 2], wi[:, 2]) > _MIN_COSINE
    return {"x": degrees, "f": evaluate_f(subject, wo, wi, options.cosine), "inner": inner}


def plot_retro(subjects: Sequence[PlotSubject], options: PlotOptions) -> Plot:
    """Plot f for equal directions to light and viewer, against their angle to the normal (Burley 2012, figure 6)."""
    figure, ax, (*_, values), columns = _draw_subjects(subjects, options, retro_values)
    ax.set(xlabel="θh = θi = θo (degrees)", ylabel=_f_label(options), title="retroreflection")
    scale_values(ax, options, values["inner"])
    draw_legend(ax)
    return Plot(figure, {"theta (degrees)": values["x"], **columns})


def retro_values(subject: PlotSubject, options: PlotOptions) -> PlotValues:
    """Return ``x``, ``f`` and ``inner`` as `cartesian_values` does, for equal directions to light and viewer."""
    degrees = np.linspace(0.0, options.limit, options.size or 361)
    w = spherical_direction(np.radians(np.minimum(degrees, 90.0 - _HORIZON_MARGIN)), np.radians(options.phi))
    return {"x": degrees, "f": evaluate_f(subject, w, w, options.cosine), "inner": w[:, 2] > _MIN_COSINE}


def plot_polar(subjects: Sequence[PlotSubject], options: PlotOptions) -> Plot:
    """Plot f in the plane of incidence as the radius of a curve, over theta_i; the log scale shows four decades.

    A line on the left is the view, and a line on the right is its mirror direction.
    """
    surface_values = [polar_values(subject, options) for subject in subjects]
    colors = [surface["f"] for surface in surface_values]
    figure, axes = create_figure(size=(6.8, 4.6), projection="polar")
    ax = axes[0, 0]
    peak = max((float(np.max(values)) for values in colors), default=0.0) or 1.0
    floor = peak * 10.0**-_DECADES

    def radius(values: Floats) -> Floats:
        if options.scale == "log":
            return np.asarray(np.log10(np.maximum(values, floor) / floor))
        return np.asarray(np.sqrt(np.maximum(values, 0.0)) if options.scale == "sqrt" else values)

    columns = draw_curves(ax, np.radians(surface_values[0]["x"]), subjects, colors, options, height=radius)
    top = float(radius(np.array([peak]))[0]) * 1.08
    ax.set(theta_zero_location="N", theta_direction=-1, thetamin=-90, thetamax=90, ylim=(0.0, top))
    if options.scale == "log":
        ticks = np.arange(_DECADES + 1.0)
        ax.set_yticks(ticks, [f"{floor * 10.0**tick:.1g}" for tick in ticks], fontsize=7)
    for angle, text in ((-options.theta, "view"), (options.theta, "mirrored")):
        ax.plot([np.radians(angle)] * 2, [0.0, top], color="#888888", linewidth=0.8, linestyle="--")
        ax.text(np.radians(angle), top * 0.97, text, fontsize=7, color="#555555", ha="center")
    ax.set_title(f"{_f_label(options)}, θo = {options.theta:g}°" + _scale_note(options))
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, 0.12), frameon=False, fontsize=8)
    return Plot(figure, {"theta_i (degrees)": surface_values[0]["x"], **columns})


def polar_values(subject: PlotSubject, options: PlotOptions) -> PlotValues:
    """Return ``f`` (n, 3) at theta_i ``x`` (n,) in degrees, which is negative on the viewer's side."""
    theta = np.linspace(-0.5 * np.pi, 0.5 * np.pi, options.size or 1441)
    wo = spherical_direction(np.radians(options.theta), np.radians(options.phi) + np.pi)
    wi = spherical_direction(theta, np.radians(options.phi))
    return {"x": np.degrees(theta), "f": evaluate_f(subject, np.broadcast_to(wo, wi.shape), wi, options.cosine)}


def plot_fresnel(subjects: Sequence[PlotSubject], options: PlotOptions) -> Plot:
    """Plot the rise of reflectance with theta_d.

    For surfaces that scatter along single directions, such as glass, the curve is the reflectance itself. For other
    surfaces, it is the mean of f over theta_h from 1 to 4 degrees, as in Burley 2012, figure 10. This mean is offset to
    0 at theta_d = 0, and then divided by its own mean over theta_d from 45 to 80 degrees. The plot also has Schlick's
    curve, offset and scaled in the same way.
    """
    kinds = {subject.is_delta for subject in subjects}
    if len(kinds) > 1:
        raise LookdevError(
            "fresnel: plots reflectances of mirrors and glass, f of other surfaces; one of the two kinds would be right"
        )
    figure, ax, (*_, values), columns = _draw_subjects(subjects, options, fresnel_values)
    degrees = values["x"]
    if kinds == {True}:
        ax.set(xlabel="θ (degrees)", ylabel="reflectance", title="Fresnel reflectance")
        scale_values(ax, options, np.ones(len(degrees), np.bool_))
    else:
        columns["schlick"] = values["schlick"]
        ax.plot(degrees, columns["schlick"], color="black", linestyle="--", linewidth=1.2, label="Schlick's curve")
        # Beyond 80 degrees f of a microfacet model grows without bound; the axis ends where Burley's does.
        ax.set(xlabel="θd (degrees)", ylabel="offset and scaled f", ylim=FRESNEL_RANGE)
        ax.set_title("Fresnel response, mean over θh from 1° to 4°")
    draw_legend(ax)
    return Plot(figure, {"theta_d (degrees)": degrees, **columns})


def fresnel_values(subject: PlotSubject, options: PlotOptions) -> PlotValues:
    """Return the curve ``f`` (n, 3) of `plot_fresnel` at the angles ``x`` (n,) in degrees.

    ``schlick`` (n,) is Schlick's curve; it is left out if ``f`` is a reflectance.
    """
    degrees = np.linspace(0.0, options.limit, options.size or 361)
    theta = np.radians(np.minimum(degrees, 90.0 - _HORIZON_MARGIN))
    if subject.is_delta:
        return {"x": degrees, "f": _reflectance(subject.bsdf, spherical_direction(theta))}
    schlick = _offset_and_scale(np.asarray(schlick_weight(np.cos(theta)))[:, None], degrees)[:, 0]
    scaled = _offset_and_scale(_mean_over_theta_h(subject, theta, np.radians(options.phi)), degrees)
    return {"x": degrees, "f": scaled, "schlick": schlick}


def plot_albedo(subjects: Sequence[PlotSubject], options: PlotOptions) -> Plot:
    """Plot the directional albedo, for light from both sides, against theta_o, with its error.

    The error of the quadrature (`lookdev.reference.albedo.integrate_albedo`) is drawn as a band around the curve. The
    band is mostly too thin to see; the numbers of the plot contain the error, too.
    """
    figure, ax, surface_values, columns = _draw_subjects(subjects, options, albedo_values, marker=".")
    degrees = surface_values[0]["x"]
    errors = [error for surface in surface_values for error in split_channels(surface["error"], options).values()]
    for line, (label, curve), error in zip(list(ax.lines), list(columns.items()), errors, strict=True):
        ax.fill_between(degrees, curve - error, curve + error, color=line.get_color(), alpha=0.3, linewidth=0.0)
        columns[f"{label} error"] = error
    ax.set(xlabel="θo (degrees)", ylabel="directional albedo")
    worst = max(float(surface["error"].max()) for surface in surface_values)
    ax.set_title(f"directional albedo; integration error at most {worst:.1g}")
    scale_values(ax, options, np.ones(len(degrees), np.bool_))
    ax.axhline(1.0, color="#999999", linewidth=0.8)
    draw_legend(ax)
    return Plot(figure, {"theta_o (degrees)": degrees, **columns}, (f"integration error at most {worst:.2g}",))


def albedo_values(subject: PlotSubject, options: PlotOptions, draft: bool = False) -> PlotValues:
    """Return the albedos ``f`` (n, 3) at theta_o ``x`` (n,) in degrees, and their ``error`` (n, 3).

    A draft has fewer points and coarser integrals.
    """
    degrees = np.linspace(
        0.0, min(options.limit, 89.0), options.size or (_ALBEDO_VIEWS // 2 if draft else _ALBEDO_VIEWS)
    )
    views = spherical_direction(np.radians(degrees), np.radians(options.phi))
    albedos = [integrate_albedo(subject.bsdf, view, _DRAFT_CELLS if draft else CELLS) for view in views]
    values, error = (np.array([getattr(albedo, name).sum(axis=0) for albedo in albedos]) for name in ("value", "error"))
    return {"x": degrees, "f": values, "error": error}


def _draw_subjects(
    subjects: Sequence[PlotSubject],
    options: PlotOptions,
    values: Callable[[PlotSubject, PlotOptions], PlotValues],
    marker: str = "None",
) -> tuple[Figure, Axes, list[PlotValues], dict[str, Floats]]:
    """Draw the curves of surfaces; `values` returns the values of a surface.

    Returns the figure, its axes, the values of each surface, and the values of the curves as columns.
    """
    figure, axes = create_figure()
    surface_values = [values(subject, options) for subject in subjects]
    colors = [surface["f"] for surface in surface_values]
    columns = draw_curves(axes[0, 0], surface_values[-1]["x"], subjects, colors, options, marker)
    return figure, axes[0, 0], surface_values, columns


def evaluate_f(subject: PlotSubject, wo: Floats, wi: Floats, cosine: bool) -> Floats:
    """Return f (..., 3) for directions (..., 3), times the cosine of the light if `cosine` is true.

    Raises LookdevError for a surface that scatters along single directions only, which has no f.
    """
    if subject.is_delta:
        raise LookdevError(
            f"{subject.label}: scatters along single directions and has no f; plot fresnel or albedo of it"
        )
    if subject.evaluate_fast:
        f = subject.evaluate_fast(wo.reshape(-1, 3), wi.reshape(-1, 3)).reshape(wo.shape)
    else:
        f = _evaluate_in_parts(subject.bsdf, wo, wi)
    return f * np.abs(wi[..., 2:]) if cosine else f


def _evaluate_in_parts(bsdf: Bsdf, wo: Floats, wi: Floats) -> Floats:
    """Return exactly the values of `evaluate`, faster for many directions.

    The values are computed in parts that fit into a processor's cache, on all of its cores.
    """
    count = wo.size // 3
    if count <= PART_SIZE:
        return np.asarray(evaluate(bsdf, wo, wi))
    f, flat_wo, flat_wi = np.empty((count, 3)), wo.reshape(-1, 3), wi.reshape(-1, 3)

    def fill(part: slice) -> None:
        f[part] = evaluate(bsdf, flat_wo[part], flat_wi[part])

    run_in_parts(fill, count)
    return f.reshape(wo.shape)


def _f_label(options: PlotOptions) -> str:
    """Return the label of the axis of f."""
    return "f cos θi (1/sr)" if options.cosine else "f (1/sr)"


def _scale_note(options: PlotOptions) -> str:
    """Return a note for a title on the scale of values; a linear scale needs none."""
    return {"linear": "", "sqrt": ", square root", "log": f", log, {_DECADES:g} decades"}[options.scale]


def _reflectance(bsdf: Bsdf, wo: Floats) -> Floats:
    """Return the reflectance (..., 3) of a surface that scatters along single directions, for `wo` (..., 3)."""
    total = np.zeros(wo.shape)
    for delta in bsdf.deltas(wo, np.zeros(wo.shape[:-1], np.bool_)):
        if not delta.transmits:
            total = total + np.asarray(delta.value)
    return total


def _mean_over_theta_h(subject: PlotSubject, theta_d: Floats, phi_d: float) -> Floats:
    """Return the mean of f over theta_h from 1 to 4 degrees, (n, 3), for theta_d (n,) and phi_d in radians."""
    theta_h = np.radians(np.linspace(1.0, 4.0, 25))[:, None]
    wo, wi = half_difference(theta_h, theta_d[None, :], phi_d)
    return np.asarray(evaluate_f(subject, wo, wi, cosine=False).mean(axis=0))


def _offset_and_scale(f: Floats, degrees: Floats) -> Floats:
    """Return curves `f` (n, channels), offset to 0 at their first point, and then divided by their mean.

    The mean is over the offset points whose `degrees` (n,) are from 45 to 80. Constant curves become 0.
    """
    offset = f - f[:1]
    within = (degrees >= 45.0) & (degrees <= 80.0)
    if not within.any():  # no point of the curves is from 45 to 80 degrees
        raise LookdevError("fresnel: curves are scaled by 45 to 80 degrees; a larger --limit and --size would be right")
    mean = np.abs(offset[within].mean(axis=0, keepdims=True))
    return np.asarray(offset / np.where(mean > 1e-9 * np.abs(f[within]).max(), mean, np.inf))
