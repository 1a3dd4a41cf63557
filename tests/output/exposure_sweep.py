"""The exposure sweep of docs/colour.md: frames by three views at several exposures, as one JPEG.

Usage: python tests/output/exposure_sweep.py PICTURE.jpg FRAME.exr...
"""

import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from lookdev.output.color import VIEWS
from lookdev.output.display import to_display
from lookdev.output.exr import read_frame
from lookdev.output.sheet import LABEL_GREY, PAGE_GREY
from lookdev.output.slate import write_text

STOPS = (-2, 0, 2, 4, 6)
LABEL = 18


def draw_sweep(frames: list[Path]) -> oiio.ImageBuf:
    rows = []
    for frame in frames:
        rgb, _ = read_frame(frame)
        for view in VIEWS[:3]:
            row = [to_display(rgb * 2.0**stops, view) for stops in STOPS]
            rows += [np.full((LABEL, rgb.shape[1] * len(STOPS), 3), PAGE_GREY, np.uint8), np.hstack(row)]
    page = oiio.ImageBuf(np.ascontiguousarray(np.vstack(rows)))
    height, width = read_frame(frames[0])[0].shape[:2]
    for number in range(3 * len(frames)):
        for column, stops in enumerate(STOPS):
            name = VIEWS[number % 3].replace("Un-tone-mapped", "sRGB, clipped")
            baseline = number * (LABEL + height) + LABEL - 5
            write_text(page, f"{name}, {stops:+d} stops", column * width + 4, baseline, 11, width - 8, LABEL_GREY)
    page.specmod().attribute("Compression", "jpeg:72")
    return page


if __name__ == "__main__":
    picture, *frames = map(Path, sys.argv[1:])
    draw_sweep(frames).write(str(picture), oiio.UINT8)
