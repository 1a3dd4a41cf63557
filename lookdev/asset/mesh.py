"""Geometry as plain arrays.

World space is right-handed, z up, in metres. Everything that varies over the surface is stored per face corner (the
loops of a polygon mesh), so that a renderer needs no interpolation rule.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Mesh:
    """One polygon mesh in its own object space.

    points (n, 3) metres; corner_points (m,) index into points; face_sizes (f,) corners of each face, at least 3;
    face_slots (f,) index into `Asset.slots`; normals (m, 3) unit shading normals, on the side from which the winding
    is counter-clockwise; tangents (m, 3) unit, along increasing u of the first UV set, orthogonal to the normal; uvs:
    UV set name to (m, 2), never empty, (0, 0) lower left; primvars: name to (m,) or (m, 3).
    """

    name: str
    points: Floats
    corner_points: Ints
    face_sizes: Ints
    face_slots: Ints
    normals: Floats
    tangents: Floats
    uvs: dict[str, Floats]
    primvars: dict[str, Floats] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Instance:
    """A mesh placed in the world: `matrix` (4, 4) maps column vectors of object space to world space."""

    mesh: int
    matrix: NDArray[np.float64]


@dataclass(frozen=True)
class Slot:
    """A part of an asset that takes one material: the path of a mesh or GeomSubset.

    `material` is the prim path of the bound material in the asset's own file, or None where nothing is bound.
    """

    path: str
    material: str | None = None


@dataclass(frozen=True, eq=False)
class Asset:
    """What is turned. `center` and `radius` are the bounding sphere in world space, in metres.

    `convex` is True only where reflected light never meets the surface again, `sheet` only where transmitted light does
    not either, as with a flat card; such an asset has no indirect light. `revolved` is True only where turning about
    the vertical through `center` moves it, slots included, onto itself. `digest` is the SHA-256 over all arrays and
    placements.
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
