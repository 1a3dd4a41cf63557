"""Small control cages, the same on every machine, for tests of subdivision."""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lookdev.arrays import Floats, Floats32, Indices
from lookdev.asset.mesh import Mesh, Subdivision
from lookdev.asset.subdivision.batch import join_cages
from lookdev.asset.subdivision.cage import build_cage
from lookdev.asset.subdivision.limit import limit_surface
from lookdev.asset.subdivision.refine import mask_rules
from lookdev.asset.subdivision.rules import interpolate
from lookdev.asset.subdivision.topology import split_faces


def cage(points: Any, faces: Sequence[Sequence[int]], scheme="catmullClark", uv: Any = None, **rules: Any) -> Mesh:
    """Return a cage; `uv` (m, 2) is its UV set ``st`` at corners, face-varying; creases are {(a, b): sharpness}."""
    creases, corners = rules.pop("creases", {}), rules.pop("corners", {})
    sizes = np.array([len(face) for face in faces], np.int32)
    count = int(sizes.sum())
    subdivision = Subdivision(
        scheme=scheme,  # type: ignore[arg-type]
        crease_edges=np.array(list(creases), np.int32).reshape(-1, 2),
        crease_sharpness=np.array(list(creases.values()), np.float32),
        corner_points=np.array(list(corners), np.int32),
        corner_sharpness=np.array(list(corners.values()), np.float32),
        holes=np.array(rules.pop("holes", []), np.int32),
        **rules,
    )
    empty = np.zeros((count, 3), np.float32)
    uvs = {} if uv is None else {"st": np.asarray(uv, np.float32).reshape(count, 2)}
    corner_points = np.concatenate([np.asarray(face, np.int32) for face in faces])
    slots = np.arange(len(sizes), dtype=np.int32)
    vertices = np.asarray(points, np.float32)
    return Mesh("/cage", vertices, corner_points, sizes, slots, empty, empty, uvs, subdivision=subdivision)


def with_rules(mesh: Mesh, **rules: Any) -> Mesh:
    """Return a cage with other rules."""
    assert mesh.subdivision is not None
    return replace(mesh, subdivision=replace(mesh.subdivision, **rules))


def cage_corners(mesh: Mesh, refine: Any, level: int) -> tuple[Indices, Indices]:
    """Return the corners of a cage that are shown, and the corner that each has become in the refined mesh.

    A face's children come in the order of its corners, each from its own corner on; of triangles a fourth follows.
    """
    faces = np.arange(len(mesh.face_sizes), dtype=np.float32)
    marked = replace(mesh, uvs={}, primvars={"face": np.repeat(faces, mesh.face_sizes)})
    visible = np.unique(refine(with_rules(marked, interpolation={"face": "uniform"}), level).primvars["face"])
    corners = np.flatnonzero(np.isin(np.repeat(faces, mesh.face_sizes), visible))
    children = np.arange(len(corners))
    assert mesh.subdivision is not None
    for _ in range(level):
        children = 3 * (children + children // 3) if mesh.subdivision.scheme == "loop" else 4 * children
    return corners, children


def limits(mesh: Mesh, level: int) -> tuple[Floats, Floats32]:
    """Return limit positions and normals (m, 3) at all corners, normals zero where there is no tangent plane."""
    assert mesh.subdivision is not None
    control, rules = join_cages([mesh]), mask_rules(mesh.subdivision)
    half_edges, points = build_cage(control, mesh.subdivision).half_edges, control.points
    for _ in range(level):
        points, half_edges = interpolate(half_edges, points, rules), split_faces(half_edges, rules.triangles)
    positions, normals = limit_surface(half_edges, points, rules)
    return positions[half_edges.points], normals


CUBE = np.array(list(itertools.product([-1.0, 1.0], repeat=3)))
CUBE_FACES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
CUBE_TRIANGLES = [[face[i] for i in three] for face in CUBE_FACES for three in ((0, 1, 2), (0, 2, 3))]


def bend(points: Any, amount: float = 0.3) -> Floats:
    """Return points moved by a few waves, so that nothing is symmetric."""
    p = np.asarray(points, np.float64)
    phase = np.arange(len(p))[:, None] * [1.7, 2.3, 3.1] + [0.4, 1.1, 2.0]
    return np.asarray(p + amount * np.sin(phase))


def lattice(columns: int, rows: int) -> tuple[Floats, list[list[int]]]:
    """Return points and quads of a plane grid of unit squares, facing up."""
    points = np.array([[i, j, 0.0] for i in range(columns + 1) for j in range(rows + 1)])
    faces = [[a := i * (rows + 1) + j, a + rows + 1, a + rows + 2, a + 1] for i in range(columns) for j in range(rows)]
    return points, faces


def triangles_of(faces: list[list[int]]) -> list[list[int]]:
    """Return quads as two triangles each."""
    return [three for a, b, c, d in faces for three in ([a, b, c], [a, c, d])]


def chart(points: Any, faces: Sequence[Sequence[int]], charts: Sequence[int], joined: Sequence[int] = ()) -> Any:
    """Return UVs (m, 2) at corners: those of a point are shifted by its face's chart, but for points in `joined`."""
    flat = bend(np.asarray(points)[:, [1, 0, 2]], 0.2)[:, :2]
    return np.array(
        [
            flat[p] + (0.0 if p in joined else 1.0) * np.array([0.9, -0.4]) * shift
            for face, shift in zip(faces, charts, strict=True)
            for p in face
        ]
    )


def _grid(columns: int = 3, rows: int = 3, **rules: Any) -> Mesh:
    points, faces = lattice(columns, rows)
    return cage(bend(points), faces, **rules)


def _mixed() -> tuple[Floats, list[list[int]]]:
    """Return a patch of a pentagon, triangles and quads around a triangle."""
    points = [[0, 0, 0], [2, 0, 0], [1, 2, 0], [1, -2, 0], [3, 1, 0], [-1, 1, 0], [3, -1, 0], [2, 3, 0], [0, 3, 0]]
    return bend(points), [[0, 1, 2], [1, 0, 3], [2, 1, 4], [0, 2, 5], [3, 6, 1], [6, 4, 1], [2, 4, 7], [2, 7, 8, 5]]


def _fins() -> Mesh:
    """Return three pairs of quads along one line of edges, and a face that touches one of them at an edge."""
    points = [[x, y, abs(x) * x * (1 - x) * 0.2] for x in (0, 1, -1, -1.5) for y in (0, 1, 2)]
    points = [*points, [3, 0, 0], [3, 1, 0]]
    wings = [[0, 3, 4, 1], [1, 4, 5, 2], [0, 1, 7, 6], [1, 2, 8, 7], [0, 1, 10, 9], [1, 2, 11, 10]]
    return cage(bend(points), [*wings, [4, 3, 12, 13]])


def _seamed(rule: str, **rules: Any) -> Mesh:
    """Return a grid of 4 x 4 whose UVs have charts that meet three at a point, end inside, and leave single faces."""
    points, faces = lattice(4, 4)
    charts = [0, 0, 0, 0, 0, 1, 1, 0, 2, 1, 1, 0, 2, 2, 0, 3]
    uv = chart(points, faces, charts, joined=(7, 16, 17))
    return cage(bend(points), faces, uv=uv, face_varying=rule, **rules)


_CROSSING = {(6, 11): 1.4, (11, 16): 2.3, **dict.fromkeys([(2, 7), (7, 12), (12, 17), (17, 22)], 10.0)}
_RING = dict.fromkeys([(0, 1), (1, 3), (3, 2), (2, 0)], 10.0)

_RULES = ("none", "cornersOnly", "cornersPlus1", "cornersPlus2", "boundaries", "all")
_JUNCTIONS = {**_RING, (0, 4): 1.6, (1, 5): 10.0, (5, 7): 10.0}

CAGES: dict[str, Mesh] = {
    "cube": cage(bend(CUBE), CUBE_FACES),
    "sharp ring": cage(bend(CUBE), CUBE_FACES, creases=_RING),
    "soft ring": cage(bend(CUBE), CUBE_FACES, creases=dict(zip(_RING, (2.5, 2.5, 0.7, 1.0), strict=True))),
    "junctions": cage(bend(CUBE), CUBE_FACES, creases=_JUNCTIONS, corners={6: 1.3, 7: 10.0}),
    "open": _grid(),
    "open, edgeOnly": _grid(interpolate_boundary="edgeOnly"),
    "open, none": _grid(interpolate_boundary="none"),
    "open, none, creased": _grid(interpolate_boundary="none", creases={(0, 4): 10.0, (0, 1): 10.0, (1, 2): 10.0}),
    "crossed": _grid(creases={(1, 5): 10.0, (5, 9): 10.0, (9, 13): 10.0, (9, 10): 3.2}, corners={0: 0.5}),
    "any faces": cage(*_mixed()),
    "smooth triangles": cage(*_mixed(), triangle_rule="smooth"),
    "fins": _fins(),
    "loop": cage(bend(CUBE), CUBE_TRIANGLES, "loop"),
    "loop, soft": cage(bend(CUBE), CUBE_TRIANGLES, "loop", creases={(0, 1): 1.5, (1, 3): 2.2}, corners={6: 1.3}),
    "loop, open": cage(*(lambda p, f: (bend(p), triangles_of(f)))(*lattice(3, 3)), scheme="loop"),
    "bilinear": cage(bend(CUBE), CUBE_FACES, "bilinear", creases=_RING),
    **{f"seams, {rule}": _seamed(rule) for rule in _RULES},
    "seams, creased": _seamed("cornersPlus1", creases=_CROSSING),
    "seams, edgeOnly": _seamed("cornersOnly", interpolate_boundary="edgeOnly"),
}
