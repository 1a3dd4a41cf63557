"""The frame of a lobe: directions in it are relative to the lobe's normal, which may differ from the shading normal.

The shading frame has the axes tangent, bitangent and shading normal.

- Duff, T. et al. 2017. Building an Orthonormal Basis, Revisited. JCGT 6(1).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.vectors import Array, are_equal, dot, normalize, scale, vector

ZENITH: Floats = np.array([0.0, 0.0, 1.0])
"""The shading normal in its own frame."""

_MIN_NORMAL_Z = 0.01  # the least z of a normal map, before it is normalized
_MIN_VIEW_COSINE = 1e-4  # frames are bent until view and normal have at least this cosine


@dataclass(frozen=True)
class UprightFrame:
    """The frame of a lobe whose normal is the shading normal: the shading frame itself."""

    normal: ClassVar[Array] = ZENITH
    """The unit z axis of the frame, (..., 3), above the horizon of the shading frame."""

    def to_local(self, w: Array) -> Array:
        """Express directions (..., 3) of the shading frame in this frame."""
        return w

    def from_local(self, w: Array) -> Array:
        """Express directions (..., 3) of this frame in the shading frame."""
        return w

    def bend_towards(self, wo: Array) -> UprightFrame:
        """Return the frame with its normal bent until ``normal . wo`` is positive.

        `wo` (..., 3) are unit directions to the viewer, above the horizon of the shading frame.
        """
        return self


@dataclass(frozen=True, eq=False)
class TiltedFrame:
    """The frame about another unit normal (..., 3); its methods are those of `UprightFrame`."""

    normal: Array

    def to_local(self, w: Array) -> Array:
        tangent, bitangent = self._axes()
        return vector(dot(tangent, w), dot(bitangent, w), dot(self.normal, w))

    def from_local(self, w: Array) -> Array:
        tangent, bitangent = self._axes()
        return scale(tangent, w[..., 0]) + scale(bitangent, w[..., 1]) + scale(self.normal, w[..., 2])

    def bend_towards(self, wo: Array) -> TiltedFrame:
        cosine = dot(self.normal, wo)
        bent_normal = self.normal + scale(wo, np.maximum(np.minimum(wo[..., 2], _MIN_VIEW_COSINE) - cosine, 0.0))
        return TiltedFrame(normalize(bent_normal))

    # Duff et al. 2017, listing 3, for z > -1.
    def _axes(self) -> tuple[Array, Array]:
        """Return tangent and bitangent; if the normal is the zenith, they are exactly the axes of the shading frame."""
        x, y = self.normal[..., 0], self.normal[..., 1]
        a = -1.0 / (1.0 + self.normal[..., 2])
        b = x * y * a
        return vector(1.0 + x * x * a, b, -x), vector(b, 1.0 + y * y * a, -y)


Frame: TypeAlias = UprightFrame | TiltedFrame


def frame_of(normal_map: Array) -> Frame:
    """Return the frame about a normal (..., 3) of any length, such as that of a normal map.

    The normal's z is raised to at least 0.01.
    """
    normal = normalize(vector(normal_map[..., 0], normal_map[..., 1], np.maximum(normal_map[..., 2], _MIN_NORMAL_Z)))
    return UprightFrame() if are_equal(normal, ZENITH) else TiltedFrame(normal)


def mirror_across_surface(w: Array) -> Array:
    """Mirror directions (..., 3) across the plane of the surface."""
    return vector(w[..., 0], w[..., 1], -w[..., 2])
