"""A surface as a file or a primitive defines it, before normals, tangents and slots are computed."""

from __future__ import annotations

from dataclasses import dataclass

from lookdev.arrays import Floats, Indices, Reals
from lookdev.asset.mesh import Interpolation, Subdivision

MAX_COORDINATE = 1e18
"""The largest coordinate: the product of two larger ones is not a float32."""


@dataclass(frozen=True, eq=False)
class Attribute:
    """A UV set, a primvar or the normals of a shape: values (k,), (k, 2) or (k, 3), with any indices applied.

    There is one value (constant), or one for each face (uniform), point (varying, vertex) or corner (faceVarying) of
    the shape in the file.
    """

    name: str
    values: Reals
    interpolation: Interpolation
    is_uv: bool = False


@dataclass(frozen=True, eq=False)
class PolygonShape:
    """A polygon mesh or control cage in object space.

    points (n, 3) metres; face_sizes (f,); face_points (m,) index into points, counter-clockwise seen from outside, or
    clockwise if `left_handed`. Without `normals`, a shape has those of its facets if it is `flat`, else smooth ones.
    `holes` are the indices of faces that are not part of the surface. `subdivision` indexes these points by its crease
    edges and corners; it has neither holes nor interpolation. `parts` (f,) is the number of the part of each face; each
    part has a material of its own; None means one part. `default_uv` is that of `Mesh`, if such a UV set exists.
    """

    name: str
    points: Floats
    face_sizes: Indices
    face_points: Indices
    attributes: tuple[Attribute, ...] = ()
    normals: Attribute | None = None
    flat: bool = False
    left_handed: bool = False
    holes: Indices | None = None
    subdivision: Subdivision | None = None
    parts: Indices | None = None
    default_uv: str = "st"
