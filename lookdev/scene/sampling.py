"""How much work a frame gets."""

from __future__ import annotations

from dataclasses import dataclass

SAMPLE_CAP = 4096
"""Samples per pixel at which a frame with a target error stops, unless another number is given."""


@dataclass(frozen=True)
class Sampling:
    """How much work a frame gets.

    `samples` is per pixel over both halves, even. With `error` set, rounds of growing size are added until the
    estimated relMSE is at most `error` or `samples` is reached. `bounces` are indirect. Directions per shading point,
    `brdf_samples` and `ibl_samples`, are chosen for the look where they are None.
    """

    samples: int = 64
    error: float | None = None
    brdf_samples: int | None = None
    ibl_samples: int | None = None
    bounces: int = 2
    seed: int = 0
