"""Frames as EXR: one part, scanlines, float32 R, G, B, A, and a header that says all about the frame.

Header entries are string attributes named ``lookdev:<key>``, numbers too: OpenEXR's own numbers are 32 bits
wide, and a digest, a 64-bit seed or an error estimate must come back as it was written.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import ArrayLike, NDArray

from lookdev.cache import atomic_path
from lookdev.errors import OutputError

Floats = NDArray[np.float32]

PREFIX = "lookdev:"


def write_frame(path: Path, beauty: ArrayLike, alpha: ArrayLike, header: Mapping[str, str | float | int]) -> None:
    """Write a frame, whole or not at all; folders are made.

    Parameters
    ----------
    path : where to, ``.exr``.
    beauty : (H, W, 3) linear Rec.709 radiance, premultiplied.
    alpha : (H, W) coverage in [0, 1].
    header : what the header says; `read_header` gives it back as strings (numbers as ``repr`` has them).

    Raises
    ------
    OutputError
        The shapes do not belong together, or the file cannot be written.
    """
    rgb, coverage = np.asarray(beauty, np.float32), np.asarray(alpha, np.float32)
    if rgb.shape != (*coverage.shape, 3) or coverage.ndim != 2:
        raise OutputError(f"{path}: beauty {rgb.shape} and alpha {coverage.shape} must be (H, W, 3) and (H, W)")
    planes = {name: np.ascontiguousarray(rgb[..., i]) for i, name in enumerate("RGB")}
    planes["A"] = np.ascontiguousarray(coverage)
    attributes: dict[str, object] = {PREFIX + key: str(value) for key, value in header.items()}
    attributes |= {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    try:
        with atomic_path(path) as temporary, OpenEXR.File(attributes, planes) as exr:
            exr.write(str(temporary))
    except (RuntimeError, OSError) as error:
        raise OutputError(f"{path}: cannot write the frame: {error}") from error


def read_frame(path: Path) -> tuple[Floats, Floats]:
    """Read beauty (H, W, 3) and alpha (H, W) of a frame back, exactly as written.

    Raises
    ------
    OutputError
        The file is missing, broken, cut short, or lacks a channel.
    """
    try:
        with OpenEXR.File(str(path), separate_channels=True) as exr:
            # OpenEXR drops a part that it cannot decode: `channels()` of a broken file raises ValueError.
            planes = [exr.channels()[name].pixels for name in "RGBA"]
    except (RuntimeError, ValueError, KeyError) as error:
        raise OutputError(f"{path}: not a whole frame with channels R, G, B, A: {error}") from error
    return np.stack(planes[:3], axis=-1), planes[3]


def read_header(path: Path) -> dict[str, str]:
    """Read what a frame's header says, without decoding its pixels.

    Returns
    -------
    The entries given to `write_frame`, as strings; empty for an EXR that is no frame of ours.

    Raises
    ------
    OutputError
        The file is missing or its header unreadable.
    """
    try:
        with OpenEXR.File(str(path), header_only=True) as exr:
            entries = exr.header().items()
            return {key.removeprefix(PREFIX): str(value) for key, value in entries if key.startswith(PREFIX)}
    except (RuntimeError, ValueError) as error:
        raise OutputError(f"{path}: no readable EXR header: {error}") from error
