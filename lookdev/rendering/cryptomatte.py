"""Cryptomatte: the coverage of each of many named things in a pixel.

- Friedman, J. and Jones, A. 2015. Fully Automatic ID Mattes with Support for Motion Blur and Transparency. SIGGRAPH
  Posters. The specification, version 1.2, is by Psyop.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

RANKS = 6
"""Things of a pixel that are kept, those of most coverage: two of them are the four channels of a layer."""


def matte_samples(samples: int) -> int:
    """Return how many samples the mattes of a frame take: half of its own, a power of two, 16 to 4096."""
    return min(max(16, 1 << (samples // 2 - 1).bit_length()), 4096)


def murmur3(text: str) -> int:
    """Return MurmurHash3_x86_32 of a text's UTF-8, with seed 0 (Appleby 2011)."""
    data = text.encode()
    whole = len(data) // 4
    value = 0
    for (block,) in struct.iter_unpack("<I", data[: 4 * whole]):
        value = (_turned(value ^ _mixed(block), 13) * 5 + 0xE6546B64) & 0xFFFFFFFF
    value ^= _mixed(int.from_bytes(data[4 * whole :], "little")) ^ len(data)
    value = ((value ^ value >> 16) * 0x85EBCA6B) & 0xFFFFFFFF
    value = ((value ^ value >> 13) * 0xC2B2AE35) & 0xFFFFFFFF
    return value ^ value >> 16


def _mixed(block: int) -> int:
    return (_turned(block * 0xCC9E2D51 & 0xFFFFFFFF, 15) * 0x1B873593) & 0xFFFFFFFF


def _turned(value: int, by: int) -> int:
    return (value << by | value >> 32 - by) & 0xFFFFFFFF


def matte_id(name: str) -> int:
    """Return the bits of the float32 that stands for a name, which is finite and not subnormal."""
    value = murmur3(name)
    return value ^ 1 << 23 if value >> 23 & 255 in (0, 255) else value


def matte_header(matte: str, names: Iterable[str]) -> dict[str, str]:
    """Return the attributes of an EXR that has a matte, and the names in it."""
    key = f"cryptomatte/{murmur3(matte):08x}"[: len("cryptomatte/") + 7]
    manifest = {name: f"{matte_id(name):08x}" for name in sorted(names)}
    return {
        f"{key}/name": matte,
        f"{key}/hash": "MurmurHash3_32",
        f"{key}/conversion": "uint32_to_float32",
        f"{key}/manifest": json.dumps(manifest, separators=(",", ":")),
    }


def renamed(mattes: Floats, names: Mapping[str, str]) -> Floats:
    """Return mattes with other names, of which several things may have one; other things are left out.

    mattes : (H, W, 2 n), the id and the coverage of a pixel's things; returned with `RANKS` of them, the largest first.
    """
    old = np.array([matte_id(name) for name in names], np.uint32)
    new = np.array([matte_id(name) for name in names.values()], np.uint32)
    order = np.argsort(old)
    old, new = old[order], new[order]
    deepest = np.flatnonzero(mattes[..., 1::2].any(axis=(0, 1))).max(initial=0) + 1
    bits = np.ascontiguousarray(mattes[..., 0 : 2 * deepest : 2]).view(np.uint32)
    coverage = mattes[..., 1 : 2 * deepest : 2]
    place = np.minimum(np.searchsorted(old, bits), len(old) - 1)
    known = (old[place] == bits) & (coverage > 0.0)
    ids, coverage = np.where(known, new[place], 0), np.where(known, coverage, np.float32(0.0))
    shown = np.zeros((*known.shape[:2], RANKS, 2), np.float32)
    # Most pixels show one thing, or none.
    most = np.argmax(coverage, axis=-1)[..., None]
    shown[..., 0, 0] = np.take_along_axis(ids, most, -1)[..., 0].view(np.float32)
    shown[..., 0, 1] = np.take_along_axis(coverage, most, -1)[..., 0]
    several = np.count_nonzero(known, axis=-1) > 1
    shown[several] = _summed(ids[several], coverage[several])
    return shown.reshape(*known.shape[:2], 2 * RANKS)


def _summed(ids: NDArray[np.uint32], coverage: Floats) -> Floats:
    """Return ids and coverages (P, `RANKS`, 2), the largest first, with those of equal ids (P, n) summed up."""
    order = np.argsort(ids, axis=1, kind="stable")
    ids, coverage = np.take_along_axis(ids, order, 1), np.take_along_axis(coverage, order, 1)
    # Of equal ids the last has the sum of all.
    sums = coverage.cumsum(axis=1, dtype=np.float64)
    last = np.concatenate([ids[:, 1:] != ids[:, :-1], np.ones((len(ids), 1), bool)], axis=1)
    before = np.maximum.accumulate(np.where(last, sums, 0.0), axis=1)
    before = np.concatenate([np.zeros((len(ids), 1)), before[:, :-1]], axis=1)
    total = np.where(last & (ids != 0), sums - before, 0.0)
    most = np.argsort(-total, axis=1, kind="stable")[:, :RANKS]
    kept = np.take_along_axis(total, most, 1).astype(np.float32)
    shown = np.zeros((len(ids), RANKS, 2), np.float32)
    shown[:, : most.shape[1], 1] = kept
    shown[:, : most.shape[1], 0] = np.where(kept > 0.0, np.take_along_axis(ids, most, 1), 0).view(np.float32)
    return shown


def filled(mattes: Floats, alpha: Floats) -> Floats:
    """Return mattes (H, W, 2 n) of which the coverage of a pixel sums up to its alpha (H, W).

    A pixel that shows so little that no matte has it takes the things of a neighbour.
    """
    scaled = mattes.copy()
    for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
        empty = (scaled[..., 1] == 0.0) & (alpha > 0.0)
        scaled[empty] = np.roll(mattes, step, axis)[empty]
    total = scaled[..., 1::2].sum(axis=-1, dtype=np.float64)
    scaled[..., 1::2] *= (alpha / np.where(total > 0.0, total, 1.0))[..., None]
    return scaled
