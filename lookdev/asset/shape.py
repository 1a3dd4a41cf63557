"""Defines a shape: a surface as a file or a primitive defines it, which `finish` converts to a mesh.

The normals, tangents and slots of a mesh are computed from its shape.
"""

from __future__ import annotations

from dataclasses import dataclass

from lookdev.arrays import Floats, Indices, Reals
from lookdev.asset.mesh import Interpolation, Subdivision

MAX_COORDINATE = 1e18
"""The largest magnitude of a coordinate: the product of two such numbers is still in the range of float32."""


@dataclass(frozen=True, eq=False)
class Attribute:
    """A UV set, a primvar or the normals of a shape: values (k,), (k, 2) or (k, 3), not indexed.

    By its interpolation, an attribute has one value (constant), or one value for each face (uniform), point (varying,
    vertex) or corner (faceVarying) of the shape, valid or not.
    """

    name: str
    values: Reals
    interpolation: Interpolation
    is_uv: bool = False


@dataclass(frozen=True, eq=False)
class PolygonShape:
    """A polygon mesh or control cage in object space.

    - points (n, 3): in metres
    - face_sizes (f,): the number of corners of each face
    - face_points (m,): the point of each corner, an index into points; the corners of a face are counter-clockwise when
      seen from outside, or clockwise if `left_handed`
    - attributes: UV sets and primvars
    - normals: the authored normals, or None; a shape without authored normals gets the normals of its facets if it is
      `flat`, and smooth normals otherwise
    - holes: the indices of faces that are not part of the surface, or None
    - subdivision: the rules of a control cage; its crease edges and corners index into points; its `holes` and
      `interpolation` are empty
    - face_parts (f,): the number of the part that each face belongs to; each part can have a material of its own; None
      means that there is one part, 0
    - default_uv: becomes `Mesh.default_uv` if the shape has such a UV set
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
    face_parts: Indices | None = None
    default_uv: str = "st"
