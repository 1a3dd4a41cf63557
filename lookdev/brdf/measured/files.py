"""Read and write files of measured reflectance: MERL's binaries, and the anisotropic data of Ngan et al.

All numbers of both formats are little-endian. A negative number marks a missing sample, which counts as 0. `grids`
explains the angles.

A MERL binary has three int32, 90, 90 and 180, then float64 samples: a block for each of red, green and blue. In a
block, theta_h varies slowest and phi_d fastest. The units of the blocks are 1/1500, 1.15/1500 and 1.66/1500 per sr.

A file of Ngan et al. has 16 int32, then float32 samples in 1/sr, a block for each channel. By their indices, the 16
int32 are:

- 0 to 3: the numbers of theta_i, theta_o, phi_d and phi_i;
- 6: 1, the number of this parametrisation;
- 7: 0 for cells of equal size;
- 9: 1 if phi_d covers only [0, pi];
- 10: the number of channels, 3;
- the others: reserved.

- Matusik, W. et al. 2003. A Data-Driven Reflectance Model. ACM TOG 22(3), and the reader beside the data.
- Ngan, A., Durand, F., Matusik, W. 2005. Experimental Analysis of BRDF Models. EGSR. The layout of the files is as
  described in the BRDF Explorer, https://github.com/wdas/brdf, src/brdf/BRDFMeasuredAniso.cpp. That viewer multiplies
  the numbers by ten, and measures azimuths from the opposite of the tangent; its description says neither.
"""

from __future__ import annotations

import stat
from functools import lru_cache
from math import prod
from pathlib import Path

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.measured.grids import AnisotropicGrid, IsotropicGrid, MeasurementGrid
from lookdev.errors import ModelError

MERL_SIZE = (90, 90, 180)
"""The numbers of theta_h, theta_d and phi_d in a MERL binary."""

MERL_SCALES = np.array([1.0, 1.15, 1.66]) / 1500.0
"""The units in 1/sr of the red, green and blue samples of a MERL binary."""

_MAX_F = 1e12  # the largest sample that is accepted, in 1/sr
_MAX_SAMPLES = 1 << 28  # the largest number of samples of a channel
_EXPECTED_FILE = "a MERL binary or the anisotropic data of Ngan et al. would be right"


def read_grid(file: Path) -> MeasurementGrid:
    """Return the samples of a file, from a cache while the file does not change.

    Raises
    ------
    ModelError
        The file is not a readable measurement.
    """
    try:
        status = file.stat()
    except FileNotFoundError:
        raise ModelError(f"{file}: no such file; {_EXPECTED_FILE}") from None
    except (OSError, ValueError) as error:
        raise ModelError(f"{file}: cannot be read: {getattr(error, 'strerror', error)}; {_EXPECTED_FILE}") from None
    if not stat.S_ISREG(status.st_mode):
        raise ModelError(f"{file}: is not a regular file; {_EXPECTED_FILE}")
    return _read(file, status.st_size, status.st_mtime_ns, status.st_ino)


@lru_cache(maxsize=8)
def _read(file: Path, size: int, *state: int) -> MeasurementGrid:
    """Read a file of `size` bytes; `state` is part of the cache's key, and changes with the file."""
    try:
        with file.open("rb") as stream:
            head = np.frombuffer(stream.read(64), "<i4", count=min(size, 64) // 4).tolist()
    except OSError as error:
        raise ModelError(f"{file}: cannot be read: {error.strerror}; {_EXPECTED_FILE}") from None
    if len(head) == 16 and head[6] == 1 and head[10] == 3:
        return _read_anisotropic(file, size, head)
    return _read_merl(file, size, head)


def _read_merl(file: Path, size: int, head: list[int]) -> IsotropicGrid:
    """Read a MERL binary of `size` bytes; `head` has the first int32 of the file."""
    expected = (
        f"a MERL binary has {_dimensions(MERL_SIZE)} samples of three channels, {12 + 24 * prod(MERL_SIZE)} bytes"
    )
    if len(head) < 3 or not all(0 < count <= 1 << 15 for count in head[:3]):
        raise ModelError(
            f"{file}: is not a file of measured reflectance, of {size} bytes; {expected}; {_EXPECTED_FILE}"
        )
    if tuple(head[:3]) != MERL_SIZE:
        raise ModelError(f"{file}: its header gives {_dimensions(head[:3])} samples; {expected}")
    if size != 12 + 24 * prod(MERL_SIZE):
        raise ModelError(f"{file}: has {size} bytes; {expected}")
    samples = _read_samples(file, "<f8", 12, MERL_SIZE) * MERL_SCALES
    return IsotropicGrid(samples)


def _read_anisotropic(file: Path, size: int, head: list[int]) -> AnisotropicGrid:
    """Read a file of Ngan et al. of `size` bytes; `head` has the first 16 int32 of the file."""
    shape, subject = tuple(head[:4]), f"{file}: its header of anisotropic data gives"
    if min(shape) < 1 or prod(shape) > _MAX_SAMPLES:
        raise ModelError(
            f"{subject} {_dimensions(shape)} samples; numbers of theta_i, theta_o, phi_d and phi_i from 1 on, at most "
            f"{_MAX_SAMPLES} in all, would be right"
        )
    if head[7] != 0:
        raise ModelError(f"{subject} cells of type {head[7]}; 0, for even ones, would be right")
    if head[9] not in (0, 1):
        raise ModelError(f"{subject} {head[9]} for half the data; 0 or 1 would be right")
    if size != 64 + 12 * prod(shape):
        expected = f"{_dimensions(shape)} samples of three channels, as its header gives, are {64 + 12 * prod(shape)}"
        raise ModelError(f"{file}: has {size} bytes; {expected}")
    return AnisotropicGrid(_read_samples(file, "<f4", 64, shape), half=head[9] == 1)


def _read_samples(file: Path, dtype: str, offset: int, shape: tuple[int, ...]) -> Floats:
    """Return samples (*shape, 3) in the units of the file; negative ones become 0.

    `dtype` is the type of the stored numbers, which begin at byte `offset`.
    """
    stored = np.fromfile(file, np.dtype(dtype), offset=offset).reshape(3, *shape)
    is_invalid = ~(np.isfinite(stored) & (stored <= _MAX_F))
    if is_invalid.any():
        index = tuple(int(coordinate) for coordinate in np.argwhere(is_invalid)[0])
        count = f"{np.count_nonzero(is_invalid)} samples are not finite or are above {_MAX_F:g}"
        raise ModelError(f"{file}: {count}, the first in channel {index[0]} at {index[1:]}; finite ones would be right")
    return np.moveaxis(np.maximum(stored, 0.0), 0, -1).copy()


def write_merl(file: Path, f: Floats) -> None:
    """Write samples (90, 90, 180, 3), in 1/sr, as a MERL binary."""
    stored = np.moveaxis(f / MERL_SCALES, -1, 0).astype("<f8")
    file.write_bytes(np.array(MERL_SIZE, "<i4").tobytes() + stored.tobytes())


def write_anisotropic(file: Path, f: Floats, *, half: bool = False) -> None:
    """Write samples (theta_i, theta_o, phi_d, phi_i, 3), in 1/sr, as a file of Ngan et al.

    With `half`, the phi_d of the samples covers only [0, pi].
    """
    head = np.array([*f.shape[:4], 0, 0, 1, 0, 0, int(half), 3, 0, 0, 0, 0, 0], "<i4")
    file.write_bytes(head.tobytes() + np.moveaxis(f, -1, 0).astype("<f4").tobytes())


def _dimensions(shape: tuple[int, ...] | list[int]) -> str:
    return " x ".join(map(str, shape))
