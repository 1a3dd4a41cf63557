"""The sampling of a frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

SAMPLE_CAP = 4096
"""The default limit of samples per pixel for a frame with a target error."""


@dataclass(frozen=True)
class Sampling:
    """Samples, directions and bounces of a frame.

    If `error` is set, rounds of growing size are added until the estimated relMSE is at most `error`, or `samples` is
    reached. `brdf_samples` and `ibl_samples` are directions per shading point; they depend on the look if None.
    """

    samples: int = 64  # per pixel over both halves, even
    error: float | None = None
    brdf_samples: int | None = None
    ibl_samples: int | None = None
    bounces: int = 2  # indirect
    seed: int = 0
    denoise: Literal["off", "measured"] = "off"  # "measured": denoise, and measure the error again
    passes: tuple[str, ...] = ()  # of `lookdev.rendering.passes`, in addition to the beauty pass

    @property
    def features(self) -> bool:
        """Whether shaders output albedos and normals."""
        return self.denoise != "off" or bool(self.passes)

    @property
    def recorded(self) -> bool:
        """Whether shaders record parts of their light."""
        return not {"lobes", "direct", "lights"}.isdisjoint(self.passes)
