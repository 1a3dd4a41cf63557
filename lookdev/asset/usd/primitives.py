"""Makes meshes of UsdGeom's primitives: Cube, Sphere, Cylinder, Cone, Capsule, Plane, Cylinder_1 and Capsule_1.

Points lie on the surface, normals are exact and change only at true edges, and all faces are planar. A surface has one
face along a direction in which it is straight; a tapered side has several.

The texture coordinates ``st`` fill the unit square and are never mirrored. Around an axis, u is 0 in the direction of
the next coordinate axis: x for the axis z, y for x, and z for y. From there, u grows counter-clockwise for a viewer
towards whom the axis points. v grows along the axis: on a sphere with the latitude, on a capsule with the length of its
profile, on the side of a cylinder or cone from 0 at the lower end to 1 at the upper end. A cap is a disc in the unit
square. Each face of a cube fills the unit square; on the four sides, v grows along the stage's up axis. On a plane, u
grows along the width and v along the length. If the width or the length lies along z, the coordinate grows towards -z.

The side of a Capsule_1 is tangent to both of its spheres, as its schema requires. In Hydra, the surface has an edge
there, since Hydra uses `atan` instead of `asin`.

A surface is computed with its largest size scaled to 1, so that surfaces of equal proportions share arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from pxr import Usd, UsdGeom

from lookdev.arrays import Floats, Indices
from lookdev.asset.shape import Attribute, PolygonShape
from lookdev.asset.usd.attributes import read_number, read_token

# By axis: the shift of `np.roll` that turns (x, y, z) of a surface about the z axis into a surface about this axis.
_AXIS_ROLLS = {"X": 1, "Y": 2, "Z": 0}
# The directions of u and v on a plane, by its axis.
_PLANE_AXES = {"X": ((0, 0, -1), (0, 1, 0)), "Y": ((1, 0, 0), (0, 0, -1)), "Z": ((1, 0, 0), (0, 1, 0))}
MIN_ERROR, _MAX_ERROR = 1e-4, 0.03  # the bounds of the error in `primitive_shape`
_MAX_FACES = 4_000_000  # of all curved surfaces of an asset, approximately
_TAPER_ROWS = 16  # rows of faces on a tapered side: `st` is linear over a triangle, but not over a cone

PrimitiveKey = tuple[str, str, *tuple[float, ...]]
"""The type of a primitive, its axis, and its sizes in the stage's unit, in the order of `_BUILDERS`."""


def primitive_shape(prim: Usd.Prim, time: Usd.TimeCode, unit: float, error: float = MIN_ERROR) -> PolygonShape:
    """Return a primitive at `time` as a shape in metres; `unit` is the length of the stage's unit in metres.

    `error` bounds the distance between the faces and the curved surface, relative to the surface's radius, and so the
    error of any silhouette. A sphere has 49,928 faces for an error of 1e-4 and 5,000 for 1e-3. A surface without area,
    because a size is 0, has no faces.

    Raises
    ------
    AssetError
        A size is negative or not a number, or the axis is invalid.
    """
    surface, size = proportions(primitive_key(prim, time), error)
    return _scaled_shape(str(prim.GetPath()), _unit_surface(*surface), size * unit)


def proportions(key: PrimitiveKey, error: float) -> tuple[tuple[str, str, int, *tuple[float, ...]], float]:
    """Return the parameters of a primitive whose sizes are divided by the largest size, and the largest size.

    The parameters are the type, the axis, the number of segments around the axis, which `error` determines, and the
    divided sizes. If all sizes are 0, they are not divided.
    """
    type_name, axis, *sizes = key
    size = max(sizes)
    relative_sizes = (length / size if size > 0.0 else length for length in sizes)
    return (type_name, axis, _segment_count(error), *relative_sizes), size


def sphere_shape(name: str, radius: float, error: float = MIN_ERROR) -> PolygonShape:
    """Return a sphere at the origin, with radius and points in one unit, and with the error of `primitive_shape`."""
    return _scaled_shape(name, _unit_surface("Sphere", "Z", _segment_count(error), 1.0), radius)


@lru_cache(maxsize=256)
def _unit_surface(type_name: str, axis: str, segments: int, *sizes: float) -> _Surface:
    """Return the surface with the parameters that `proportions` returns; equal parameters share its arrays."""
    build, _ = _BUILDERS[type_name]
    return build(axis, segments, *sizes) or _Surface.empty()


def _scaled_shape(name: str, surface: _Surface, scale: float) -> PolygonShape:
    """Return a surface as a shape, scaled by a factor."""
    return PolygonShape(
        name=name,
        points=surface.points * scale,
        face_sizes=surface.face_sizes,
        face_points=surface.face_points,
        attributes=(Attribute("st", surface.st, "faceVarying", is_uv=True),),
        normals=Attribute("normals", surface.normals, "faceVarying"),
    )


def primitive_key(prim: Usd.Prim, time: Usd.TimeCode) -> PrimitiveKey:
    """Return the parameters of a primitive at `time`, which are equal for prims that can share a mesh.

    The axis of a cube is the stage's up axis, along which v grows. Raises AssetError as `primitive_shape` does.
    """
    type_name = prim.GetTypeName()
    if type_name == "Cube":
        axis = UsdGeom.GetStageUpAxis(prim.GetStage())
    elif type_name == "Sphere":
        axis = "Z"
    else:
        axis = read_token(prim, "axis", time, tuple(_AXIS_ROLLS))
    return type_name, axis, *(read_number(prim, name, time, 0.0) for name in _BUILDERS[type_name][1])


def surface_errors(radii: Floats) -> Floats:
    """Return the relative error (k,) of each distinct curved surface of an asset; `radii` (k,) are in world space.

    The radii are positive. The error is 1e-4 for up to about eighty surfaces. For more, the absolute error is the same
    for all surfaces, so that together they have about four million faces. The relative error is then at most 0.03, for
    which a sphere has 200 faces.
    """
    # A sphere has pi^2 / (2 error) faces, where the error is relative.
    absolute_error = 0.5 * np.pi**2 * radii.sum() / _MAX_FACES
    return np.asarray(np.clip(absolute_error / radii, MIN_ERROR, _MAX_ERROR))


def _segment_count(error: float) -> int:
    """Return the number n of segments around an axis for a relative error, a multiple of 4.

    A face of a sphere lies between two meridians and two parallels, which are 2 pi / n apart. The middle of the face is
    at cos(pi / n)^2 of the radius from the centre. For a cylinder it is at cos(pi / n), which is nearer to the surface.
    """
    return 4 * int(np.ceil(np.pi / np.arcsin(np.sqrt(error)) / 4.0))


@dataclass(frozen=True, eq=False)
class _Surface:
    """A mesh of a primitive.

    - points (n, 3): positions
    - face_sizes (f,): the number of corners of each face
    - face_points (m,): the point at each corner
    - normals (m, 3), st (m, 2): unit normals and texture coordinates at the corners
    """

    points: Floats
    face_sizes: Indices
    face_points: Indices
    normals: Floats
    st: Floats

    @classmethod
    def empty(cls) -> _Surface:
        """Return a surface without faces."""
        none = np.zeros(0, np.intp)
        return cls(np.zeros((0, 3)), none, none, np.zeros((0, 3)), np.zeros((0, 2)))


# Each of the functions that make a surface returns None if the surface has no area.


def _make_cube(axis: str, segments: int, size: float) -> _Surface | None:
    """Return a cube with edges of length `size`; `segments` is not used."""
    if size == 0.0:
        return None
    # The directions of u and v on each face of a cube with the axis z: four sides, top, bottom.
    along = np.array([[0, 1, 0], [-1, 0, 0], [0, -1, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0]])
    up = np.array([[0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 1, 0], [0, -1, 0]])
    u, v = (np.roll(0.5 * size * directions, _AXIS_ROLLS[axis], axis=1) for directions in (along, up))
    return _make_rectangles(u, v, np.cross(u, v) / (0.5 * size))


def _make_plane(axis: str, segments: int, width: float, length: float) -> _Surface | None:
    """Return a rectangle perpendicular to the axis; `segments` is not used."""
    if width == 0.0 or length == 0.0:
        return None
    u, v = 0.5 * np.array([[width], [length]]) * np.array(_PLANE_AXES[axis])
    return _make_rectangles(u[None], v[None], np.zeros((1, 3)))


def _make_rectangles(u: Floats, v: Floats, centers: Floats) -> _Surface:
    """Return f rectangles; `u` and `v` (f, 3) are vectors from the centres (f, 3) to the middles of two sides."""
    st = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    s, t = (2.0 * st - 1.0).T[..., None]
    corners = (centers[:, None] + s * u[:, None] + t * v[:, None]).reshape(-1, 3)
    points, index = np.unique(corners, axis=0, return_inverse=True)
    normals = np.cross(u / np.linalg.norm(u, axis=1, keepdims=True), v / np.linalg.norm(v, axis=1, keepdims=True))
    return _Surface(points, np.full(len(u), 4), index.ravel(), np.repeat(normals, 4, axis=0), np.tile(st, (len(u), 1)))


@dataclass(frozen=True, eq=False)
class _Piece:
    """A smooth part of a profile of a surface of revolution.

    - points (k, 2): radius and height, with the outside on the right of the profile's direction
    - normals (k, 2): unit normals, as radial and axial components
    - v (k,): the texture coordinate v, or None for a cap, which is mapped as a disc
    """

    points: Floats
    normals: Floats
    v: Floats | None = None


def _make_frustum(axis: str, segments: int, bottom: float, top: float, height: float) -> _Surface | None:
    """Return a cylinder, a cone or a truncated cone, with its caps, from its radii at the bottom and the top."""
    if height == 0.0 or bottom == top == 0.0:
        return None
    v = np.linspace(0.0, 1.0, 2 if bottom == top else _TAPER_ROWS + 1)
    side = np.stack([(1.0 - v) * bottom + v * top, (v - 0.5) * height], axis=-1)
    normal = np.array([height, bottom - top]) / np.hypot(height, bottom - top)
    pieces = [
        _Piece(np.array([[0.0, -0.5 * height], [bottom, -0.5 * height]]), np.array([[0.0, -1.0]] * 2)),
        _Piece(side, np.tile(normal, (len(v), 1)), v),
        _Piece(np.array([[top, 0.5 * height], [0.0, 0.5 * height]]), np.array([[0.0, 1.0]] * 2)),
    ]
    return _revolve(pieces[bottom == 0.0 : 2 + (top > 0.0)], axis, segments)


def _make_capsule(axis: str, segments: int, bottom: float, top: float, height: float) -> _Surface | None:
    """Return the convex hull of two spheres of radii `bottom` and `top` with centres on the axis, `height` apart."""
    if bottom == top == 0.0:
        return None
    # Arcs of the profile: radius, height of the centre, first and last latitude.
    if height <= abs(bottom - top):  # one sphere contains the other, or both are one
        arcs = [(max(bottom, top), 0.5 * height * np.sign(top - bottom), -0.5 * np.pi, 0.5 * np.pi)]
    else:
        # The side touches both spheres at this latitude.
        tangent = float(np.arcsin((bottom - top) / height))
        arcs = [(bottom, -0.5 * height, -0.5 * np.pi, tangent), (top, 0.5 * height, tangent, 0.5 * np.pi)]
    # For each arc, and the side between: its points and its normals. A sphere of radius 0 is a single point.
    pieces = []
    for radius, center, start, stop in arcs:
        rows = int(np.ceil((stop - start) * segments / (2.0 * np.pi) - 1e-9)) if radius > 0.0 else 0
        latitude = np.linspace(start, stop, rows + 1) if rows else np.array([tangent])
        normals = np.stack([np.cos(latitude), np.sin(latitude)], axis=-1)
        pieces.append((radius * normals + [0.0, center], normals))
    if len(arcs) == 2 and bottom != top:
        side = np.linspace(pieces[0][0][-1], pieces[1][0][0], _TAPER_ROWS + 1)[1:-1]
        pieces.insert(1, (side, np.tile(pieces[0][1][-1], (len(side), 1))))
    points, normals = (np.concatenate(arrays) for arrays in zip(*pieces, strict=True))
    points[[0, -1], 0] = 0.0
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return _revolve([_Piece(points, normals, lengths / lengths[-1])], axis, segments)


def _revolve(pieces: list[_Piece], axis: str, segments: int) -> _Surface:
    """Return the closed surface of revolution of a profile, given by its consecutive pieces, about an axis.

    The profile begins and ends on the axis. A face at a pole is a triangle; the corner at the pole has the normal and
    the u of the triangle's middle.
    """
    # Each point of the profile becomes a ring: `segments` points around the axis, or one point on the axis, a pole.
    # `rings` has the radius and the height of each ring.
    rings = np.concatenate([pieces[0].points[:1], *(piece.points[1:] for piece in pieces)])
    counts = np.where(rings[:, 0] == 0.0, 1, segments)
    starts = np.cumsum(counts) - counts
    angle = 2.0 * np.pi * np.arange(segments) / segments
    radius = np.repeat(rings[:, 0], counts)
    azimuth = angle[np.arange(len(radius)) - np.repeat(starts, counts)]
    points = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), np.repeat(rings[:, 1], counts)], axis=-1)

    # For each piece: the sizes of its faces; then, for each corner, the point, the normal's x, y and z, and s and t.
    corners: list[list[Floats]] = []
    first = 0  # the ring at which the piece begins
    for piece in pieces:
        # Axes of the arrays: strip of faces between two rings, column around the axis, corner of the face (lower,
        # lower, upper, upper).
        row = np.arange(len(piece.points) - 1)[:, None, None] + np.array([0, 0, 1, 1])
        left_column = np.arange(segments)[:, None]
        pole = piece.points[row, 0] == 0.0
        column = np.where(pole, left_column + 0.5, left_column + np.array([0, 1, 1, 0]))
        is_corner = np.broadcast_to(~pole | np.array([True, False, True, False]), column.shape)
        phi = 2.0 * np.pi * column / segments
        outward, z = np.moveaxis(piece.normals[row], -1, 0)
        x, y = np.cos(phi), np.sin(phi)
        if piece.v is not None:
            s, t = column / segments, piece.v[row]
        else:
            disc_radius = 0.5 * piece.points[row, 0] / piece.points[:, 0].max()
            s, t = 0.5 + disc_radius * x, 0.5 + disc_radius * y * z
        index = starts[first + row] + np.where(pole, 0, column.astype(np.intp) % segments)
        values = np.broadcast_arrays(index, outward * x, outward * y, z, s, t)
        corners.append([is_corner.sum(axis=-1).ravel(), *(array[is_corner] for array in values)])
        first += len(piece.points) - 1
    sizes, index, *columns = (np.concatenate(arrays) for arrays in zip(*corners, strict=True))
    roll = _AXIS_ROLLS[axis]
    return _Surface(
        points=np.roll(points, roll, axis=1),
        face_sizes=sizes,
        face_points=index,
        normals=np.roll(np.stack(columns[:3], axis=-1), roll, axis=1),
        st=np.stack(columns[3:], axis=-1),
    )


# For each type of prim: the function that makes its surface, and the names of the attributes whose values it takes.
_BUILDERS: dict[str, tuple[Callable[..., _Surface | None], tuple[str, ...]]] = {
    "Cube": (_make_cube, ("size",)),
    "Sphere": (lambda axis, n, radius: _make_capsule(axis, n, radius, radius, 0.0), ("radius",)),
    "Cylinder": (lambda axis, n, radius, height: _make_frustum(axis, n, radius, radius, height), ("radius", "height")),
    "Cylinder_1": (_make_frustum, ("radiusBottom", "radiusTop", "height")),
    "Cone": (lambda axis, n, radius, height: _make_frustum(axis, n, radius, 0.0, height), ("radius", "height")),
    "Capsule": (lambda axis, n, radius, height: _make_capsule(axis, n, radius, radius, height), ("radius", "height")),
    "Capsule_1": (_make_capsule, ("radiusBottom", "radiusTop", "height")),
    "Plane": (_make_plane, ("width", "length")),
}
PRIMITIVES = tuple(_BUILDERS)
