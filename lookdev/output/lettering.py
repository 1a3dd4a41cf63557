"""Lines of text on pictures."""

from __future__ import annotations

import OpenImageIO as oiio

from lookdev.errors import OutputError, replace_controls

FONT = "DroidSans"
"""A font that ships with OpenImageIO, under the Apache License 2.0."""


def text_width(text: str, size: int) -> int:
    """Return the width of a line of text in pixels."""
    width: int = oiio.ImageBufAlgo.text_size(replace_controls(text), size, FONT).width
    return width


def write_text(canvas: oiio.ImageBuf, text: str, x: int, baseline: int, size: int, room: int, ink: int) -> None:
    """Write one line of text, at most `room` pixels wide, in the grey `ink` (0 to 255); raises OutputError.

    Longer text is shortened in its middle, because names of looks often differ at their end.
    """
    text = replace_controls(text)
    line, count = text, len(text)
    while line and oiio.ImageBufAlgo.text_size(line, size, FONT).width > room:
        count -= 1
        line = f"{text[: (count + 1) // 2]}…{text[len(text) - count // 2 :]}" if count > 0 else ""
    color = (ink / 255.0,) * 3
    if line and not oiio.ImageBufAlgo.render_text(canvas, x, baseline, line, size, FONT, color):
        raise OutputError(f"cannot write '{text}' on a picture: {canvas.geterror().strip()}")
