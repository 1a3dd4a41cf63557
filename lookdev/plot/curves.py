"""Plots over one angle: cartesian, polar, retro, Fresnel and albedo."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from lookdev.brdf import Bsdf, evaluate
from lookdev.brdf.fresnel import schlick_weight
from lookdev.errors import LookdevError
from lookdev.plot.angles import Floats, half_difference, towards
from lookdev.plot.figure import (
    COLORS,
    DASHES,
    RGB,
    Plot,
    channels_of,
    distinct,
    draw_curves,
    figure_of,
    legend,
    scale_values,
    shown,
)
from lookdev.plot.options import Options
from lookdev.plot.subject import Subject
from lookdev.reference.albedo import integrate_albedo

_AXIS = {"theta_h": "θh", "theta_d": "θd", "theta_i": "θi"}
_EDGE = 1e-6
_GRAZING = np.sin(np.radians(1.0))
_DECADES = 4.0
_ALBEDO_VIEWS = 19


def cartesian(subjects: Sequence[Subject], options: Options) -> Plot:
    """Plot f against theta_h at a theta_d, theta_d at a theta_h, or theta_i at a view (Burley 2012, figure 9).

    theta_i is in the plane of incidence, negative on the viewer's side.
    """
    count = options.size or 721
    low = -options.limit if options.axis == "theta_i" else 0.0
    # As dense as the root of the angle on the side of the peak of most: a MERL file's own steps.
    unit = np.linspace(0.0, 1.0, count)
    degrees = options.limit * unit**2 if options.axis == "theta_h" else np.linspace(low, options.limit, count)
    angle, fixed, phi = np.radians(degrees), np.radians(options.theta), np.radians(options.phi)
    if options.axis == "theta_i":
        wo, wi = np.broadcast_to(towards(fixed, np.pi), (count, 3)), towards(angle)
        still = f"view θo = {options.theta:g}°"
    else:
        h, d = (angle, fixed) if options.axis == "theta_h" else (fixed, angle)
        wo, wi = half_difference(h, d, phi)
        other = "θd" if options.axis == "theta_h" else "θh"
        still = f"{other} = {options.theta:g}°, φd = {options.phi:g}°"
    figure, axes = figure_of()
    ax = axes[0, 0]
    columns = draw_curves(ax, degrees, _values(subjects, wo, wi, options), options)
    ax.set(xlabel=f"{_AXIS[options.axis]} (degrees)", ylabel=_f_label(options), title=still)
    scale_values(ax, options, np.minimum(wo[:, 2], wi[:, 2]) > _GRAZING)
    legend(ax)
    return Plot(figure, {f"{options.axis} (degrees)": degrees, **columns})


def retro(subjects: Sequence[Subject], options: Options) -> Plot:
    """Plot f where light and view coincide, against their angle to the normal (Burley 2012, figure 6)."""
    degrees = np.linspace(0.0, options.limit, options.size or 361)
    w = towards(np.radians(np.minimum(degrees, 90.0 - _EDGE)), np.radians(options.phi))
    figure, axes = figure_of()
    ax = axes[0, 0]
    columns = draw_curves(ax, degrees, _values(subjects, w, w, options), options)
    ax.set(xlabel="θh = θi = θo (degrees)", ylabel=_f_label(options), title="retroreflection")
    scale_values(ax, options, w[:, 2] > _GRAZING)
    legend(ax)
    return Plot(figure, {"theta (degrees)": degrees, **columns})


def polar(subjects: Sequence[Subject], options: Options) -> Plot:
    """Plot f in the plane of incidence as the radius of a curve; the log scale shows four decades.

    The view is on the left: an arrow, as is the mirrored one.
    """
    theta = np.linspace(-0.5 * np.pi, 0.5 * np.pi, options.size or 1441)
    wo = towards(np.radians(options.theta), np.radians(options.phi) + np.pi)
    wi = towards(theta, np.radians(options.phi))
    curves = _values(subjects, np.broadcast_to(wo, wi.shape), wi, options)
    figure, axes = figure_of(size=(6.8, 4.6), subplot_kw={"projection": "polar"})
    ax = axes[0, 0]
    peak = max((float(np.max(values)) for _, values in curves), default=0.0) or 1.0
    floor = peak * 10.0**-_DECADES

    def radius(values: Floats) -> Floats:
        if options.scale == "log":
            return np.asarray(np.log10(np.maximum(values, floor) / floor))
        return np.asarray(np.sqrt(np.maximum(values, 0.0)) if options.scale == "sqrt" else values)

    columns: dict[str, Floats] = {}
    for index, (label, values) in enumerate(curves):
        for channel, (ending, curve) in enumerate(channels_of(values, options).items()):
            color, dashes = (RGB[channel], DASHES[index % 4]) if ending else (COLORS[index % len(COLORS)], "-")
            ax.plot(theta, radius(curve), color=color, linestyle=dashes, label=f"{shown(label)}{ending}")
            columns[f"{label}{ending}"] = curve
    top = float(radius(np.array([peak]))[0]) * 1.08
    ax.set_theta_zero_location("N")
    ax.set_theta_direction(-1)
    ax.set_thetamin(-90)
    ax.set_thetamax(90)
    ax.set_ylim(0.0, top)
    if options.scale == "log":
        ticks = np.arange(_DECADES + 1.0)
        ax.set_yticks(ticks, [f"{floor * 10.0**tick:.1g}" for tick in ticks], fontsize=7)
    for angle, text in ((-options.theta, "view"), (options.theta, "mirrored")):
        ax.plot([np.radians(angle)] * 2, [0.0, top], color="#888888", linewidth=0.8, linestyle="--")
        ax.text(np.radians(angle), top * 0.97, text, fontsize=7, color="#555555", ha="center")
    ax.set_title(f"{_f_label(options)}, θo = {options.theta:g}°" + _scale_note(options))
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, 0.12), frameon=False, fontsize=8)
    return Plot(figure, {"theta_i (degrees)": np.degrees(theta), **columns})


def fresnel(subjects: Sequence[Subject], options: Options) -> Plot:
    """Plot the rise of reflectance with theta_d.

    Of what scatters along single directions the reflectance itself; of other surfaces f as in Burley 2012, figure 10:
    the mean over theta_h from 1 to 4 degrees, less its value at theta_d = 0, divided by its mean over theta_d from 45
    to 80 degrees, beside Schlick's curve treated alike.
    """
    kinds = {subject.is_delta for subject in subjects}
    if len(kinds) > 1:
        raise LookdevError(
            "fresnel: mirrors and glass, of which it plots reflectances, beside others; not both at once"
        )
    degrees = np.linspace(0.0, options.limit, options.size or 361)
    theta = np.radians(np.minimum(degrees, 90.0 - _EDGE))
    figure, axes = figure_of()
    ax = axes[0, 0]
    labels = distinct([subject.label for subject in subjects])
    if kinds == {True}:
        curves = [
            (label, _reflectance(subject.bsdf, towards(theta))) for label, subject in zip(labels, subjects, strict=True)
        ]
        columns = draw_curves(ax, degrees, curves, options)
        ax.set(xlabel="θ (degrees)", ylabel="reflectance", title="Fresnel reflectance")
        scale_values(ax, options, np.ones(len(degrees), np.bool_))
    else:
        normalised = partial(_normalised, degrees=degrees)
        curves = [
            (label, normalised(_averaged(subject.bsdf, theta, np.radians(options.phi))))
            for label, subject in zip(labels, subjects, strict=True)
        ]
        columns = draw_curves(ax, degrees, curves, options)
        columns["schlick"] = normalised(np.asarray(schlick_weight(np.cos(theta)))[:, None])[:, 0]
        ax.plot(degrees, columns["schlick"], color="black", linestyle="--", linewidth=1.2, label="Schlick's curve")
        # Past 80 degrees f of a microfacet model goes up without limit: as in the figure, the plot ends.
        ax.set(xlabel="θd (degrees)", ylabel="offset and scaled f", ylim=(-0.5, 8.0))
        ax.set_title("Fresnel response, mean over θh from 1° to 4°")
    legend(ax)
    return Plot(figure, {"theta_d (degrees)": degrees, **columns})


def albedo(subjects: Sequence[Subject], options: Options) -> Plot:
    """Plot the directional albedo against the angle of the view, light from both sides, by quadrature with its error.

    The band is the error (`lookdev.reference.albedo.integrate_albedo`), mostly too thin to see: it is in the numbers.
    """
    degrees = np.linspace(0.0, min(options.limit, 89.0), options.size or _ALBEDO_VIEWS)
    figure, axes = figure_of()
    ax = axes[0, 0]
    curves, errors = [], {}
    for label, subject in zip(distinct([each.label for each in subjects]), subjects, strict=True):
        found = [
            integrate_albedo(subject.bsdf, towards(angle, np.radians(options.phi))) for angle in np.radians(degrees)
        ]
        values, error = (np.array([getattr(each, name).sum(axis=0) for each in found]) for name in ("value", "error"))
        curves.append((label, values))
        errors[label] = error
    columns = draw_curves(ax, degrees, curves, options, marker=".", markersize=4)
    for index, (label, values) in enumerate(curves):
        bands = zip(channels_of(values, options).values(), channels_of(errors[label], options).items(), strict=True)
        for channel, (curve, (ending, error)) in enumerate(bands):
            color = RGB[channel] if ending else COLORS[index % len(COLORS)]
            ax.fill_between(degrees, curve - error, curve + error, color=color, alpha=0.3, linewidth=0.0)
            columns[f"{label}{ending} error"] = error
    ax.set(xlabel="θo (degrees)", ylabel="directional albedo")
    worst = max(float(error.max()) for error in errors.values())
    ax.set_title(f"directional albedo; integration error at most {worst:.1g}")
    scale_values(ax, options, np.ones(len(degrees), np.bool_))
    ax.axhline(1.0, color="#999999", linewidth=0.8)
    legend(ax)
    return Plot(figure, {"theta_o (degrees)": degrees, **columns}, (f"integration error at most {worst:.2g}",))


def _values(subjects: Sequence[Subject], wo: Floats, wi: Floats, options: Options) -> list[tuple[str, Floats]]:
    labels = distinct([subject.label for subject in subjects])
    return [(label, f_of(subject, wo, wi, options.cosine)) for label, subject in zip(labels, subjects, strict=True)]


def f_of(subject: Subject, wo: Floats, wi: Floats, cosine: bool) -> Floats:
    """Return f (..., 3), or f times the light's cosine; LookdevError for what has no f."""
    if subject.is_delta:
        raise LookdevError(
            f"{subject.label}: scatters along single directions and has no f; plot fresnel or albedo of it"
        )
    f = evaluate(subject.bsdf, wo, wi)
    return f * np.abs(wi[..., 2:]) if cosine else f


def _f_label(options: Options) -> str:
    return "f cos θi (1/sr)" if options.cosine else "f (1/sr)"


def _scale_note(options: Options) -> str:
    return {"linear": "", "sqrt": ", square root", "log": f", log, {_DECADES:g} decades"}[options.scale]


def _reflectance(bsdf: Bsdf, wo: Floats) -> Floats:
    total = np.zeros(wo.shape)
    for delta in bsdf.deltas(wo, np.zeros(wo.shape[:-1], np.bool_)):
        if not delta.transmits:
            total = total + np.asarray(delta.value)
    return total


def _averaged(bsdf: Bsdf, theta_d: Floats, phi_d: float) -> Floats:
    """Return the mean of f (n, 3) over theta_h from 1 to 4 degrees."""
    theta_h = np.radians(np.linspace(1.0, 4.0, 25))[:, None]
    return np.asarray(evaluate(bsdf, *half_difference(theta_h, theta_d[None, :], phi_d)).mean(axis=0))


def _normalised(f: Floats, degrees: Floats) -> Floats:
    """Return curves (n, c) less their first value, over their mean from 45 to 80 degrees; 0 for what stays constant."""
    risen = f - f[:1]
    within = (degrees >= 45.0) & (degrees <= 80.0)
    if not within.any():
        raise LookdevError("fresnel: curves are scaled by 45 to 80 degrees; a larger --limit and --size would be right")
    mean = np.abs(risen[within].mean(axis=0, keepdims=True))
    return np.asarray(risen / np.where(mean > 1e-9 * np.abs(f).max(), mean, np.inf))
