"""Text on pictures: lines of text, a burn-in (text that identifies a frame), and a slate (a page before a movie).

All facts in the text are from the headers of the frames. The date is the day of the render in UTC, without the time:
a frame that is rendered again on the same day gives the same picture.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from lookdev.arrays import Floats32
from lookdev.errors import OutputError, replace_controls
from lookdev.output.exr import read_header

_LINES_PER_FRAME = 30  # the height of a frame, divided by the size of text: 16 pixels in a frame of 480
_MIN_TEXT_SIZE = 8  # pixels
_BAND_FACTOR = np.float32(0.35)  # factor of the picture behind the text on a band
_INK = np.float32(0.92)  # code value of burned-in text
_PAGE = np.float32(0.12)  # code value of a slate's page

BandLine = tuple[str, str]
"""A line of text on a band: the text at the left, and the text at the right."""

FONT = "DroidSans"
"""A font that ships with OpenImageIO, under the Apache License 2.0."""


def text_width(text: str, size: int) -> int:
    """Return the width of a line of text in pixels."""
    width: int = oiio.ImageBufAlgo.text_size(replace_controls(text), size, FONT).width
    return width


def write_text(canvas: oiio.ImageBuf, text: str, x: int, baseline: int, size: int, max_width: int, ink: int) -> None:
    """Write one line of text, at most `max_width` pixels wide, in the grey `ink` (0 to 255).

    The text begins at `x`; its `baseline` is counted from the top. Longer text is shortened in its middle, because
    names of looks often differ at their end. Raises OutputError where OpenImageIO cannot write the text.
    """
    text = replace_controls(text)
    line, count = text, len(text)
    while line and oiio.ImageBufAlgo.text_size(line, size, FONT).width > max_width:
        count -= 1
        line = f"{text[: (count + 1) // 2]}…{text[len(text) - count // 2 :]}" if count > 0 else ""
    color = (ink / 255.0,) * 3
    if line and not oiio.ImageBufAlgo.render_text(canvas, x, baseline, line, size, FONT, color):
        raise OutputError(f"cannot write '{text}' on a picture: {canvas.geterror().strip()}")


def burn_in(codes: Floats32, file: Path, title: str, number: str, view: object) -> Floats32:
    """Return code values (H, W, 3 or 4) in [0, 1] with lines of text on bands at the top and the bottom.

    `file` is the EXR of the frame, `title` a name of its contents, `number` the number of the frame. Alpha is at least
    the coverage of the bands. Raises OutputError where the header cannot be read.
    """
    facts = frame_facts(read_header(file))
    size = max(_MIN_TEXT_SIZE, codes.shape[0] // _LINES_PER_FRAME)
    top = [(f"{facts['job']} / {title}", number)]
    bottom = [
        (f"{facts['samples']} samples, relMSE {facts['error']}", facts["resolution"]),
        (f"{view}, {facts['version']}", facts["date"]),
    ]
    burned = codes.copy()
    height = codes.shape[0]
    for lines, start in ((top, 0), (bottom, height - _band_height(bottom, size))):
        stop = min(start + _band_height(lines, size), height)
        if start < 0 or stop - start < _band_height(lines, size):
            continue  # the frame is too small for the band
        ink = _text_coverage([*lines], codes.shape[1], size)[..., None]
        band = burned[start:stop]
        band[..., :3] = band[..., :3] * _BAND_FACTOR * (1.0 - ink) + _INK * ink
        if codes.shape[2] == 4:
            band[..., 3:] = np.maximum(np.maximum(band[..., 3:], 1.0 - _BAND_FACTOR), ink)
    return burned


def draw_slate(
    files: Sequence[Path], title: str, view: object, rate: float, size: tuple[int, int], channels: int
) -> Floats32:
    """Return the opaque page, (H, W, channels), that precedes a movie; `size` is (H, W).

    `files` are the EXRs of all frames; their headers have the facts that the page shows. `title` is a name of their
    contents, and `rate` is in frames a second. The page states the largest error of all frames. Raises OutputError
    where a header cannot be read.
    """
    headers = [read_header(file) for file in files]
    worst = max(headers, key=lambda header: float(header["relmse"]))
    facts = frame_facts(worst)
    samples = sorted({int(header["samples"]) for header in headers})
    dates = sorted({frame_facts(header)["date"] for header in headers})
    rows = [
        ("job", facts["job"]),
        ("shows", title),
        ("look", ", ".join(dict.fromkeys(header["look"] for header in headers))),
        ("rig", facts["rig"]),
        ("frames", f"{len(files)} at {rate:g} a second"),
        ("rendered", " to ".join(dict.fromkeys((dates[0], dates[-1])))),
        ("version", facts["version"]),
        ("error", f"relMSE {facts['error']} at most"),
        ("samples", " to ".join(dict.fromkeys(map(str, (samples[0], samples[-1]))))),
        ("resolution", facts["resolution"]),
        ("view", str(view)),
    ]
    height, width = size
    text = max(_MIN_TEXT_SIZE, height // _LINES_PER_FRAME * 5 // 4)  # a quarter larger than the text of a burn-in
    page = np.full((height, width, 3), _PAGE, np.float32)
    canvas = oiio.ImageBuf(page)
    left, column = text, 6 * text
    for number, (key, value) in enumerate(rows):
        baseline = 2 * text + number * text * 2
        if baseline < height:
            write_text(canvas, key, left, baseline, text, column - text, 140)
            write_text(canvas, value, left + column, baseline, text, width - column - 2 * left, 235)
    pixels = np.asarray(canvas.get_pixels(oiio.FLOAT), np.float32)
    return pixels if channels == 3 else np.concatenate([pixels, np.ones((height, width, 1), np.float32)], axis=-1)


def frame_facts(header: Mapping[str, str]) -> dict[str, str]:
    """Return the facts in the header of a frame as readable text, by name; "?" is in place of a missing value."""
    return {
        "job": Path(header.get("job", "?")).stem,
        "rig": header.get("ibl", "?"),
        "date": header.get("time", "?").partition("T")[0],
        "version": f"lookdev {header.get('version.lookdev', '?')}, Blender {header.get('version.blender', '?')}",
        "error": f"{float(header.get('relmse', 'nan')):.1e}",
        "samples": header.get("samples", "?"),
        "resolution": header.get("resolution", "?"),
    }


def _band_height(lines: Sequence[BandLine], size: int) -> int:
    """Return the height in pixels of a band with lines of text of a size; lines are 1.25 sizes apart."""
    return (len(lines) * 5 * size) // 4 + size // 2


def _text_coverage(lines: Sequence[BandLine], width: int, size: int) -> Floats32:
    """Return the coverage of a band by its lines of text, (height of the band, `width`), in [0, 1]."""
    canvas = oiio.ImageBuf(np.zeros((_band_height(lines, size), width, 3), np.float32))
    margin = size // 2
    for number, (left, right) in enumerate(lines):
        baseline = (number * 5 * size) // 4 + size + size // 4
        room = width - 2 * margin
        right_width = min(text_width(right, size), room // 3)
        write_text(canvas, right, width - margin - right_width, baseline, size, right_width + 1, 255)
        write_text(canvas, left, margin, baseline, size, room - right_width - size, 255)
    coverage: Floats32 = np.clip(np.asarray(canvas.get_pixels(oiio.FLOAT), np.float32)[..., 0], 0.0, 1.0)
    return coverage
