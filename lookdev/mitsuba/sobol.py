"""Owen-scrambled Sobol points, computed, as in `lookdev/shaders/sobol.h`: the same points of the same seeds.

Scrambling follows Laine and Karras 2011 with the constants of Vegdahl 2021, index shuffling Burley 2020 ("Practical
Hash-based Owen Scrambling").
"""

from __future__ import annotations

from typing import Any

import drjit as dr


def reverse(x: Any) -> Any:
    """Reverse the bits of 32-bit integers."""
    return dr.brev(x)


def hashed(x: Any) -> Any:
    """Return Wellons' "lowbias32" of integers."""
    x = (x ^ (x >> 16)) * 0x7FEB352D
    x = (x ^ (x >> 15)) * 0x846CA68B
    return x ^ (x >> 16)


def unit(kind: type, x: Any) -> Any:
    """Return 24 bits of integers as numbers in [0, 1)."""
    return kind(x >> 8) * (1.0 / 16777216.0)


def points(kind: type, index: Any, seed: Any) -> tuple[Any, Any]:
    """Return the point of an index of the sequence that a seed scrambles: two numbers in [0, 1)."""
    i = reverse(_laine_karras(reverse(index), seed))
    p = i ^ (i >> 16)
    p ^= (p >> 8) & 0x00FF00FF
    p ^= (p >> 4) & 0x0F0F0F0F
    p ^= (p >> 2) & 0x33333333
    p ^= (p >> 1) & 0x55555555
    return (
        unit(kind, reverse(_laine_karras(i, hashed(seed + 1)))),
        unit(kind, reverse(_laine_karras(p, hashed(seed + 2)))),
    )


def _laine_karras(x: Any, seed: Any) -> Any:
    """Permute at random: a bit is flipped depending on the bits below it only."""
    x = (x ^ (x * 0x3D20ADEA)) + seed
    x *= (seed >> 16) | 1
    x ^= x * 0x05526C56
    return x ^ (x * 0x53A22864)
