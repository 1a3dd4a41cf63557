"""What an output is: which finished frames one of its files is made of, and the function that writes it.

An output is an `Output` in `lookdev.output.OUTPUTS`: job files, plans and runs follow that registry.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from lookdev.arrays import Bytes, Floats32
from lookdev.output.display import display_codes, quantised, straight_codes, write_pixels
from lookdev.output.slate import burned_in


@dataclass(frozen=True)
class Frames:
    """The finished frames that one file is made of, in their order, at least one.

    files, labels
        Their EXRs, and a short label of each.
    title
        What they show.
    options
        The ``view``, a `DisplayView`, ``burn_in`` where it is wanted, and the values of the output's own keys.
    light
        From one of the files to linear light over the background, (H, W, 3).
    layers
        From one of the files to premultiplied light (H, W, 3) and alpha (H, W).
    columns
        How many of them stand in a row, where what they show decides it.
    """

    files: tuple[Path, ...]
    labels: tuple[str, ...]
    title: str
    options: Mapping[str, Any]
    light: Callable[[Path], Floats32]
    layers: Callable[[Path], tuple[Floats32, Floats32]]
    columns: int | None = None

    def pictures(self, largest: int | None = None) -> Iterator[Bytes]:
        """Yield each frame as display pixels in the view, (H, W, 3) uint8.

        The longer side is averaged down to less than twice `largest`, so that a page of many fits into memory.
        """
        for number, file in enumerate(self.files):
            rgb = self.light(file)
            codes = display_codes(rgb if largest is None else _shrunk(rgb, largest), self.options["view"])
            yield quantised(self._burned(codes, number))

    def codes(self, *, alpha: bool = False) -> Iterator[Floats32]:
        """Yield each frame as code values in the view, (H, W, 3) in [0, 1]; with straight `alpha`, (H, W, 4)."""
        view = self.options["view"]
        for number, file in enumerate(self.files):
            codes = straight_codes(*self.layers(file), view) if alpha else display_codes(self.light(file), view)
            yield self._burned(codes, number)

    def _burned(self, codes: Floats32, number: int) -> Floats32:
        if not self.options.get("burn_in"):
            return codes
        return burned_in(codes, self.files[number], self.title, self.labels[number], self.options["view"])


@dataclass(frozen=True)
class Output:
    """A kind of file that is written of finished frames.

    Parameters
    ----------
    name, help
        The key of ``[outputs]`` that turns it on, and what it writes.
    of
        What one file is made of: a frame; the frames of a turntable; a light's looks, the first frame of each; these
        looks in step, all frames of each, in the order of time; or the cells of a wedge, the first frame of each.
    suffix
        What follows the name of the frame, or of the turntable, in the name of the file.
    write
        Writes the file, whole or not at all, or raises OutputError.
    default
        Whether it is on without its key.
    options
        Further keys of ``[outputs]``, each with its type and its pydantic field; outputs may share one.
    extra
        The extra of this package that it needs, and the module that shows whether it is installed.
    burns
        Whether text can be burned into its frames.
    """

    name: str
    help: str
    of: Literal["frame", "turntable", "looks", "step", "wedge"]
    suffix: str
    write: Callable[[Path, Frames], None]
    default: bool = False
    options: Mapping[str, tuple[Any, Any]] = field(default_factory=dict)
    extra: tuple[str, str] | None = None
    burns: bool = False


def write_picture(path: Path, frames: Frames) -> None:
    """Write the only frame as PNG."""
    write_pixels(path, *frames.pictures())


def _shrunk(rgb: Floats32, largest: int) -> Floats32:
    """Average whole blocks of pixels."""
    height, width = rgb.shape[:2]
    block = min(max(height, width) // largest, height, width)
    if block < 2:
        return rgb
    rows, columns = height // block, width // block
    blocks = rgb[: rows * block, : columns * block].reshape(rows, block, columns, block, 3)
    averages: Floats32 = blocks.mean(axis=(1, 3), dtype=np.float32)
    return averages
