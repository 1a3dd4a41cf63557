"""Limit masks: the weights of a point's ring in its limit position and in two tangents that span the tangent plane.

They are left eigenvectors of the ring's refinement matrix (Halstead, Kass and DeRose, "Efficient, Fair
Interpolation using Catmull-Clark Surfaces", 1993, section 4 and appendix A); the eigenvalues are those of Stam, "Exact
Evaluation of Catmull-Clark Subdivision Surfaces at Arbitrary Parameter Values" (1998), section 3, and of Loop (1987).

OpenSubdiv 3.6 has other masks in two cases, in which its masks do not agree with its own refinement rules: at a dart it
uses those of a smooth point; for the tangent across a crease with three or more faces a side (Loop: four) it uses those
of the modified rules of Biermann, Levin and Zorin (2000).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cache

import numpy as np

from lookdev.arrays import Floats
from lookdev.asset.subdivision.rules import Rules, smooth_weights

_MAX_DART_FACES = 64
"""The most faces around a dart whose sharp edge counts: with more, masks differ by less than 1e-3 of the ring."""


class SectorKind(IntEnum):
    """The kind of a sector's masks. A sector of kind `NONE` has no tangent plane, and its point does not move."""

    SMOOTH = 0
    DART = 1
    CREASE = 2
    CORNER = 3
    NONE = 4


@dataclass(frozen=True, eq=False)
class Masks:
    """Rows of weights (r,), of a point and the points around it: the limit position, then two tangents.

    center (r,): weights of the point; edges (r, size + 1): of the points at its edges, counter-clockwise, the last 0 in
    a closed sector, which has one edge less; faces (r, size): of the opposite points of its quads.
    """

    center: Floats
    edges: Floats
    faces: Floats

    def position(self) -> Masks:
        """Return the first row only, which is the limit position."""
        return Masks(self.center[:1], self.edges[:1], self.faces[:1])


@cache
def limit_masks(kind: SectorKind, size: int, rules: Rules) -> Masks:
    """Return the masks of a sector of `size` faces: its position and two tangents whose cross product is outward."""
    point, edges, faces = np.zeros(3), np.zeros((3, size + 1)), np.zeros((3, size))
    if kind in (SectorKind.SMOOTH, SectorKind.DART):
        edges[0, :size], faces[0] = _smooth_position(size, rules)
        if size > 2:
            theta, i = 2.0 * np.pi / size, np.arange(size)
            edges[1, :size], edges[2, :size] = np.cos(i * theta), np.sin(i * theta)
            across = edges[1:, :size] + np.roll(edges[1:, :size], -1, axis=1)
            faces[1:] = _face_weight(theta, rules) * across
        point[0] = 1.0 - edges[0].sum() - faces[0].sum()
        if kind == SectorKind.DART and size <= _MAX_DART_FACES:
            point[:2], edges[:2, :size], faces[:2] = _dart_weights(size, rules, along=edges[1, :size])
    elif kind == SectorKind.CORNER:
        point[:], edges[1, 0], edges[2, 1] = (1.0, -1.0, -1.0), 1.0, 1.0
    elif kind == SectorKind.CREASE:
        # A crease is a cubic B-spline, which has this limit and this tangent.
        point[0], edges[0, [0, size]] = 2.0 / 3.0, 1.0 / 6.0
        edges[1, [0, size]] = 1.0, -1.0
        point[2], edges[2], faces[2] = _cross_tangent(size, rules)
    # The cosine of 90 degrees is 6e-17; as 0 it is not summed over all points.
    return Masks(*(np.where(np.abs(weights) < 1e-15, 0.0, weights) for weights in (point, edges, faces)))


def _cross_tangent(size: int, rules: Rules) -> tuple[float, Floats, Floats]:
    """Return the weights of the tangent away from a crease: of the point, the edges and the faces.

    They are the left eigenvector of the largest eigenvalue that is symmetric about the middle of the sector. Over the
    edges between faces it is a sine. The weight of the ends follows from their column of the refinement matrix and from
    the sum, which is 0. For one face it is the second difference of the crease.
    """
    edges, faces = np.zeros(size + 1), np.zeros(size)
    if size == 1:
        return -2.0, edges + 1.0, faces
    theta = np.pi / size
    eigenvalue = _eigenvalue(theta, rules)
    edges[1:size] = np.sin(np.arange(1, size) * theta)
    faces[:] = _face_weight(theta, rules) * (edges[:-1] + edges[1:])
    inward = edges[1] if rules.triangles else 8.0 * eigenvalue * faces[0]
    end = (inward - edges.sum() - faces.sum()) / (8.0 * eigenvalue - 2.0)
    edges[[0, size]] = end
    return float((8.0 * eigenvalue - 4.0) * end - inward), edges, faces


def _dart_weights(size: int, rules: Rules, along: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the weights of the position and of the tangent along the sharp edge: (2,), (2, size), (2, size).

    The sharp edge is the first; both rows are symmetric about it. The tangent across the edge is that of a smooth
    point, in which the edge has weight 0. `along` (size,) determines the sign of the tangent.
    """
    matrix = _ring_matrix(size, rules)
    matrix[1], matrix[1, :2] = 0.0, 0.5  # the point of a sharp edge becomes the edge's middle
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
    """Return the refinement matrix of a smooth point, the points at its edges and, for quads, the opposite points."""
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
    """Return the weight of an edge's and of a face's point in the limit position of a smooth point."""
    if rules.triangles:
        ring = float(smooth_weights(np.array([size]), rules)[1][0])
        return 1.0 / (size + 3.0 / (8.0 * ring)), 0.0
    return 4.0 / (size * (size + 5.0)), 1.0 / (size * (size + 5.0))


def _face_weight(theta: float, rules: Rules) -> float:
    """Return the weight of a quad's opposite point in a tangent, relative to the sum over the two adjacent edges."""
    return 0.0 if rules.triangles else 1.0 / (4.0 * (4.0 * _eigenvalue(theta, rules) - 1.0))


def _eigenvalue(theta: float, rules: Rules) -> float:
    """Return the eigenvalue of the refinement whose eigenvectors turn by `theta` from edge to edge (Stam 1998)."""
    cosine = np.cos(theta)
    if rules.triangles:
        return float(0.375 + 0.25 * cosine)
    return float((5.0 + cosine + np.cos(0.5 * theta) * np.sqrt(2.0 * (9.0 + cosine))) / 16.0)
