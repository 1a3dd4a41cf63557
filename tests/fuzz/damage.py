"""Damages of the bytes of a file, of whatever format."""

import random
from collections.abc import Callable

Damage = Callable[[bytes, random.Random], bytes]


def truncate(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(1, len(data))]


def replace_by_noise(data: bytes, rng: random.Random) -> bytes:
    """Return noise behind the first bytes, which name the format."""
    return data[:8] + rng.randbytes(len(data))


def append_noise(data: bytes, rng: random.Random) -> bytes:
    return data + rng.randbytes(50)


def flip_bits(start: float = 0.0, bits: int = 8) -> Damage:
    """Return a damage of some bytes behind a part of the file, each in one of its lower bits."""

    def flip(data: bytes, rng: random.Random) -> bytes:
        damaged = bytearray(data)
        for _ in range(rng.choice((1, 1, 4, 30))):
            damaged[rng.randrange(int(start * len(data)), len(data))] ^= 1 << rng.randrange(bits)
        return bytes(damaged)

    return flip
