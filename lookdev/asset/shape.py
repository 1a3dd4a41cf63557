"""A surface as a file or a primitive has it, before normals, tangents and slots are computed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.asset.mesh import Interpolation, Subdivision

Doubles = NDArray[np.float64]
Index = NDArray[np.intp]

LARGEST = 1e18
"""The largest coordinate: the product of two larger ones is not a float32."""


@dataclass(frozen=True, eq=False)
class Attribute:
    """A UV set, a primvar or the normals of a shape: values (k,), (k, 2) or (k, 3), with any indices applied.

    There is one value (constant), or one for each face (uniform), point (varying, vertex) or corner (faceVarying) of
    the shape as it is in the file.
    """

    name: str
    values: NDArray[Any]
    interpolation: Interpolation
    is_uv: bool = False


@dataclass(frozen=True, eq=False)
class Shape:
    """A polygon mesh or control cage in its own object space.

    points (n, 3) metres; face_sizes (f,); face_points (m,) index into points, counter-clockwise seen from outside, or
    clockwise where `left_handed`. Without `normals`, those of a shape that is `flat` are its facets', any other's are
    smooth. Faces in `holes` are not shown. `subdivision` has crease edges and corners by the numbers of these points,
    and neither holes nor interpolation. `parts` (f,) numbers the parts of the surface that take a material each, by
    default one. `default_uv` is that of `Mesh`, where there is such a UV set.
    """

    name: str
    points: Doubles
    face_sizes: Index
    face_points: Index
    attributes: tuple[Attribute, ...] = ()
    normals: Attribute | None = None
    flat: bool = False
    left_handed: bool = False
    holes: Index | None = None
    subdivision: Subdivision | None = None
    parts: Index | None = None
    default_uv: str = "st"
