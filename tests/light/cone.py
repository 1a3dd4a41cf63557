"""A complete, minimal kind of light: a cone of directions with one radiance.

``python cone.py`` is a render worker that has the kind in its registry.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lookdev.arrays import Bools, Floats
from lookdev.light import LIGHT_KINDS, Emission
from lookdev.light.base import CodedLight, LightCode, LightKind
from lookdev.light.emission import WHITE


@dataclass(frozen=True)
class Cone(CodedLight):
    """Radiance `color` from directions whose cosine to the unit vector `axis`, not vertical, is above `cosine`."""

    kind = "cone"

    axis: tuple[float, float, float]
    cosine: float
    color: tuple[float, float, float]
    emission: Emission = WHITE

    def radiance(self, point: Floats, direction: Floats) -> Floats:
        return np.where(self._is_inside(direction)[..., None], self.color, 0.0)

    def pdf(self, point: Floats, direction: Floats) -> Floats:
        return np.where(self._is_inside(direction), 0.5 / (np.pi * (1.0 - self.cosine)), 0.0)

    def sample(self, point: Floats, u: Floats) -> Floats:
        across = np.cross(self.axis, (0.0, 0.0, 1.0))
        across /= np.linalg.norm(across)
        frame = np.stack([across, np.cross(self.axis, across), self.axis])
        cosine, angle = 1.0 - u[:, 0] * (1.0 - self.cosine), 2.0 * np.pi * u[:, 1]
        sine = np.sqrt(1.0 - cosine * cosine)
        return np.stack([sine * np.cos(angle), sine * np.sin(angle), cosine], axis=-1) @ frame

    def code(self, *, sampled: bool) -> LightCode:
        values = {**dict(zip("XYZ", self.axis, strict=True)), "COSINE": self.cosine, "RADIANCE": f"color{self.color}"}
        return LightCode(tuple(f"#define CONE_{name} {value}" for name, value in values.items()))

    def _is_inside(self, direction: Floats) -> Bools:
        return direction @ np.array(self.axis) > self.cosine


CONE = LightKind(Cone, lambda: Cone((0.48, -0.6, 0.64), 0.7, (3.0, 2.0, 1.0)), osl=Path(__file__).with_suffix(".osl.h"))

if __name__ == "__main__":
    from lookdev.cycles.__main__ import main

    LIGHT_KINDS["cone"] = CONE
    main()
