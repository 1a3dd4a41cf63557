"""The sampling of a frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

SAMPLE_CAP = 4096
"""Default of the most samples per pixel of a frame with a target error."""


@dataclass(frozen=True)
class Sampling:
    """Samples, directions and bounces of a frame.

    With `error` set, rounds of growing size are added until the estimated relMSE is at most `error` or `samples` is
    reached. Directions per shading point, `brdf_samples` and `ibl_samples`, depend on the look where they are None.
    """

    samples: int = 64  # per pixel over both halves, even
    error: float | None = None
    brdf_samples: int | None = None
    ibl_samples: int | None = None
    bounces: int = 2  # indirect
    seed: int = 0
    denoise: Literal["off", "measured"] = "off"  # after which its error is measured again
    passes: tuple[str, ...] = ()  # besides the beauty, of `lookdev.rendering.passes`

    @property
    def features(self) -> bool:
        """Whether shaders can show albedos and normals."""
        return self.denoise != "off" or bool(self.passes)

    @property
    def recorded(self) -> bool:
        """Whether shaders can record parts of their light."""
        return not {"lobes", "direct", "lights"}.isdisjoint(self.passes)
