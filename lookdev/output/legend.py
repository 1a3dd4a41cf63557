"""A picture with a legend of its colours."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from lookdev.arrays import Bytes
from lookdev.output.color import DisplayView
from lookdev.output.display import to_display, write_pixels
from lookdev.output.lettering import write_text
from lookdev.output.sheet import INK, PAGE, TITLE_INK

_TEXT, _TITLE, _GAP = 14, 20, 8  # pixels
_WIDTH = 320


def write_legend(
    path: Path,
    picture: Bytes,
    title: str,
    entries: Sequence[tuple[str, tuple[float, float, float]]],
    view: DisplayView | str,
) -> None:
    """Write a picture (H, W, 3) as PNG, with a list of names and their linear colours on its right.

    Raises OutputError where the file cannot be written.
    """
    height, width = picture.shape[:2]
    line = _TEXT + _GAP
    top = 2 * _GAP + _TITLE
    rows = max(height, top + len(entries) * line + _GAP)
    page = np.full((rows, width + _WIDTH, 3), PAGE, np.uint8)
    page[:height, :width] = picture
    for number, (_, color) in enumerate(entries):
        y = top + number * line + _GAP
        page[y : y + _TEXT, width + _GAP : width + _GAP + _TEXT] = to_display(np.full((1, 1, 3), color), view)
    canvas = oiio.ImageBuf(page)
    write_text(canvas, title, width + _GAP, top - _GAP // 2, _TITLE, _WIDTH - 2 * _GAP, TITLE_INK)
    for number, (name, _) in enumerate(entries):
        baseline = top + number * line + _GAP + _TEXT - 2
        write_text(canvas, name, width + 2 * _GAP + _TEXT, baseline, _TEXT, _WIDTH - 3 * _GAP - _TEXT, INK)
    write_pixels(path, np.asarray(canvas.get_pixels(oiio.UINT8), dtype=np.uint8))
