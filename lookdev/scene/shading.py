"""The shading frame at a point of a surface, on the viewer's side; `lookdev.codegen` traces it into OSL and nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lookdev.brdf.vectors import Array, Real, cross, dot, perpendicular, scale, vector

MIN_COSINE = 1e-4
"""The least cosine between a normal and the direction to the viewer; `shading_frame` bends other normals."""

LIFT = 1e-6
"""The height above the surface at which a ray starts, relative to the largest coordinate of its point and triangle.

Coincident surfaces, which are frequent in real assets, therefore shade as one surface. The height is 16 times the
rounding of a coordinate to float32, because three things are rounded: the point, its triangle, and the coincident
surface.
"""


@dataclass(frozen=True)
class ShadingFrame:
    """An orthonormal frame on the viewer's side of a surface: unit vectors (..., 3) in the world.

    `normal` is the shading normal, `facet` the normal of the triangle.
    """

    tangent: Array
    bitangent: Array
    normal: Array
    facet: Array

    def to_local(self, w: Array) -> Array:
        """Express world directions (..., 3) in the frame."""
        return vector(dot(w, self.tangent), dot(w, self.bitangent), dot(w, self.normal))


def shading_frame(normal: Array, tangent: Array | None, facet: Array, viewer: Array, hand: Real = 1.0) -> ShadingFrame:
    """Return the frame in which a BSDF is evaluated.

    If the viewer is behind the surface, normal, tangent and bitangent change sign together, so that a bump seen from
    behind is a dent, and a thin surface looks the same from both sides. An interpolated normal that points away from
    the viewer is bent towards the viewer, until its cosine is `MIN_COSINE`.

    Parameters
    ----------
    normal, tangent : (..., 3)
        The vectors that are interpolated over the mesh, in the world. The normal has unit length. Without a tangent an
        arbitrary one is used, for isotropic BSDFs.
    facet, viewer : (..., 3)
        The unit normal of the triangle, and the unit direction to the viewer.
    hand : (...)
        -1 if the instance's matrix mirrors, which flips the bitangent; else 1.
    """
    facet = scale(facet, np.where(dot(facet, viewer) < 0.0, -1.0, 1.0))
    side = np.where(dot(normal, facet) < 0.0, -1.0, 1.0)
    n = scale(normal, side)
    lean = dot(n, viewer)  # the cosine between the normal and the viewer
    bent = _unit(n + scale(viewer, MIN_COSINE - lean))
    n = np.where(np.expand_dims(lean < MIN_COSINE, -1), bent, n)
    if tangent is None:
        t = perpendicular(n)
    else:
        t = scale(tangent, side)
        t = _unit(t - scale(n, dot(t, n)))
    return ShadingFrame(t, scale(cross(n, t), side * hand), n, facet)


def _unit(v: Array) -> Array:
    # The division rounds like OSL's normalize(). Results must agree exactly, because the next point of a path seeds its
    # random numbers.
    return v / np.expand_dims(np.sqrt(dot(v, v)), -1)
