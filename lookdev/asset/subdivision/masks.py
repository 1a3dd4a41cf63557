"""Computes limit masks: weights that turn a point and its ring into the limit position and two tangents.

The ring of a point is the points at the other ends of its edges and, for quads, the opposite points of its faces. A
sector is the faces around a point between two sharp edges, or all faces around it. A dart is a point at which one sharp
edge ends. The masks are left eigenvectors of the ring's refinement matrix (Halstead, Kass and DeRose, "Efficient, Fair
Interpolation using Catmull-Clark Surfaces", 1993, section 4 and appendix A). The eigenvalues follow Stam, "Exact
Evaluation of Catmull-Clark Subdivision Surfaces at Arbitrary Parameter Values" (1998), section 3, and Loop (1987).

In two cases OpenSubdiv 3.6 uses other masks, which do not agree with its own refinement rules. At a dart it uses the
masks of a smooth point. For the tangent across a crease with three or more faces on a side (Loop: four), it uses the
masks of the modified rules of Biermann, Levin and Zorin (2000).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cache

import numpy as np

from lookdev.arrays import Floats
from lookdev.asset.subdivision.rules import Rules, smooth_weights

_MAX_DART_FACES = 64
"""A dart with more faces has the masks of a smooth point, which then differ by less than 1e-3 of the ring."""


class SectorKind(IntEnum):
    """The kind of a sector's masks. A sector of kind `NONE` has no tangent plane, and its point does not move."""

    SMOOTH = 0
    DART = 1
    CREASE = 2
    CORNER = 3
    NONE = 4


@dataclass(frozen=True, eq=False)
class Masks:
    """Weights of a point and of the points around it in a sector of `size` faces.

    There are r rows: the first row gives the limit position, the next two rows give the tangents.

    - center (r,): the weights of the point itself
    - edges (r, size + 1): the weights of the points at the other ends of its edges, counter-clockwise; a closed sector
      has only `size` edges, and the last weight is 0
    - faces (r, size): the weights of the opposite points of its quads; 0 for triangles
    """

    center: Floats
    edges: Floats
    faces: Floats

    def position(self) -> Masks:
        """Return the first row only, which is the limit position."""
        return Masks(self.center[:1], self.edges[:1], self.faces[:1])


@cache
def limit_masks(kind: SectorKind, size: int, rules: Rules) -> Masks:
    """Return the masks of a sector of `size` faces; the cross product of the two tangents points outwards."""
    point, edges, faces = np.zeros(3), np.zeros((3, size + 1)), np.zeros((3, size))
    if kind in (SectorKind.SMOOTH, SectorKind.DART):
        edges[0, :size], faces[0] = _smooth_position(size, rules)
        if size > 2:
            theta, i = 2.0 * np.pi / size, np.arange(size)
            edges[1, :size], edges[2, :size] = np.cos(i * theta), np.sin(i * theta)
            # For each face, the sum of the weights of its two edges.
            across = edges[1:, :size] + np.roll(edges[1:, :size], -1, axis=1)
            faces[1:] = _face_weight(theta, rules) * across
        point[0] = 1.0 - edges[0].sum() - faces[0].sum()
        if kind == SectorKind.DART and size <= _MAX_DART_FACES:
            point[:2], edges[:2, :size], faces[:2] = _dart_weights(size, rules, along=edges[1, :size])
    elif kind == SectorKind.CORNER:
        point[:], edges[1, 0], edges[2, 1] = (1.0, -1.0, -1.0), 1.0, 1.0
    elif kind == SectorKind.CREASE:
        # A crease is a cubic B-spline. These weights give the limit position and the tangent of a B-spline at a vertex.
        point[0], edges[0, [0, size]] = 2.0 / 3.0, 1.0 / 6.0
        edges[1, [0, size]] = 1.0, -1.0
        point[2], edges[2], faces[2] = _cross_tangent(size, rules)
    # Rounding errors, such as 6e-17 for the cosine of 90 degrees, become 0, so that they are not summed over all
    # points.
    return Masks(*(np.where(np.abs(weights) < 1e-15, 0.0, weights) for weights in (point, edges, faces)))


def _cross_tangent(size: int, rules: Rules) -> tuple[float, Floats, Floats]:
    """Return the weights of the tangent across a crease: of the point, of the edges (size + 1,), of the faces (size,).

    The weights are a left eigenvector of the refinement matrix: of the eigenvectors that are symmetric about the middle
    of the sector, the one with the largest eigenvalue. The weights of the edges between faces are the values of a sine.
    The two ends, which are the first and the last edge, form the crease, and have equal weights. Two equations give the
    weight of an end and the weight of the point: the eigenvector's equation in the column of an end, and the sum of all
    weights, which is 0. For one face, the eigenvector is the second difference along the crease.
    """
    edges, faces = np.zeros(size + 1), np.zeros(size)
    if size == 1:
        return -2.0, edges + 1.0, faces
    theta = np.pi / size
    eigenvalue = _eigenvalue(theta, rules)
    edges[1:size] = np.sin(np.arange(1, size) * theta)
    faces[:] = _face_weight(theta, rules) * (edges[:-1] + edges[1:])
    # The weights of an end and of the point solve two equations:
    #     eigenvalue * end = point / 8 + end / 2 + inward / 8
    #     point + 2 * end + sum of the other edges + sum of the faces = 0
    # `inward` / 8 is the contribution of the edge next to the end and, for quads, of the face between the two edges.
    # For quads, the column of this face has the same contributions, and their sum is eigenvalue * faces[0].
    inward = edges[1] if rules.triangles else 8.0 * eigenvalue * faces[0]
    end = (inward - edges.sum() - faces.sum()) / (8.0 * eigenvalue - 2.0)
    edges[[0, size]] = end
    return float((8.0 * eigenvalue - 4.0) * end - inward), edges, faces


def _dart_weights(size: int, rules: Rules, along: Floats) -> tuple[Floats, Floats, Floats]:
    """Return two rows of weights at a dart: of the limit position, and of the tangent along the sharp edge.

    The three arrays are the weights of the point (2,), of the edges (2, size) and of the faces (2, size). The sharp
    edge is the first edge; both rows are symmetric about it. The tangent across the sharp edge is not computed here: it
    is the same as at a smooth point, where the sharp edge has weight 0. The tangent's sign makes the dot product of its
    edge weights with `along` (size,) positive.
    """
    matrix = _ring_matrix(size, rules)
    matrix[1], matrix[1, :2] = 0.0, 0.5  # the point of a sharp edge becomes the edge's middle
    # `mirror` is the ring's reflection about the sharp edge, and `basis` an orthonormal basis of symmetric vectors.
    i = np.arange(size)
    mirror = np.concatenate([[0], 1 + -i % size, len(matrix) - 1 - i if len(matrix) > size + 1 else i[:0]])
    basis = np.eye(len(matrix)) + np.eye(len(matrix))[mirror]
    basis = basis[:, np.arange(len(matrix)) <= mirror]
    basis /= np.linalg.norm(basis, axis=0)
    eigenvalues, vectors = np.linalg.eig((basis.T @ matrix @ basis).T)
    largest = np.argsort(-eigenvalues.real)[:2]
    position, tangent = (basis @ vectors[:, largest].real).T
    position /= position.sum()
    tangent *= np.sign(tangent[1 : size + 1] @ along)
    rows, faces = np.stack([position, tangent]), np.zeros((2, size))
    if not rules.triangles:
        faces[:] = rows[:, size + 1 :]
    return rows[:, 0], rows[:, 1 : size + 1], faces


def _ring_matrix(size: int, rules: Rules) -> Floats:
    """Return the refinement matrix of a smooth point and its ring of `size` faces.

    Its rows and columns are the point, the points at its edges and, for quads, the opposite points of its faces.
    """
    identity, following = np.eye(size), np.roll(np.eye(size), 1, axis=1)
    point_weight, ring = smooth_weights(np.array([size]), rules)
    if rules.triangles:
        edges = np.hstack([np.full((size, 1), 0.375), 0.375 * identity + 0.125 * (following + following.T)])
        return np.vstack([np.concatenate([point_weight, np.repeat(ring, size)]), edges])
    faces = 0.25 * np.hstack([np.ones((size, 1)), identity + following, identity])
    edges = 0.25 * (np.hstack([np.ones((size, 1)), identity, np.zeros((size, size))]) + faces + following.T @ faces)
    point = ring * faces.sum(axis=0)
    point[0] += point_weight[0]
    point[1 : size + 1] += ring
    return np.vstack([point, edges, faces])


def _smooth_position(size: int, rules: Rules) -> tuple[float, float]:
    """Return the weights, in a smooth point's limit position, of the point at each edge and of each opposite point."""
    if rules.triangles:
        ring = float(smooth_weights(np.array([size]), rules)[1][0])
        return 1.0 / (size + 3.0 / (8.0 * ring)), 0.0
    return 4.0 / (size * (size + 5.0)), 1.0 / (size * (size + 5.0))


def _face_weight(theta: float, rules: Rules) -> float:
    """Return the weight of a quad's opposite point in a tangent, relative to the sum of the weights of its two edges.

    The weights of the edges are a wave that advances by the angle `theta` from edge to edge.
    """
    return 0.0 if rules.triangles else 1.0 / (4.0 * (4.0 * _eigenvalue(theta, rules) - 1.0))


def _eigenvalue(theta: float, rules: Rules) -> float:
    """Return the eigenvalue of refinement for eigenvectors that advance by an angle `theta` per edge (Stam 1998)."""
    cosine = np.cos(theta)
    if rules.triangles:
        return float(0.375 + 0.25 * cosine)
    return float((5.0 + cosine + np.cos(0.5 * theta) * np.sqrt(2.0 * (9.0 + cosine))) / 16.0)
