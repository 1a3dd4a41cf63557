"""Lines of text on pictures."""

from __future__ import annotations

import OpenImageIO as oiio

from lookdev.errors import OutputError, replace_controls

FONT = "DroidSans"
"""Ships with OpenImageIO, under the Apache License 2.0."""


def text_width(text: str, size: int) -> int:
    """Return the width of a line of text, pixels."""
    width: int = oiio.ImageBufAlgo.text_size(replace_controls(text), size, FONT).width
    return width


def write_text(canvas: oiio.ImageBuf, text: str, x: int, baseline: int, size: int, room: int, ink: int) -> None:
    """Write one line of text, shortened in its middle to `room` pixels: names of looks often differ at their end."""
    text = replace_controls(text)
    shown, kept = text, len(text)
    while shown and oiio.ImageBufAlgo.text_size(shown, size, FONT).width > room:
        kept -= 1
        shown = f"{text[: (kept + 1) // 2]}…{text[len(text) - kept // 2 :]}" if kept > 0 else ""
    color = (ink / 255.0,) * 3
    if shown and not oiio.ImageBufAlgo.render_text(canvas, x, baseline, shown, size, FONT, color):
        raise OutputError(f"cannot write '{text}' on a picture: {canvas.geterror().strip()}")
