"""The report of a fit to a picture: one HTML file without scripts or links to other files."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from io import BytesIO
from pathlib import Path

import numpy as np

from lookdev.arrays import Bools, Bytes, Floats
from lookdev.cache import atomic_path
from lookdev.fitting.picture.search import Found, Point
from lookdev.output.color import VIEWS
from lookdev.output.display import to_display

_MOST_NOISE = 4.0
"""Standard errors at which the colour scale of differences ends."""

_STYLE = """
:root { color-scheme: light dark; --line: #8885; --weak: #8881; }
body { font: 15px/1.5 system-ui, sans-serif; margin: 0 auto; max-width: 1400px; padding: 16px; }
h1 { font-size: 1.35rem; margin: 0 0 4px; overflow-wrap: anywhere; }
h2 { font-size: 1.05rem; margin: 28px 0 8px; }
p { margin: 4px 0; overflow-wrap: anywhere; }
.pictures { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 300px), 1fr)); gap: 16px; }
figure { margin: 0; }
figure img { display: block; width: 100%; image-rendering: pixelated; background: #000; }
figcaption { padding-top: 4px; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; min-width: 100%; }
th, td { padding: 4px 12px 4px 0; text-align: left; border-bottom: 1px solid var(--line); white-space: nowrap; }
td.number, th.number { text-align: right; }
.swatch { display: inline-block; width: 1em; height: 1em; border: 1px solid var(--line); vertical-align: -0.15em; }
.scale { height: 10px; margin-top: 4px;
  background: linear-gradient(90deg, #053061, #4393c3, #f7f7f7, #d6604d, #67001f); }
.ends { display: flex; justify-content: space-between; font-size: 0.85em; }
svg { width: 100%; height: auto; min-width: 700px; max-width: 900px; }
svg text { fill: currentColor; font-size: 12px; }
.note { background: var(--weak); padding: 8px 12px; }
"""


@dataclass(frozen=True, eq=False)
class Pictures:
    """Pictures of the page, linear (H, W, 3): the photo, renders of both looks, and standard errors of differences.

    `used` (H, W) are the pixels that were compared.
    """

    photo: Floats
    before: Floats
    after: Floats
    noise_before: Floats
    noise_after: Floats
    used: Bools


@dataclass(frozen=True)
class Row:
    """A parameter of the table: its values in the look before and after, and their errors."""

    name: str
    before: tuple[float, ...]
    after: tuple[float, ...]
    error: tuple[float, ...]
    remark: str = ""


def table_rows(result: Found, before: Mapping[str, tuple[float, ...]]) -> list[Row]:
    """Return the rows of the table; `before` has the values of the original look by name."""
    rows = []
    for name, value in result.values.items():
        names = [name] if len(value) == 1 else [f"{name}[{channel}]" for channel in "rgb"]
        remark = "no effect on the picture" if {*names} <= {*result.without_effect} else ""
        remark = remark or ("not determined by the picture" if {*names} & {*result.undetermined} else "")
        others = [f"{b if a in names else a}" for a, b, _ in result.alike if {a, b} & {*names}]
        outside = list(dict.fromkeys(other for other in others if other not in names))
        rows.append(
            Row(
                name,
                before[name],
                value,
                result.errors[name],
                remark or (f"trades off with {', '.join(outside)}" if outside else ""),
            )
        )
    return rows


def format_numbers(values: Sequence[float], digits: int = 4) -> str:
    """Return values as text, ``?`` for nan."""
    return ", ".join("?" if np.isnan(value) else f"{value:.{digits}g}" for value in values)


def write_page(
    file: Path, title: str, lines: Sequence[str], pictures: Pictures, rows: Sequence[Row], result: Found
) -> None:
    """Write the page, complete or not at all; `lines` are plain text below the title."""
    body = [f"<h1>{escape(title)}</h1>", *(f"<p>{escape(line)}</p>" for line in lines)]
    body += [f'<p class="note">{escape(warning)}</p>' for warning in _warnings(result)]
    body += ["<h2>Pictures</h2>", '<div class="pictures">']
    pictures_by_caption = {"Photo": pictures.photo, "Before": pictures.before, "After": pictures.after}
    body += [
        _figure(name, to_display(_replace_non_finite(picture), VIEWS[0]))
        for name, picture in pictures_by_caption.items()
    ]
    body.append('</div><h2>Differences in units of noise</h2><div class="pictures">')
    for name, render, noise in (
        ("Before − photo", pictures.before, pictures.noise_before),
        ("After − photo", pictures.after, pictures.noise_after),
    ):
        difference = (render - pictures.photo).mean(axis=-1) / np.maximum(noise.mean(axis=-1), 1e-12)
        spread = float(np.sqrt(np.mean(difference[pictures.used] ** 2))) if pictures.used.any() else 0.0
        caption = f"{name}: root mean square {spread:.2f} of the noise where pixels are compared"
        body.append(_figure(caption, _color_difference(difference, pictures.used)))
    body.append(
        '</div><div class="scale"></div><div class="ends"><span>darker than the photo by '
        f"{_MOST_NOISE:g} standard errors</span><span>brighter</span></div>"
    )
    body += [
        "<h2>Parameters</h2>",
        *_table(rows),
        "<h2>Loss</h2>",
        '<div class="wide">',
        _curve(result.curve, result.noise),
    ]
    body.append("</div>")
    text = (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>{''.join(body)}</body></html>\n"
    )
    with atomic_path(file) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _warnings(result: Found) -> Iterator[str]:
    if result.interrupted:
        yield "The search was interrupted: these are the best parameters so far, without errors."
    elif not result.converged:
        yield "The search ended before its steps were smaller than the errors: more steps or samples may find better."
    if result.misfit > 1.5:
        yield (
            f"The difference that is left is {result.misfit:.1f} times the picture's noise: something else than these "
            "parameters differs. Errors are multiplied by that."
        )
    if len(result.starts) > 1 and not result.starts[1][1] and result.starts[1][0] < 1.2 * result.after + 1e-12:
        yield "Another start ended elsewhere at about the same loss: the result may be one of several."


def _figure(caption: str, pixels: Bytes) -> str:
    from matplotlib.image import imsave

    stream = BytesIO()
    imsave(stream, pixels, format="png")
    data = base64.b64encode(stream.getvalue()).decode()
    text = escape(caption)
    return f'<figure><img alt="{text}" src="data:image/png;base64,{data}"><figcaption>{text}</figcaption></figure>'


def _replace_non_finite(picture: Floats) -> Floats:
    return np.where(np.isfinite(picture), picture, 0.0)


def _color_difference(difference: Floats, used: Bools) -> Bytes:
    from matplotlib import colormaps

    codes = colormaps["RdBu_r"](np.clip(0.5 + 0.5 * difference / _MOST_NOISE, 0.0, 1.0))[..., :3]
    codes = np.where(used[..., None], codes, 0.25)  # grey where nothing is compared
    return (codes * 255.0 + 0.5).astype(np.uint8)


def _table(rows: Sequence[Row]) -> Iterator[str]:
    yield '<div class="wide"><table><tr><th>parameter</th><th class="number">before</th><th class="number">after</th>'
    yield '<th class="number">standard error</th><th></th></tr>'
    for row in rows:
        cells = [
            f'<td class="number">{_swatch(value)}{format_numbers(value)}</td>' for value in (row.before, row.after)
        ]
        error = f'<td class="number">{format_numbers(row.error, 2)}</td>'
        yield f"<tr><td>{escape(row.name)}</td>{''.join(cells)}{error}<td>{escape(row.remark)}</td></tr>"
    yield "</table></div>"


def _swatch(value: Sequence[float]) -> str:
    if len(value) != 3:
        return ""
    red, green, blue = to_display(np.clip(np.array(value), 0.0, 1.0)[None, None], "Un-tone-mapped")[0, 0]
    return f'<span class="swatch" style="background: rgb({red}, {green}, {blue})"></span> '


def _curve(curve: Sequence[Point], noise: float) -> str:
    """Return the loss of every render as SVG, on a logarithmic axis."""
    width, height, left, bottom = 900, 320, 64, 40
    losses = np.array([max(point.loss, 1e-12) for point in curve])
    floor = max(min(losses.min(), noise if noise > 0.0 else losses.min()), losses.max() * 1e-8)
    low, high = np.floor(np.log10(floor)), np.ceil(np.log10(losses.max()) + 1e-9)
    high = max(high, low + 1.0)

    def x(number: int) -> float:
        return left + (width - left - 16) * (number + 0.5) / len(curve)

    def y(loss: float) -> float:
        fraction = (np.log10(max(loss, 10.0**low)) - low) / (high - low)
        return 12.0 + (height - bottom - 12.0) * float(1.0 - min(fraction, 1.0))

    parts = [f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="Loss of every render">']
    for power in range(int(low), int(high) + 1):
        y_px = y(10.0**power)
        parts.append(f'<line x1="{left}" x2="{width - 16}" y1="{y_px:.1f}" y2="{y_px:.1f}" stroke="#8885"/>')
        parts.append(f'<text x="{left - 8}" y="{y_px + 4:.1f}" text-anchor="end">1e{power}</text>')
    if noise > 0.0:
        y_px = y(noise)
        parts.append(
            f'<line x1="{left}" x2="{width - 16}" y1="{y_px:.1f}" y2="{y_px:.1f}" stroke="#c33" '
            'stroke-dasharray="6 4"/>'
            f'<text x="{left + 6}" y="{y_px - 5:.1f}">noise of the photo</text>'
        )
    colors = {"start": "#888", "follow": "#2a78c2", "refine": "#2a9d4a", "end": "#c2185b"}
    line: list[str] = []
    for number, step in enumerate(curve):
        if (
            step.stage == "follow"
            and number
            and (curve[number - 1].stage, curve[number - 1].start) != ("follow", step.start)
        ):
            line.append("M")
        if step.stage == "follow" and step.accepted:
            line.append(f"{x(number):.1f} {y(step.loss):.1f}")
        fill = colors[step.stage] if step.accepted else "none"
        parts.append(
            f'<circle cx="{x(number):.1f}" cy="{y(step.loss):.1f}" r="4" fill="{fill}" stroke="{colors[step.stage]}"/>'
        )
    if line:
        path = " ".join(line if line[0] == "M" else ["M", *line])
        parts.append(f'<path d="{path}" fill="none" stroke="{colors["follow"]}"/>')
    for number, (stage, text) in enumerate(
        {"start": "starts", "follow": "steps (hollow: rejected)", "refine": "refinement", "end": "result"}.items()
    ):
        y_px = left + 190 * number
        parts.append(f'<circle cx="{y_px + 6}" cy="{height - 14}" r="4" fill="{colors[stage]}"/>')
        parts.append(f'<text x="{y_px + 16}" y="{height - 10}">{text}</text>')
    return "".join([*parts, "</svg>"])
