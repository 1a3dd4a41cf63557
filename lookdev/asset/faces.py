"""The faces of shapes that are kept, and what varies over a shape at the corners of those faces.

Faces are left out that have fewer than three corners, one point twice, or the corners of an earlier face in the same
order; holes too, except those of control cages. The arrays of many shapes are handled as one: the time that a shape
takes is that of its numbers.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookdev.asset.mesh import Floats
from lookdev.asset.normals import blocks, face_starts, together
from lookdev.asset.shape import Attribute, Index, Shape
from lookdev.asset.tangents import mixed
from lookdev.errors import AssetError


@dataclass(frozen=True, eq=False)
class Faces:
    """The kept faces of shapes, one shape after the other.

    `all_points`, `all_faces`, `all_corners` (s + 1,) are where each shape's arrays begin among those of all; `faces`
    and `corners` (s + 1,) where its kept ones begin. sizes (f,); face_source (f,) and corner_source (m,) number kept
    faces and corners among all, None where they are all corners in their order; corner_points (m,) number the points of
    all. `holes` (f,) are kept faces that are not shown.
    """

    shapes: Sequence[Shape]
    all_points: Index
    all_faces: Index
    all_corners: Index
    faces: Index
    corners: Index
    sizes: Index
    face_source: Index
    corner_source: Index | None
    corner_points: Index
    holes: NDArray[np.bool_]

    @classmethod
    def of(cls, shapes: Sequence[Shape]) -> Faces:
        """Return the faces that are kept; raises AssetError with a line for each shape that contradicts itself."""
        counts = np.array([(len(each.points), len(each.face_sizes), len(each.face_points)) for each in shapes], np.intp)
        point_starts, all_faces, all_corners = np.vstack([np.zeros(3, np.intp), counts.cumsum(axis=0)]).T
        sizes = together([each.face_sizes for each in shapes]).astype(np.intp, copy=False)
        points = together([each.face_points for each in shapes]).astype(np.intp, copy=False)
        _check_sizes(shapes, sizes, all_faces)
        _check_range(shapes, points, np.diff(all_corners), counts[:, 0], "faceVertexIndices", "points")
        if len(shapes) > 1:
            points += np.repeat(point_starts[:-1], counts[:, 2])
        holes = _holes(shapes, all_faces)

        caged = np.array([each.subdivision is not None for each in shapes])
        keep = (sizes >= 3) & ~(holes & ~np.repeat(caged, counts[:, 1]))
        keep[keep] = _distinct(points if keep.all() else points[np.repeat(keep, sizes)], sizes[keep])
        source = None
        mirrored = np.array([each.left_handed for each in shapes])
        if mirrored.any() or not keep.all():
            source = np.arange(len(points))
            last = np.repeat(2 * face_starts(sizes) + sizes - 1, sizes)
            # Each face's corners backwards.
            source = np.where(np.repeat(mirrored, counts[:, 2]), last - source, source)[np.repeat(keep, sizes)]
            points = points[source]
        face_source = np.flatnonzero(keep)
        faces = np.searchsorted(face_source, all_faces)
        sizes = sizes[keep]
        corners = np.concatenate([[0], np.cumsum(sizes)])[faces]
        return cls(
            shapes,
            point_starts,
            all_faces,
            all_corners,
            faces,
            corners,
            sizes,
            face_source,
            source,
            points,
            holes[keep],
        )

    def at_corners(self, given: Sequence[tuple[int, Attribute]]) -> list[Floats]:
        """Return attributes of one width, given with the number of their shape, at the kept corners of that shape.

        Raises
        ------
        AssetError
            An attribute has the wrong number of values, or one that is not finite; a line for each.
        """
        numbers = np.array([number for number, _ in given], np.intp)
        raise_all(fault for number, each in given if (fault := self._wrong_count(number, each)))
        with np.errstate(over="ignore"):
            values = together([each.values for _, each in given]).astype(np.float32, copy=False)
        lengths = np.array([len(each.values) for _, each in given], np.intp)
        starts = np.cumsum(lengths) - lengths
        if not (finite := np.isfinite(values)).all():
            wrong = np.flatnonzero(~finite.reshape(len(values), -1).all(axis=1))
            raise_all(
                f"{self._name(*given[i])}: value {j} is not finite; every value must be a number"
                for i, j in first_in_each(wrong, starts)
            )
        kinds = np.array([_CORNER_INDEX[each.interpolation] for _, each in given], np.intp)
        counts = np.diff(self.corners)[numbers]
        if (kinds == kinds[0]).all():
            index = self._sources(kinds[0], numbers, starts)
        else:
            index = np.empty(counts.sum(), np.intp)
            for kind in np.unique(kinds):
                chosen = kinds == kind
                index[np.repeat(chosen, counts)] = self._sources(kind, numbers[chosen], starts[chosen])
        return np.split(values.take(index, axis=0), np.cumsum(counts)[:-1])

    def _sources(self, kind: int, chosen: Index, value_starts: Index) -> Index:
        """Return the index of each kept corner of the chosen shapes among the values of an interpolation."""
        counts = np.diff(self.corners)[chosen]
        if kind == 0:
            return np.repeat(value_starts, counts)
        if kind == 1:
            every, begins = np.repeat(self.face_source, self.sizes), self.all_faces
        elif kind == 2:
            every, begins = self.corner_points, self.all_points
        else:
            source = self.corner_source
            every = np.arange(len(self.corner_points)) if source is None else source
            begins = self.all_corners
        shift = value_starts - begins[chosen]
        if len(chosen) < len(self.shapes):
            wanted = np.zeros(len(self.shapes), bool)
            wanted[chosen] = True
            every = every[np.repeat(wanted, np.diff(self.corners))]
        return every + np.repeat(shift, counts) if shift.any() else every

    def _wrong_count(self, number: int, attribute: Attribute) -> str:
        shape, name = self.shapes[number], self._name(number, attribute)
        if attribute.interpolation not in _CORNER_INDEX:
            known = ", ".join(_CORNER_INDEX)
            return f"{name} has interpolation {attribute.interpolation!r:.60}; known: {known}"
        needed = (1, len(shape.face_sizes), len(shape.points), len(shape.face_points))
        count = needed[_CORNER_INDEX[attribute.interpolation]]
        if len(attribute.values) == count:
            return ""
        return f"{name} has {len(attribute.values)} values; interpolation '{attribute.interpolation}' needs {count}"

    def _name(self, number: int, attribute: Attribute) -> str:
        prefix = "" if attribute is self.shapes[number].normals else "primvars:"
        return f"{self.shapes[number].name}: {prefix}{attribute.name}"


# What the values of an interpolation are numbered by: 0 nothing, 1 faces, 2 points, 3 corners.
_CORNER_INDEX = {"constant": 0, "uniform": 1, "varying": 2, "vertex": 2, "faceVarying": 3}


def first_in_each(places: Index, begins: Index) -> list[tuple[int, int]]:
    """Return, for each shape that has some of these sorted places, its number and the first, from where it begins."""
    owners, first = np.unique(np.searchsorted(begins, places, side="right") - 1, return_index=True)
    return list(zip(owners.tolist(), (places[first] - begins[owners]).tolist(), strict=True))


def _check_sizes(shapes: Sequence[Shape], sizes: Index, face_begins: Index) -> None:
    total, filled = np.zeros(len(shapes), np.intp), np.diff(face_begins) > 0
    total[filled] = np.add.reduceat(sizes, face_begins[:-1][filled])
    given = np.array([len(each.face_points) for each in shapes])
    wrong = total != given
    wrong[np.searchsorted(face_begins, np.flatnonzero(sizes < 0), side="right") - 1] = True
    raise_all(
        f"{shapes[i].name}: faceVertexCounts add up to {total[i]} corners, faceVertexIndices has {given[i]}; they must "
        "agree, and none may be negative"
        for i in np.flatnonzero(wrong)
    )


def _check_range(shapes: Sequence[Shape], indices: Index, lengths: Index, limits: Index, name: str, of: str) -> None:
    least = limits.min()
    if len(indices) == 0 or (indices.min() >= 0 and indices.max() < least):
        return
    bad = np.flatnonzero((indices < 0) | (indices >= np.repeat(limits, lengths)))
    begins = np.cumsum(lengths) - lengths
    raise_all(
        f"{shapes[i].name}: {name}[{j}] is {indices[begins[i] + j]}, but {index_rule(limits[i], of)}"
        for i, j in first_in_each(bad, begins)
    )


def index_rule(count: int, of: str) -> str:
    """Return what is right for an index among `count` things."""
    return f"there are {count} {of}; it must lie in 0..{count - 1}" if count else f"there are no {of}"


def raise_all(faults: Iterable[str]) -> None:
    """Raise an AssetError with a line for each fault, if there are any."""
    if text := "\n".join(faults):
        raise AssetError(text)


def _holes(shapes: Sequence[Shape], face_begins: Index) -> NDArray[np.bool_]:
    """Return whether each face of all shapes is a hole."""
    given = [np.zeros(0, np.intp) if each.holes is None else each.holes for each in shapes]
    lengths, limits = np.array([len(each) for each in given]), np.diff(face_begins)
    indices = np.concatenate(given).astype(np.intp)
    _check_range(shapes, indices, lengths, limits, "holeIndices", "faces")
    holes = np.zeros(face_begins[-1], bool)
    holes[indices + np.repeat(face_begins[:-1], lengths)] = True
    return holes


def _distinct(points: Index, sizes: Index) -> NDArray[np.bool_]:
    """Return whether a face (f,) has no point twice and is not an earlier face with the same corners in the same order.

    Faces are compared by a 64-bit hash, the sum over their directed edges.
    """
    distinct, key = np.ones(len(sizes), bool), np.zeros(len(sizes), np.uint64)
    for faces, corners in blocks(sizes):
        own, mine = sizes[faces], points[corners].astype(np.uint64)
        starts = face_starts(own)
        for size in own[:1] if (own == own[0]).all() else np.unique(own):
            these = np.flatnonzero(own == size)
            corner = mine[starts[these] + np.arange(size)[:, None]]
            ordered = np.sort(corner, axis=0)
            distinct[faces][these] = (ordered[1:] != ordered[:-1]).all(axis=0)
            edges = corner << np.uint64(32) | np.roll(corner, -1, axis=0)
            # The hash of 0 is 0: an edge from point 0 to itself would not count.
            key[faces][these] = mixed(edges + np.uint64(1)).sum(axis=0)
    ordered = np.sort(key)
    if (ordered[1:] == ordered[:-1]).any():
        first = np.unique(key, return_index=True)[1]
        again = np.ones(len(sizes), bool)
        again[first] = False
        distinct &= ~again
    return distinct
