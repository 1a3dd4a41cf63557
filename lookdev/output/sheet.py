"""The writers of contact sheets, which have several frames on a page with labels, and of a picture with a legend."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from lookdev.arrays import Bytes
from lookdev.errors import OutputError
from lookdev.output.color import DisplayView
from lookdev.output.display import to_display, write_pixels
from lookdev.output.record import FrameSequence
from lookdev.output.slate import write_text

PAGE_GREY = 46  # sRGB code values: the dark grey of the page, and the greys of text
LABEL_GREY = 190
TITLE_GREY = 235
PAGE_ASPECT = 1.6  # width of a page, divided by its height, approximately
SRGB_GAMMA = 2.2  # close enough to the sRGB curve to average pixels

SOURCE_SIZE = 512
"""Approximate longer side in pixels to which larger frames are averaged before they go on a sheet."""

OVERVIEW_CELLS = (128, 256)
"""The smallest and the largest size of a frame on an overview or a grid: its longer side, in pixels.

Smaller frames are enlarged, to make room for the names below them.
"""

_LEGEND_WIDTH = 320  # width in pixels that a legend adds to a picture


def write_contact_sheet(path: Path, frames: FrameSequence) -> None:
    """Write the contact sheet of a turntable or a wedge; raises what `write_sheet` raises."""
    write_sheet(path, list(frames.pictures(SOURCE_SIZE)), frames.labels, frames.title, frames.columns)


def write_overview(path: Path, frames: FrameSequence) -> None:
    """Write the sheet of looks side by side; raises what `write_sheet` raises."""
    pictures, (least, most) = list(frames.pictures(SOURCE_SIZE)), OVERVIEW_CELLS
    cell = min(max(least, *(side for picture in pictures for side in picture.shape[:2])), most)
    write_sheet(path, pictures, frames.labels, frames.title, frames.options["overview_columns"], cell)


def write_sheet(
    path: Path, frames: Sequence[Bytes], labels: Sequence[str], title: str, columns: int | None = None, cell: int = 256
) -> None:
    """Write the page that `sheet_page` returns as PNG, complete or not at all.

    Raises what `sheet_page` raises, and OutputError where the file cannot be written.
    """
    try:
        page = sheet_page(frames, labels, title, columns, cell)
    except OutputError as error:
        raise OutputError(f"{path}: {error}") from None
    write_pixels(path, page)


def sheet_page(
    frames: Sequence[Bytes], labels: Sequence[str], title: str, columns: int | None = None, cell: int = 256
) -> Bytes:
    """Return a contact sheet, (height, width, 3).

    It has a thumbnail of each frame, (H, W, 3) display pixels, with a label below, and the title at the top. `columns`
    is the number of frames in a row; None gives a page of about 16:10. `cell` is the longer side of a thumbnail in
    pixels. Raises OutputError where there is no frame, frames differ in size, or there is not one label for each frame.
    """
    if not frames or len(labels) != len(frames):
        counts = f"{len(frames)} frames and {len(labels)} labels"
        raise OutputError(f"a sheet needs at least one frame and a label for each, got {counts}")
    sizes = {frame.shape for frame in frames}
    if len(sizes) > 1:
        raise OutputError(f"the frames of a sheet must be of one size, got {sorted(sizes)}")
    height, width = frames[0].shape[:2]
    scale = cell / max(height, width)
    height, width = max(1, round(height * scale)), max(1, round(width * scale))

    # In pixels: the gap between thumbnails, the sizes of labels and of the title, and the distances of thumbnails.
    gap, text, heading = max(4, cell // 20), max(10, cell // 16), max(14, cell // 10)
    step_x, step_y = width + gap, height + 2 * gap + text
    if columns is None:
        columns = math.ceil(math.sqrt(len(frames) * PAGE_ASPECT * step_y / step_x))
        columns = math.ceil(len(frames) / math.ceil(len(frames) / columns))  # the same number of rows, evenly filled
    columns = max(1, min(columns, len(frames)))
    rows = math.ceil(len(frames) / columns)
    margin, top = 2 * gap, 4 * gap + heading
    page_width = 2 * margin + columns * step_x - gap
    page = np.full((top + rows * step_y + gap, page_width, 3), PAGE_GREY, dtype=np.uint8)

    corners = [(margin + i % columns * step_x, top + i // columns * step_y) for i in range(len(frames))]
    for frame, (x, y) in zip(frames, corners, strict=True):
        page[y : y + height, x : x + width] = _thumbnail(frame, width, height)
    canvas = oiio.ImageBuf(page)
    write_text(canvas, title, margin, 2 * gap + heading, heading, page_width - 2 * margin, TITLE_GREY)
    for label, (x, y) in zip(labels, corners, strict=True):
        write_text(canvas, label, x, y + height + gap // 2 + text, text, width, LABEL_GREY)
    return np.asarray(canvas.get_pixels(oiio.UINT8), dtype=np.uint8)


def write_legend(
    path: Path, picture: Bytes, title: str, entries: Sequence[tuple[str, Sequence[float]]], view: DisplayView | str
) -> None:
    """Write a picture (H, W, 3) as PNG, with a list of names and their linear colours on its right.

    Raises OutputError where the file cannot be written.
    """
    height, width = picture.shape[:2]
    text, heading, gap = 14, 20, 8
    left, step, top = width + gap, text + gap, 2 * gap + heading
    page = np.full((max(height, top + len(entries) * step + gap), width + _LEGEND_WIDTH, 3), PAGE_GREY, np.uint8)
    page[:height, :width] = picture
    rows = [top + gap + number * step for number in range(len(entries))]
    for y, (_, color) in zip(rows, entries, strict=True):
        page[y : y + text, left : left + text] = to_display(np.full((1, 1, 3), color), view)
    canvas = oiio.ImageBuf(page)
    write_text(canvas, title, left, top - gap // 2, heading, _LEGEND_WIDTH - 2 * gap, TITLE_GREY)
    for y, (name, _) in zip(rows, entries, strict=True):
        write_text(canvas, name, left + step, y + text - 2, text, _LEGEND_WIDTH - 2 * gap - step, LABEL_GREY)
    write_pixels(path, np.asarray(canvas.get_pixels(oiio.UINT8), dtype=np.uint8))


def _thumbnail(frame: Bytes, width: int, height: int) -> Bytes:
    """Return a frame, resized in nearly linear light, because averages of encoded values are too dark."""
    light = (frame / np.float32(255.0)) ** np.float32(SRGB_GAMMA)
    small = oiio.ImageBufAlgo.resize(oiio.ImageBuf(np.ascontiguousarray(light)), roi=oiio.ROI(0, width, 0, height))
    if small.has_error:
        raise OutputError(f"cannot make a {width} x {height} thumbnail: {small.geterror().strip()}")
    linear = np.clip(np.asarray(small.get_pixels(oiio.FLOAT), dtype=np.float64), 0.0, 1.0)
    return np.asarray(linear ** (1.0 / SRGB_GAMMA) * 255.0 + 0.5).astype(np.uint8)
