"""How much work a frame gets."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Sampling:
    """How much work a frame gets.

    `samples` is per pixel over both halves, even. With `error` set, rounds of growing size are added until the
    estimated relMSE is at most `error` or `samples` is reached. Directions a shading point, `brdf_samples` and
    `ibl_samples`, are chosen for the look where they are None.
    """

    samples: int
    error: float | None
    brdf_samples: int | None
    ibl_samples: int | None
    bounces: int
    seed: int
