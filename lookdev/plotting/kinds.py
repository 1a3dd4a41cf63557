"""The registry of the kinds of plots, `KINDS`, and the function that draws a plot of a kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from lookdev.errors import LookdevError, nearest_hint
from lookdev.plotting import curves, maps, sampling, solid
from lookdev.plotting.figure import Plot, PlotValues
from lookdev.plotting.options import PlotOptions
from lookdev.plotting.subject import PlotSubject


@dataclass(frozen=True)
class PlotKind:
    """A kind of plot: a description, the function that draws it, its options, and its largest number of surfaces.

    `values` returns the numbers of one surface, for the Explorer, which draws them itself. For the kind ``difference``,
    these numbers are the slice of the surface. If `values` is too slow for interaction, `draft` returns coarser
    numbers. `option_names` are the fields of `PlotOptions` that the kind uses.
    """

    description: str
    draw: Callable[[Sequence[PlotSubject], PlotOptions], Plot]
    values: Callable[[PlotSubject, PlotOptions], PlotValues]
    option_names: tuple[str, ...]
    max_subjects: int = 8
    draft: Callable[[PlotSubject, PlotOptions], PlotValues] | None = None


_PICTURE_OPTIONS = ("exposure", "chroma", "size")
_CURVE_OPTIONS = ("scale", "angles", "limit", "channels", "size")

KINDS: dict[str, PlotKind] = {
    "slice": PlotKind(
        "f over theta_h and theta_d, as a picture",
        maps.plot_slices,
        maps.slice_values,
        ("phi", "cosine", *_PICTURE_OPTIONS),
        max_subjects=12,
    ),
    "polar": PlotKind(
        "lobes in the plane of incidence",
        curves.plot_polar,
        curves.polar_values,
        ("theta", "phi", "scale", "channels", "cosine", "size"),
    ),
    "lobe3d": PlotKind(
        "the lobe as a surface", solid.plot_lobes, solid.lobe_values, ("theta", "phi", "scale", "cosine", "size")
    ),
    "cartesian": PlotKind(
        "f against theta_h, theta_d or theta_i",
        curves.plot_cartesian,
        curves.cartesian_values,
        ("theta", "phi", "axis", "cosine", *_CURVE_OPTIONS),
    ),
    "albedo": PlotKind(
        "directional albedo, with its error",
        curves.plot_albedo,
        curves.albedo_values,
        ("phi", "scale", "limit", "channels", "size"),
        draft=partial(curves.albedo_values, draft=True),
    ),
    "sphere": PlotKind(
        "spheres under a point light and a dome",
        solid.plot_spheres,
        solid.sphere_values,
        ("theta", "phi", *_PICTURE_OPTIONS),
        max_subjects=12,
    ),
    "retro": PlotKind(
        "f where light and view coincide", curves.plot_retro, curves.retro_values, ("phi", "cosine", *_CURVE_OPTIONS)
    ),
    "fresnel": PlotKind(
        "how reflectance rises with theta_d", curves.plot_fresnel, curves.fresnel_values, ("phi", *_CURVE_OPTIONS)
    ),
    "difference": PlotKind(
        "slices of two, and their difference",
        maps.plot_difference,
        maps.slice_values,
        ("phi", "cosine", *_PICTURE_OPTIONS),
        max_subjects=2,
    ),
    "sampling": PlotKind(
        "pdf, weights of samples and chi-square",
        sampling.plot_sampling,
        sampling.sampling_values,
        ("theta", "phi", "size"),
        max_subjects=6,
        draft=partial(sampling.sampling_values, draft=True),
    ),
}
"""Every kind of plot by its name."""


def kind_named(name: str) -> PlotKind:
    """Return the kind of plot with this name; raises LookdevError if there is none."""
    if name not in KINDS:
        raise LookdevError(f"unknown plot '{name}' ({nearest_hint(name, list(KINDS))})")
    return KINDS[name]


def draw(name: str, subjects: Sequence[PlotSubject], options: PlotOptions = PlotOptions()) -> Plot:  # noqa: B008
    """Return a plot of surfaces; `name` is the name of a kind.

    Raises
    ------
    LookdevError
        The kind is unknown, does not use one of the given options, or cannot show this number of surfaces, or one of
        the surfaces.
    """
    kind = kind_named(name)
    if unused := [option for option in options.changed_options() if option not in kind.option_names]:
        raise LookdevError(
            f"{name} has no --{unused[0]}; its options: {', '.join(f'--{option}' for option in kind.option_names)}"
        )
    if not 1 <= len(subjects) <= kind.max_subjects:
        raise LookdevError(f"{name}: {len(subjects)} given; 1 to {kind.max_subjects} would be right")
    return kind.draw(subjects, options)
