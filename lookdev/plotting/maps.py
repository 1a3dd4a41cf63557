"""Pictures of the BSDF f over theta_h and theta_d: image slices, and the difference of two (Burley 2012, section 3.3).

`wo` and `wi` are unit directions to the viewer and to the light. theta_h is the polar angle of their half vector;
theta_d and phi_d are the angles of their difference vector (Rusinkiewicz 1998).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from matplotlib.axes import Axes

from lookdev.arrays import Floats
from lookdev.brdf.angles import half_difference
from lookdev.errors import LookdevError
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

_PIXELS = 256  # pixels along a side of a slice
# Texts on a slice: horizontal and vertical position in [0, 1], text, rotation in degrees, and both alignments.
_MARKS = (
    (0.03, 0.5, "specular peak", 90, "center", "center"),
    (0.5, 0.97, "Fresnel peak", 0, "center", "top"),
    (0.5, 0.03, "retroreflection", 0, "center", "bottom"),
    (0.97, 0.03, "grazing\nretroreflection", 0, "right", "bottom"),
    (0.5, 0.5, "diffuse", 0, "center", "center"),
)


def plot_slices(subjects: Sequence[PlotSubject], options: PlotOptions) -> Plot:
    """Plot image slices: f over theta_h, to the right, and theta_d, upwards, at a phi_d (Burley 2012, figures 3 and 4).

    The first slice has the texts of figure 3. It also has the isolines where the light or the view is 60 degrees from
    the normal, which coincide at phi_d = 90 degrees.
    """
    theta, wo, wi = slice_grid(options)
    figure, axes = create_figure(len(subjects), size=(3.7, 3.9))
    columns = _angles(theta)
    for index, (label, subject) in enumerate(zip(unique_labels(subjects), subjects, strict=True)):
        f = evaluate_f(subject, wo, wi, options.cosine)
        _draw_image(axes[0, index], f, label, options)
        if index == 0:
            _annotate(axes[0, 0], wo, wi)
        columns |= rgb_columns(label, f)
    figure.suptitle(_title(options), fontsize=9)
    return Plot(figure, columns)


def slice_values(subject: PlotSubject, options: PlotOptions) -> PlotValues:
    """Return ``f`` (n, n, 3), the slice of a surface.

    Rows are theta_d and columns theta_h, from 0 to 90 degrees, at the centres of pixels.
    """
    _, wo, wi = slice_grid(options)
    return {"f": evaluate_f(subject, wo, wi, options.cosine)}


def plot_difference(subjects: Sequence[PlotSubject], options: PlotOptions) -> Plot:
    """Plot the slices of two surfaces, and the difference of the cube roots of their luminances, second minus first.

    Differences of cube roots are about proportional to visible differences; Ngan et al. 2005, section 3.2, use them as
    a loss.
    """
    if len(subjects) != 2:
        raise LookdevError(f"difference: {len(subjects)} given; two would be right")
    theta, wo, wi = slice_grid(options)
    first, second = (evaluate_f(subject, wo, wi, options.cosine) for subject in subjects)
    above = (wo[..., 2] > 0.0) & (wi[..., 2] > 0.0)
    root_difference = np.where(above, np.cbrt(second @ LUMINANCE) - np.cbrt(first @ LUMINANCE), np.nan)
    figure, axes = create_figure(3, size=(3.9, 3.9))
    columns = _angles(theta)
    for ax, f, label in zip(axes[0], (first, second), unique_labels(subjects), strict=False):
        _draw_image(ax, f, label, options)
        columns |= rgb_columns(label, f)
    # The range of colours ends at a percentile. Some models grow without bound in a corner of the slice: a range up to
    # the maximum would leave no colours for the rest.
    limit = float(np.nanpercentile(np.abs(root_difference), 98.0)) or 1.0
    image = axes[0, 2].imshow(
        root_difference,
        origin="lower",
        extent=(0, 90, 0, 90),
        cmap="RdBu_r",
        vmin=-limit,
        vmax=limit,
        interpolation="nearest",
    )
    axes[0, 2].set(xlabel="θh (degrees)", facecolor="black", xticks=range(0, 91, 30), yticks=range(0, 91, 30))
    figure.colorbar(image, ax=axes[0, 2], shrink=0.8, extend="both")
    # The mean is over the picture, d theta_h d theta_d, not over solid angles.
    rms, relative = float(np.sqrt(np.nanmean(root_difference**2))), _relative_difference(first[above], second[above])
    axes[0, 2].set_title(f"difference of cube roots, rms {rms:.3g}", fontsize=9)
    figure.suptitle(_title(options), fontsize=9)
    columns["difference of cube roots"] = root_difference.ravel()
    return Plot(
        figure, columns, (f"rms of cube roots {rms:.4g}", f"largest difference of f {relative:.4g} of the peak")
    )


def slice_grid(options: PlotOptions) -> tuple[Floats, Floats, Floats]:
    """Return the angles (n,) of both the columns and the rows of a slice in degrees, and `wo` and `wi` (n, n, 3)."""
    return _cached_grid(options.size or _PIXELS, options.phi)


@lru_cache(maxsize=4)
def _cached_grid(count: int, phi: float) -> tuple[Floats, Floats, Floats]:
    """Return what `slice_grid` returns, for a number of pixels along a side and phi_d in degrees."""
    theta = (np.arange(count) + 0.5) / count * 90.0
    angle = np.radians(theta)
    wo, wi = half_difference(angle[None, :], angle[:, None], np.radians(phi))
    for array in (theta, wo, wi):
        array.flags.writeable = False
    return theta, wo, wi


def _angles(theta: Floats) -> dict[str, Floats]:
    """Return the columns of a plot's numbers with the angles of each pixel of a slice."""
    h, d = np.meshgrid(theta, theta)
    return {"theta_h (degrees)": h.ravel(), "theta_d (degrees)": d.ravel()}


def _relative_difference(first: Floats, second: Floats) -> float:
    """Return the largest difference of two arrays, divided by their largest value."""
    return float(np.abs(first - second).max() / max(first.max(), second.max(), 1e-300))


def _draw_image(ax: Axes, f: Floats, label: str, options: PlotOptions) -> None:
    """Draw a slice `f` (n, n, 3) with its label and axes."""
    ax.set_title(legend_label(label), fontsize=9)
    ax.imshow(encode_srgb(f, options), origin="lower", extent=(0, 90, 0, 90), interpolation="nearest")
    ax.set(xlabel="θh (degrees)", ylabel="θd (degrees)", xticks=range(0, 91, 30), yticks=range(0, 91, 30))


def _annotate(ax: Axes, wo: Floats, wi: Floats) -> None:
    """Draw the texts of a slice, and the isolines where `wi` or `wo` has a cosine of 0.5."""
    for x, y, text, rotation, ha, va in _MARKS:
        ax.text(
            x * 90, y * 90, text, rotation=rotation, ha=ha, va=va, fontsize=7, color="white",
            bbox={"facecolor": "black", "alpha": 0.35, "pad": 1.0, "linewidth": 0.0},
        )  # fmt: skip
    for w, dashes in ((wi, "-"), (wo, "--")):
        axis = (np.arange(len(w)) + 0.5) / len(w) * 90.0
        ax.contour(axis, axis, w[..., 2], [0.5], colors="white", linewidths=0.8, linestyles=dashes)
    ax.text(60, 20, "θi, θo = 60°", fontsize=6, color="white", ha="left")


def _title(options: PlotOptions) -> str:
    """Return the title of a plot of slices, which states the options that change its pictures."""
    parts = [f"φd = {options.phi:g}°", f"exposure {options.exposure:+g}"]
    return ", ".join(parts + ["chroma"] * options.chroma + ["times cos θi"] * options.cosine)
