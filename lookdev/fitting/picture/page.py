"""Writes the report of a fit to a picture: one HTML file with tables and pictures, without scripts or other files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from lookdev.arrays import Bools, Bytes, Floats
from lookdev.fitting.picture.search import LossPoint, SearchResult
from lookdev.html_page import write_html_page
from lookdev.output.color import VIEWS
from lookdev.output.display import to_display

_MAX_NOISE = 4.0
"""The difference, in standard errors, at the end of the colour scale of differences."""


@dataclass(frozen=True, eq=False)
class FitPictures:
    """The pictures of the report, linear, (H, W, 3).

    `photo` is the picture that the look is fitted to. `before` and `after` are renders of the look before and after the
    fit. `noise_before` and `noise_after` are the standard errors of their differences from the photo. `is_compared`
    (H, W) is the mask of the pixels that the fit compared.
    """

    photo: Floats
    before: Floats
    after: Floats
    noise_before: Floats
    noise_after: Floats
    is_compared: Bools


@dataclass(frozen=True)
class TableRow:
    """A row of the table of parameters, with 1 or 3 numbers for each parameter.

    `before` and `after` are the values before and after the fit. `error` has the standard errors of `after`.
    """

    name: str
    before: tuple[float, ...]
    after: tuple[float, ...]
    error: tuple[float, ...]
    remark: str = ""


def table_rows(result: SearchResult, before: Mapping[str, tuple[float, ...]]) -> list[TableRow]:
    """Return the rows of the table of parameters; `before` has the values of the original look, by name."""
    rows = []
    for name, value in result.values.items():
        names = [name] if len(value) == 1 else [f"{name}[{channel}]" for channel in "rgb"]
        remark = "no effect on the picture" if {*names} <= {*result.without_effect} else ""
        remark = remark or ("not determined by the picture" if {*names} & {*result.undetermined} else "")
        others = [f"{b if a in names else a}" for a, b, _ in result.correlated_pairs if {a, b} & {*names}]
        outside = list(dict.fromkeys(other for other in others if other not in names))
        remark = remark or (f"trades off with {', '.join(outside)}" if outside else "")
        rows.append(TableRow(name, before[name], value, result.errors[name], remark))
    return rows


def format_numbers(values: Sequence[float], digits: int = 4) -> str:
    """Return numbers with commas between them as text, with ``?`` in place of nan."""
    return ", ".join("?" if np.isnan(value) else f"{value:.{digits}g}" for value in values)


def write_page(
    file: Path, title: str, lines: Sequence[str], pictures: FitPictures, rows: Sequence[TableRow], result: SearchResult
) -> None:
    """Write the report, completely or not at all; `lines` are plain text below the title."""
    photo_and_renders = {"Photo": pictures.photo, "Before": pictures.before, "After": pictures.after}
    write_html_page(
        file,
        Path(__file__).with_suffix(".html"),
        title,
        lines=lines,
        warnings=_warnings(result),
        pictures=[
            (caption, _png(to_display(np.where(np.isfinite(picture), picture, 0.0), VIEWS[0])))
            for caption, picture in photo_and_renders.items()
        ],
        differences=[
            _difference("Before − photo", pictures.before, pictures.noise_before, pictures),
            _difference("After − photo", pictures.after, pictures.noise_after, pictures),
        ],
        most_noise=f"{_MAX_NOISE:g}",
        rows=rows,
        numbers=format_numbers,
        display_color=lambda color: to_display(np.clip([[color]], 0.0, 1.0), "Un-tone-mapped")[0, 0],
        chart=_loss_chart(result.curve, result.noise),
    )


def _warnings(result: SearchResult) -> Iterator[str]:
    """Yield warnings about a result that may be wrong."""
    if result.interrupted:
        yield "The search was interrupted: these are the best parameters so far, without errors."
    elif not result.converged:
        yield "The search ended before its steps were smaller than the errors: more steps or samples may find better."
    if result.misfit > 1.5:
        yield (
            f"The difference that is left is {result.misfit:.1f} times the picture's noise: something else than these "
            "parameters differs. Errors are multiplied by that."
        )
    if len(result.starts) > 1:
        second_loss, is_near_result = result.starts[1]
        if not is_near_result and second_loss < 1.2 * result.after + 1e-12:
            yield "Another start ended elsewhere at about the same loss: the result may be one of several."


def _difference(name: str, render: Floats, noise: Floats, pictures: FitPictures) -> tuple[str, bytes]:
    """Return a caption and a PNG of the difference between a render and the photo.

    Colours show the difference, averaged over the channels, in standard errors `noise`.
    """
    from matplotlib import colormaps

    difference = (render - pictures.photo).mean(axis=-1) / np.maximum(noise.mean(axis=-1), 1e-12)
    spread = float(np.sqrt(np.mean(difference[pictures.is_compared] ** 2))) if pictures.is_compared.any() else 0.0
    codes = colormaps["RdBu_r"](np.clip(0.5 + 0.5 * difference / _MAX_NOISE, 0.0, 1.0))[..., :3]
    codes = np.where(pictures.is_compared[..., None], codes, 0.25)  # grey where nothing is compared
    caption = f"{name}: root mean square {spread:.2f} of the noise where pixels are compared"
    return caption, _png((codes * 255.0 + 0.5).astype(np.uint8))


def _png(pixels: Bytes) -> bytes:
    from matplotlib.image import imsave

    stream = BytesIO()
    imsave(stream, pixels, format="png")
    return stream.getvalue()


def _loss_chart(curve: Sequence[LossPoint], noise: float) -> dict[str, Any]:
    """Return the data of a chart of the loss of every render, for the template of the page.

    x is the number of the render, and y is the logarithm of the loss, both scaled to [0, 1]. ``grid`` has pairs of an
    exponent of ten and its y. ``noise`` has the y of the noise, if there is any. ``points`` has x, y and the
    `LossPoint` of each render. ``lines`` has the points to connect: the accepted steps from each start.
    """
    losses = np.array([max(point.loss, 1e-12) for point in curve])
    floor = max(min(losses.min(), noise if noise > 0.0 else losses.min()), losses.max() * 1e-8)
    low, high = np.floor(np.log10(floor)), np.ceil(np.log10(losses.max()) + 1e-9)
    high = max(high, low + 1.0)

    def y(loss: float) -> float:
        return float(min((np.log10(max(loss, 10.0**low)) - low) / (high - low), 1.0))

    points = [((number + 0.5) / len(curve), y(point.loss), point) for number, point in enumerate(curve)]
    runs = groupby(points, key=lambda entry: (entry[2].stage, entry[2].start))
    return {
        "grid": [(power, y(10.0**power)) for power in range(int(low), int(high) + 1)],
        "noise": [y(noise)] if noise > 0.0 else [],
        "points": points,
        "lines": [[(x, y) for x, y, step in run if step.accepted] for (stage, _), run in runs if stage == "follow"],
    }
