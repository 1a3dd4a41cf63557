"""Random numbers and Owen-scrambled Sobol points on Dr.Jit's arrays of 32-bit integers.

For equal seeds, the points are the same as in `lookdev/shaders/sobol.h`. They are computed, not looked up. Scrambling
follows Laine and Karras 2011 with the constants of Vegdahl 2021. The shuffling of indices follows Burley 2020
("Practical Hash-based Owen Scrambling").
"""

from __future__ import annotations

import drjit as dr

from lookdev.mitsuba.types import Float, UInt


def hash_integers(x: UInt) -> UInt:
    """Return hashed integers, by Wellons' "lowbias32"."""
    x = (x ^ (x >> 16)) * 0x7FEB352D
    x = (x ^ (x >> 15)) * 0x846CA68B
    return x ^ (x >> 16)


def unit_float(kind: type[Float], x: UInt) -> Float:
    """Return the upper 24 bits of integers as numbers in [0, 1), of the float type `kind`."""
    return kind(x >> 8) * (1.0 / 16777216.0)


def random(kind: type[Float], seed: UInt) -> Float:
    """Return a random number in [0, 1) for each seed."""
    return unit_float(kind, hash_integers(seed))


def points(kind: type[Float], index: UInt, seed: UInt) -> tuple[Float, Float]:
    """Return the point with an index in the sequence that a seed scrambles: two numbers in [0, 1).

    Let i be the shuffled index. Let p be the product of the second generator matrix, which is Pascal's triangle modulo
    2, and the bits of i. Before the scrambling, the first coordinate has the bits of i in reverse order, and the second
    coordinate has the bits of p in reverse order.
    """
    i = dr.brev(_laine_karras(dr.brev(index), seed))
    p = i ^ (i >> 16)
    p ^= (p >> 8) & 0x00FF00FF
    p ^= (p >> 4) & 0x0F0F0F0F
    p ^= (p >> 2) & 0x33333333
    p ^= (p >> 1) & 0x55555555
    return (
        unit_float(kind, dr.brev(_laine_karras(i, hash_integers(seed + 1)))),
        unit_float(kind, dr.brev(_laine_karras(p, hash_integers(seed + 2)))),
    )


def _laine_karras(x: UInt, seed: UInt) -> UInt:
    """Permute integers at random: whether a bit is flipped depends only on the bits below it."""
    x = (x ^ (x * 0x3D20ADEA)) + seed
    x *= (seed >> 16) | 1
    x ^= x * 0x05526C56
    return x ^ (x * 0x53A22864)
