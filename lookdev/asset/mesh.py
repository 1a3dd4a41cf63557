"""Defines an asset: its meshes as plain arrays, their instances and the slots that materials are assigned to.

World space is right-handed, z up, in metres. Everything that varies over the surface is stored per face corner
(Blender's loops, USD's faceVarying), so that a renderer needs no interpolation rules.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from lookdev.arrays import Bools, Floats, Floats32, Indices, Ints32

Scheme = Literal["catmullClark", "loop", "bilinear"]
BoundaryRule = Literal["none", "edgeOnly", "edgeAndCorner"]
FaceVaryingRule = Literal["none", "cornersOnly", "cornersPlus1", "cornersPlus2", "boundaries", "all"]
TriangleRule = Literal["catmullClark", "smooth"]
Interpolation = Literal["constant", "uniform", "varying", "vertex", "faceVarying"]


@dataclass(frozen=True, eq=False)
class Subdivision:
    """The subdivision rules of a mesh, which is then a control cage.

    - scheme, interpolate_boundary, face_varying, triangle_rule: the values of UsdGeom.Mesh's subdivisionScheme,
      interpolateBoundary, faceVaryingLinearInterpolation and triangleSubdivisionRule
    - crease_edges (e, 2), corner_points (c,): the sharp edges and the sharp points, as indices of points
    - crease_sharpness (e,), corner_sharpness (c,): the sharpness of each edge and of each point; 10 is infinite
    - holes (h,): the indices of faces that are refined with the others but are not part of the surface
    - interpolation: from the name of each UV set and primvar to its interpolation; with `faceVarying`, corners with
      equal values at one point share a value: there is no seam between these corners
    """

    scheme: Scheme
    interpolate_boundary: BoundaryRule = "edgeAndCorner"
    face_varying: FaceVaryingRule = "cornersPlus1"
    triangle_rule: TriangleRule = "catmullClark"
    crease_edges: Ints32 = field(default_factory=lambda: np.zeros((0, 2), np.int32))
    crease_sharpness: Floats32 = field(default_factory=lambda: np.zeros(0, np.float32))
    corner_points: Ints32 = field(default_factory=lambda: np.zeros(0, np.int32))
    corner_sharpness: Floats32 = field(default_factory=lambda: np.zeros(0, np.float32))
    holes: Ints32 = field(default_factory=lambda: np.zeros(0, np.int32))
    interpolation: Mapping[str, Interpolation] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Mesh:
    """A polygon mesh in object space.

    - points (n, 3): in metres
    - corner_points (m,): the point of each corner, an index into points
    - face_sizes (f,): the number of corners of each face, at least 3
    - face_slots (f,): the slot of each face, an index into `Asset.slots`
    - normals (m, 3): unit shading normals, on the side from which the winding is counter-clockwise
    - tangents (m, 3): unit vectors orthogonal to the normals, along increasing u of the first UV set or, without one,
      along the longitude about the z axis; None if no exact tangents are known, in which case `tangents_of` computes
      them for the few looks that need tangents
    - uvs: from the name of each UV set to its coordinates (m, 2); (0, 0) is the lower left of a texture
    - primvars: from the name of each primvar to its values (m,) or (m, 3)
    - subdivision: None, or the rules of a control cage, which is refined before it is rendered
    - default_uv: the UV set that is used if the mesh lacks the set that a look reads; "" if there is no such default
    """

    name: str
    points: Floats32
    corner_points: Ints32
    face_sizes: Ints32
    face_slots: Ints32
    normals: Floats32
    tangents: Floats32 | None
    uvs: dict[str, Floats32]
    primvars: dict[str, Floats32] = field(default_factory=dict)
    subdivision: Subdivision | None = None
    default_uv: str = ""

    def with_corners(self, corners: Indices | Bools, face_sizes: Ints32, faces: Indices | Bools) -> Mesh:
        """Return a mesh with other faces, made of corners of this mesh.

        `corners` are indices, or a mask, of the corners of this mesh that become the corners of the new one, in order.
        `face_sizes` (f,) are the numbers of corners of the new faces. `faces` are indices, or a mask, of the f faces of
        this mesh that give their slots to the new faces.
        """
        return replace(
            self,
            corner_points=self.corner_points[corners],
            face_sizes=face_sizes,
            face_slots=self.face_slots[faces],
            normals=self.normals[corners],
            tangents=None if self.tangents is None else self.tangents[corners],
            uvs={name: values[corners] for name, values in self.uvs.items()},
            primvars={name: values[corners] for name, values in self.primvars.items()},
        )


@dataclass(frozen=True, eq=False)
class Instance:
    """A mesh placed in the world: `matrix` (4, 4) maps column vectors of object space to world space.

    `mesh` is an index into `Asset.meshes`. `path` is the path of the prim, which may be inside a USD scene-graph
    instance.
    """

    mesh: int
    matrix: Floats
    path: str = ""


@dataclass(frozen=True)
class Slot:
    """A part of an asset to which one material is assigned.

    `path` is the path of a mesh or GeomSubset, in the first instance if several instances share the slot. `material` is
    the prim path of the material that the asset's file binds to the part, or None if the file binds nothing.
    """

    path: str
    material: str | None = None


@dataclass(frozen=True, eq=False)
class Asset:
    """The geometry of a render. `center` and `radius` describe the smallest sphere around the faces, in metres.

    `convex` is True only if reflected light never meets the surface again. `sheet` is True only if transmitted light
    does not meet the surface again either, as with a flat card; a convex sheet has no indirect light. `revolved` is
    True only if every rotation about the vertical axis through `center` maps the asset, slots included, onto itself.
    `digest` is the SHA-256, in hexadecimal, over all arrays and placements. `unit` is the length in metres of one unit
    of the asset's file. `notes` are lines for the user, for example about content of the file that is not rendered.
    """

    name: str
    meshes: tuple[Mesh, ...]
    instances: tuple[Instance, ...]
    slots: tuple[Slot, ...]
    center: tuple[float, float, float]
    radius: float
    convex: bool = False
    sheet: bool = False
    revolved: bool = False
    digest: str = ""
    unit: float = 1.0
    notes: tuple[str, ...] = ()
