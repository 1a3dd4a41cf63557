"""Cryptomatte: the coverage of named objects, materials or assets in each pixel.

A matte stores, for each pixel, pairs of an id and a coverage. An id is a hash of a name, stored as the bits of a
float32. Workers render mattes and rank their pairs by these functions. The writer of EXR files uses `matte_header`.

- Friedman, J. and Jones, A. 2015. Fully Automatic ID Mattes with Support for Motion Blur and Transparency. SIGGRAPH
  Posters. The specification, version 1.2, is by Psyop.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from lookdev.arrays import Floats32

RANKS = 6
"""The number of pairs in a pixel of a matte. Two ids and their coverages fill the four channels of a layer."""


def matte_samples(samples: int) -> int:
    """Return the samples of a frame's mattes: half the frame's samples, as a power of two from 16 to 4096.

    Half the samples are rounded up to a power of two.
    """
    return min(max(16, 1 << (samples // 2 - 1).bit_length()), 4096)


def murmur3(text: str) -> int:
    """Return MurmurHash3_x86_32 of a text in UTF-8, with seed 0 (Appleby 2011)."""
    data = text.encode()
    whole = len(data) // 4
    value = 0
    for (block,) in struct.iter_unpack("<I", data[: 4 * whole]):
        value = (_rotate_left(value ^ _mix_block(block), 13) * 5 + 0xE6546B64) & 0xFFFFFFFF
    value ^= _mix_block(int.from_bytes(data[4 * whole :], "little")) ^ len(data)
    value = ((value ^ value >> 16) * 0x85EBCA6B) & 0xFFFFFFFF
    value = ((value ^ value >> 13) * 0xC2B2AE35) & 0xFFFFFFFF
    return value ^ value >> 16


def _mix_block(block: int) -> int:
    return (_rotate_left(block * 0xCC9E2D51 & 0xFFFFFFFF, 15) * 0x1B873593) & 0xFFFFFFFF


def _rotate_left(value: int, bits: int) -> int:
    return (value << bits | value >> 32 - bits) & 0xFFFFFFFF


def matte_id(name: str) -> int:
    """Return the id of a name: its hash, with a bit flipped if the bits are not a finite, normal float32."""
    value = murmur3(name)
    return value ^ 1 << 23 if value >> 23 & 255 in (0, 255) else value


def matte_header(matte: str, names: Iterable[str]) -> dict[str, str]:
    """Return the header attributes of an EXR with a matte; the manifest has the id of each name."""
    key = f"cryptomatte/{murmur3(matte):08x}"[: len("cryptomatte/") + 7]
    manifest = {name: f"{matte_id(name):08x}" for name in sorted(names)}
    return {
        f"{key}/name": matte,
        f"{key}/hash": "MurmurHash3_32",
        f"{key}/conversion": "uint32_to_float32",
        f"{key}/manifest": json.dumps(manifest, separators=(",", ":")),
    }


def rename_ids(mattes: Floats32, names: Mapping[str, str]) -> Floats32:
    """Return mattes in which the ids of old names are replaced by the ids of new names. Other ids are left out.

    Several old names may have the same new name: their coverages are summed up.

    mattes : (H, W, 2 n), n pairs of id and coverage for each pixel; names : the new name of each old name. Returns
    mattes (H, W, 2 `RANKS`), largest coverage first.
    """
    old = np.array([matte_id(name) for name in names], np.uint32)
    new = np.array([matte_id(name) for name in names.values()], np.uint32)
    order = np.argsort(old)
    old, new = old[order], new[order]
    pairs = np.flatnonzero(mattes[..., 1::2].any(axis=(0, 1))).max(initial=0) + 1
    bits = np.ascontiguousarray(mattes[..., 0 : 2 * pairs : 2]).view(np.uint32)
    coverage = mattes[..., 1 : 2 * pairs : 2]
    index = np.minimum(np.searchsorted(old, bits), len(old) - 1)
    is_listed = (old[index] == bits) & (coverage > 0.0)
    ids, coverage = np.where(is_listed, new[index], 0), np.where(is_listed, coverage, np.float32(0.0))
    ranked = np.zeros((*is_listed.shape[:2], RANKS, 2), np.float32)
    # Most pixels have one id, or none. Only the other pixels are sorted, which is slow.
    largest = np.argmax(coverage, axis=-1)[..., None]
    ranked[..., 0, 0] = np.take_along_axis(ids, largest, -1)[..., 0].view(np.float32)
    ranked[..., 0, 1] = np.take_along_axis(coverage, largest, -1)[..., 0]
    several = np.count_nonzero(is_listed, axis=-1) > 1
    ranked[several] = _sum_equal_ids(ids[several], coverage[several])
    return ranked.reshape(*is_listed.shape[:2], 2 * RANKS)


def _sum_equal_ids(ids: NDArray[np.uint32], coverage: Floats32) -> Floats32:
    """Sum up the coverages of equal ids, for P pixels with n pairs each.

    ids, coverage : (P, n). Returns pairs of id and coverage (P, `RANKS`, 2), largest coverage first.
    """
    order = np.argsort(ids, axis=1, kind="stable")
    ids, coverage = np.take_along_axis(ids, order, 1), np.take_along_axis(coverage, order, 1)
    # Equal ids are now adjacent. The total of an id is the difference between the running sum at its last entry and
    # the running sum at the last entry of the id before.
    sums = coverage.cumsum(axis=1, dtype=np.float64)
    last = np.concatenate([ids[:, 1:] != ids[:, :-1], np.ones((len(ids), 1), bool)], axis=1)
    before = np.maximum.accumulate(np.where(last, sums, 0.0), axis=1)
    before = np.concatenate([np.zeros((len(ids), 1)), before[:, :-1]], axis=1)
    total = np.where(last & (ids != 0), sums - before, 0.0)
    largest = np.argsort(-total, axis=1, kind="stable")[:, :RANKS]
    largest_totals = np.take_along_axis(total, largest, 1).astype(np.float32)
    ranked = np.zeros((len(ids), RANKS, 2), np.float32)
    ranked[:, : largest.shape[1], 1] = largest_totals
    ranked[:, : largest.shape[1], 0] = np.where(largest_totals > 0.0, np.take_along_axis(ids, largest, 1), 0).view(
        np.float32
    )
    return ranked


def normalize_coverage(mattes: Floats32, alpha: Floats32) -> Floats32:
    """Return mattes (H, W, 2 n) with coverages scaled so that they sum up to the alpha (H, W) of each pixel.

    A pixel may have alpha but no id, where the asset is small and the matte has few samples. Such a pixel takes the
    pairs of a neighbour.
    """
    scaled = mattes.copy()
    for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
        empty = (scaled[..., 1] == 0.0) & (alpha > 0.0)
        scaled[empty] = np.roll(mattes, step, axis)[empty]
    total = scaled[..., 1::2].sum(axis=-1, dtype=np.float64)
    scaled[..., 1::2] *= (alpha / np.where(total > 0.0, total, 1.0))[..., None]
    return scaled
