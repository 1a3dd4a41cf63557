"""The classes that describe an output of a job, which is a kind of file made from finished frames.

`Output` describes the kind, with the function that writes a file. `FrameSequence` is the input of that function. The
registry `lookdev.output.OUTPUTS` lists all outputs; job files, plans and runs use it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from lookdev.arrays import Bytes, Floats32
from lookdev.output.display import display_codes, quantise, straight_codes, write_pixels
from lookdev.output.slate import burn_in


@dataclass(frozen=True)
class FrameSequence:
    """The finished frames, at least one, from which one file of an output is made, in their order.

    files, labels
        The EXRs of the frames, and a short label of each.
    title
        A name of the contents of the frames.
    options
        The ``view``, a `DisplayView`; ``burn_in``, whether frames have text; the values of the output's own keys.
    light
        A function that returns the linear light (H, W, 3) of one of the files, over the background.
    layers
        A function that returns the premultiplied light (H, W, 3) and the alpha (H, W) of one of the files.
    columns
        Number of frames in a row, for frames that are a table, such as a wedge.
    """

    files: tuple[Path, ...]
    labels: tuple[str, ...]
    title: str
    options: Mapping[str, Any]
    light: Callable[[Path], Floats32]
    layers: Callable[[Path], tuple[Floats32, Floats32]]
    columns: int | None = None

    def pictures(self, largest: int | None = None) -> Iterator[Bytes]:
        """Return each frame as display pixels in the view, (H, W, 3) uint8.

        With `largest`, blocks of pixels are averaged until the longer side is less than twice `largest`, so that a page
        of many frames fits into memory.
        """
        return map(quantise, self.codes(largest=largest))

    def codes(self, *, alpha: bool = False, largest: int | None = None) -> Iterator[Floats32]:
        """Yield code values in [0, 1] of each frame in the view: (H, W, 3), or (H, W, 4) with straight `alpha`."""
        view = self.options["view"]
        for number, file in enumerate(self.files):
            if alpha:
                codes = straight_codes(*self.layers(file), view)
            else:
                rgb = self.light(file)
                codes = display_codes(rgb if largest is None else _downscale(rgb, largest), view)
            if self.options.get("burn_in"):
                codes = burn_in(codes, file, self.title, self.labels[number], view)
            yield codes


@dataclass(frozen=True)
class Output:
    """A kind of file that is made from finished frames.

    Parameters
    ----------
    name, help
        The key of ``[outputs]`` that turns the output on, and a sentence about the file.
    scope
        The frames that go into one file. "frame": a single frame. "turntable": the frames of a turntable. "looks": the
        first frame of each look under a light in a turntable. "looks in step": all frames of all looks under a light in
        a turntable: the first frame of each look, then the second of each, and so on. "wedge": the first frame of each
        cell of a wedge, which is a table of variations of a look.
    suffix
        End of the file name, after the name of the frame or of the turntable.
    write
        Function that writes the file, complete or not at all, or raises OutputError.
    default
        Whether the output is on where a job does not have its key.
    options
        Further keys of ``[outputs]``, each with its type and its pydantic field; outputs may share a key.
    extra
        The extra of this package that the output needs, and the module whose presence shows that it is installed.
    can_burn_in
        Whether text can be burned into the frames.
    """

    name: str
    help: str
    scope: Literal["frame", "turntable", "looks", "looks in step", "wedge"]
    suffix: str
    write: Callable[[Path, FrameSequence], None]
    default: bool = False
    options: Mapping[str, tuple[Any, Any]] = field(default_factory=dict)
    extra: tuple[str, str] | None = None
    can_burn_in: bool = False


def write_picture(path: Path, frames: FrameSequence) -> None:
    """Write the only frame of a sequence as PNG."""
    write_pixels(path, *frames.pictures())


def _downscale(rgb: Floats32, largest: int) -> Floats32:
    """Return a picture (H, W, 3) whose longer side is less than twice `largest`, by averages of square blocks.

    Incomplete blocks at the right and the bottom are left out.
    """
    height, width = rgb.shape[:2]
    block = min(max(height, width) // largest, height, width)
    if block < 2:
        return rgb
    rows, columns = height // block, width // block
    blocks = rgb[: rows * block, : columns * block].reshape(rows, block, columns, block, 3)
    averages: Floats32 = blocks.mean(axis=(1, 3), dtype=np.float32)
    return averages
