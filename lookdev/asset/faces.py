"""Finds the valid faces of shapes, and the values of attributes at the corners of these faces, for `finish`.

A face is dropped if it has fewer than three corners, has the same point twice, or repeats the corners of an earlier
face in the same order. Holes are dropped too, except in control cages. The arrays of many shapes are
concatenated, so that one NumPy call serves many small shapes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Bools, Floats32, Indices
from lookdev.asset.normals import concatenate, face_blocks, run_starts
from lookdev.asset.shape import Attribute, PolygonShape
from lookdev.asset.tangents import mix_bits
from lookdev.errors import AssetError


@dataclass(frozen=True, eq=False)
class Faces:
    """The valid faces of shapes, concatenated in the order of the shapes.

    There are s shapes, with f valid faces that have m corners altogether. "All" points, faces and corners are the
    concatenated points, faces and corners of the shapes, including faces that are not valid.

    - shapes: the s shapes
    - all_point_starts, all_face_starts, all_corner_starts (s + 1,): the index of each shape's first point, face and
      corner among all points, faces and corners; the last entry is the total number
    - face_starts, corner_starts (s + 1,): the index of each shape's first valid face among the valid faces, and of that
      face's first corner among the corners of the valid faces; the last entry is the total number
    - sizes (f,): the number of corners of each valid face
    - face_source (f,): the index of each valid face among all faces
    - corner_source (m,): the index of each corner of a valid face among all corners; None if it is the identity
    - corner_points (m,): the index of the point at each corner of a valid face, among all points
    - holes (f,): whether each valid face is a hole of a control cage
    """

    shapes: Sequence[PolygonShape]
    all_point_starts: Indices
    all_face_starts: Indices
    all_corner_starts: Indices
    face_starts: Indices
    corner_starts: Indices
    sizes: Indices
    face_source: Indices
    corner_source: Indices | None
    corner_points: Indices
    holes: Bools

    @classmethod
    def collect(cls, shapes: Sequence[PolygonShape]) -> Faces:
        """Collect the valid faces of shapes; raises AssetError with a line for each shape that contradicts itself.

        A left-handed shape's corners are reversed, so that all valid faces are counter-clockwise.
        """
        # The numbers (s, 3) of points, faces and corners of each shape.
        counts = np.array(
            [(len(shape.points), len(shape.face_sizes), len(shape.face_points)) for shape in shapes], np.intp
        )
        point_starts, all_face_starts, all_corner_starts = np.vstack([np.zeros(3, np.intp), counts.cumsum(axis=0)]).T
        sizes = concatenate([shape.face_sizes for shape in shapes]).astype(np.intp, copy=False)
        points = concatenate([shape.face_points for shape in shapes]).astype(np.intp, copy=False)
        _check_sizes(shapes, sizes, all_face_starts)
        _check_range(shapes, points, np.diff(all_corner_starts), counts[:, 0], "faceVertexIndices", "points")
        if len(shapes) > 1:
            points += np.repeat(point_starts[:-1], counts[:, 2])
        holes = _hole_mask(shapes, all_face_starts)

        is_cage = np.array([shape.subdivision is not None for shape in shapes])
        is_valid = (sizes >= 3) & ~(holes & ~np.repeat(is_cage, counts[:, 1]))
        valid_points = points if is_valid.all() else points[np.repeat(is_valid, sizes)]
        is_valid[is_valid] = _distinct_faces(valid_points, sizes[is_valid])
        corner_source = None
        is_left_handed = np.array([shape.left_handed for shape in shapes])
        if is_left_handed.any() or not is_valid.all():
            corner_source = np.arange(len(points))
            # In reverse order, corner c of a face becomes corner first + last - c; `sums` has first + last.
            sums = np.repeat(2 * run_starts(sizes) + sizes - 1, sizes)
            is_reversed = np.repeat(is_left_handed, counts[:, 2])
            corner_source = np.where(is_reversed, sums - corner_source, corner_source)[np.repeat(is_valid, sizes)]
            points = points[corner_source]
        face_source = np.flatnonzero(is_valid)
        face_starts = np.searchsorted(face_source, all_face_starts)
        sizes = sizes[is_valid]
        corner_starts = np.concatenate([[0], np.cumsum(sizes)])[face_starts]
        starts = point_starts, all_face_starts, all_corner_starts
        return cls(
            shapes, *starts, face_starts, corner_starts, sizes, face_source, corner_source, points, holes[is_valid]
        )

    def corner_values(self, attributes: Sequence[tuple[int, Attribute]]) -> list[Floats32]:
        """Return, for each attribute, its values (c,) or (c, width) at the c corners of its shape's valid faces.

        `attributes` are pairs: the number of a shape, and an attribute of that shape. All attributes have values of the
        same width, which is the number of components.

        Raises
        ------
        AssetError
            An attribute has the wrong number of values, or a value that is not finite. The message has a line for each
            such attribute.
        """
        shape_numbers = np.array([shape_number for shape_number, _ in attributes], np.intp)
        raise_faults(
            fault for shape_number, attribute in attributes if (fault := self._count_fault(shape_number, attribute))
        )
        with np.errstate(over="ignore"):
            values = concatenate([attribute.values for _, attribute in attributes]).astype(np.float32, copy=False)
        lengths = np.array([len(attribute.values) for _, attribute in attributes], np.intp)
        starts = np.cumsum(lengths) - lengths
        if not (finite := np.isfinite(values)).all():
            wrong = np.flatnonzero(~finite.reshape(len(values), -1).all(axis=1))
            raise_faults(
                f"{self._name(*attributes[i])}: value {j} is not finite; every value must be a number"
                for i, j in first_in_runs(wrong, starts)
            )
        elements = np.array([_ELEMENT_NUMBERS[attribute.interpolation] for _, attribute in attributes], np.intp)
        counts = np.diff(self.corner_starts)[shape_numbers]
        if (elements == elements[0]).all():
            index = self._value_indices(elements[0], shape_numbers, starts)
        else:
            index = np.empty(counts.sum(), np.intp)
            for element in np.unique(elements):
                is_selected = elements == element
                values_of_element = self._value_indices(element, shape_numbers[is_selected], starts[is_selected])
                index[np.repeat(is_selected, counts)] = values_of_element
        return np.split(values.take(index, axis=0), np.cumsum(counts)[:-1])

    def _value_indices(self, element: int, shape_numbers: Indices, value_starts: Indices) -> Indices:
        """Return indices into the concatenated values of k shapes: one for each corner of the shapes' valid faces.

        `shape_numbers` (k,) has the number of each shape, and `value_starts` (k,) the index of its first value. All
        values belong to elements of one type, which has the number `element` in `_ELEMENT_NUMBERS`.
        """
        counts = np.diff(self.corner_starts)[shape_numbers]
        if element == 0:
            return np.repeat(value_starts, counts)
        if element == 1:
            indices, begins = np.repeat(self.face_source, self.sizes), self.all_face_starts
        elif element == 2:
            indices, begins = self.corner_points, self.all_point_starts
        else:
            source = self.corner_source
            indices = np.arange(len(self.corner_points)) if source is None else source
            begins = self.all_corner_starts
        shift = value_starts - begins[shape_numbers]
        if len(shape_numbers) < len(self.shapes):
            is_selected = np.zeros(len(self.shapes), bool)
            is_selected[shape_numbers] = True
            indices = indices[np.repeat(is_selected, np.diff(self.corner_starts))]
        return indices + np.repeat(shift, counts) if shift.any() else indices

    def _count_fault(self, number: int, attribute: Attribute) -> str:
        """Return the fault if the interpolation or the number of values is wrong for shape `number`, or else ""."""
        shape, name = self.shapes[number], self._name(number, attribute)
        if attribute.interpolation not in _ELEMENT_NUMBERS:
            names = ", ".join(_ELEMENT_NUMBERS)
            return f"{name} has interpolation {attribute.interpolation!r:.60}; known: {names}"
        counts = (1, len(shape.face_sizes), len(shape.points), len(shape.face_points))
        count = counts[_ELEMENT_NUMBERS[attribute.interpolation]]
        if len(attribute.values) == count:
            return ""
        return f"{name} has {len(attribute.values)} values; interpolation '{attribute.interpolation}' needs {count}"

    def _name(self, number: int, attribute: Attribute) -> str:
        """Return the name of an attribute of shape `number` for a message."""
        prefix = "" if attribute is self.shapes[number].normals else "primvars:"
        return f"{self.shapes[number].name}: {prefix}{attribute.name}"


# The type of element that each value belongs to, by interpolation: 0 is the shape, 1 a face, 2 a point, 3 a corner.
_ELEMENT_NUMBERS = {"constant": 0, "uniform": 1, "varying": 2, "vertex": 2, "faceVarying": 3}


def first_in_runs(positions: Indices, begins: Indices) -> list[tuple[int, int]]:
    """Return a pair for each run that has a position: the run's number, and the first position's offset in the run.

    `positions` are sorted indices into an array of consecutive runs, which start at the indices `begins`.
    """
    owners, first = np.unique(np.searchsorted(begins, positions, side="right") - 1, return_index=True)
    return list(zip(owners.tolist(), (positions[first] - begins[owners]).tolist(), strict=True))


def _check_sizes(shapes: Sequence[PolygonShape], sizes: Indices, face_begins: Indices) -> None:
    """Raise AssetError unless each shape's face sizes add up to its corners, and none is negative.

    `sizes` has the face sizes of all shapes, and `face_begins` (s + 1,) is the index of the first face of each shape.
    """
    total, has_faces = np.zeros(len(shapes), np.intp), np.diff(face_begins) > 0
    total[has_faces] = np.add.reduceat(sizes, face_begins[:-1][has_faces])
    corner_counts = np.array([len(shape.face_points) for shape in shapes])
    wrong = total != corner_counts
    wrong[np.searchsorted(face_begins, np.flatnonzero(sizes < 0), side="right") - 1] = True
    raise_faults(
        f"{shapes[i].name}: faceVertexCounts add up to {total[i]} corners, faceVertexIndices has {corner_counts[i]}; "
        "they must agree, and none may be negative"
        for i in np.flatnonzero(wrong)
    )


def _check_range(
    shapes: Sequence[PolygonShape], indices: Indices, lengths: Indices, limits: Indices, name: str, noun: str
) -> None:
    """Raise AssetError unless the indices of each shape lie in 0..limit-1.

    `indices` has the indices of all shapes, concatenated. `lengths` (s,) is the number of indices of each shape, and
    `limits` (s,) the number of elements that they index. A message names the USD attribute `name` of the indices, and
    the elements by their plural `noun`.
    """
    # A quick check that suffices if all indices are valid in every shape.
    smallest = limits.min()
    if len(indices) == 0 or (indices.min() >= 0 and indices.max() < smallest):
        return
    wrong = np.flatnonzero((indices < 0) | (indices >= np.repeat(limits, lengths)))
    begins = np.cumsum(lengths) - lengths
    raise_faults(
        f"{shapes[i].name}: {name}[{j}] is {indices[begins[i] + j]}, but {index_rule(limits[i], noun)}"
        for i, j in first_in_runs(wrong, begins)
    )


def index_rule(count: int, noun: str) -> str:
    """Return the rule for an index into `count` elements, for a message; `noun` is the plural name of the elements."""
    return f"there are {count} {noun}; it must lie in 0..{count - 1}" if count else f"there are no {noun}"


def raise_faults(faults: Iterable[str]) -> None:
    """Raise an AssetError with a line for each fault, if there are any."""
    if text := "\n".join(faults):
        raise AssetError(text)


def _hole_mask(shapes: Sequence[PolygonShape], face_begins: Indices) -> Bools:
    """Return which faces (f,) of the concatenated shapes are holes; `face_begins` (s + 1,) is as in `_check_sizes`."""
    holes_by_shape = [np.zeros(0, np.intp) if shape.holes is None else shape.holes for shape in shapes]
    lengths, limits = np.array([len(holes) for holes in holes_by_shape]), np.diff(face_begins)
    indices = np.concatenate(holes_by_shape).astype(np.intp)
    _check_range(shapes, indices, lengths, limits, "holeIndices", "faces")
    holes = np.zeros(face_begins[-1], bool)
    holes[indices + np.repeat(face_begins[:-1], lengths)] = True
    return holes


def _distinct_faces(points: Indices, sizes: Indices) -> Bools:
    """Return which faces (f,) have no point twice and do not repeat the corners of an earlier face in the same order.

    Faces are compared by a 64-bit hash, which is the sum of the hashes of a face's directed edges. The sum does not
    depend on the corner with which a face starts. `points` (m,) is the point at each corner; `sizes` (f,) is the number
    of corners of each face.
    """
    distinct, key = np.ones(len(sizes), bool), np.zeros(len(sizes), np.uint64)
    for faces, corners in face_blocks(sizes):
        block_sizes, block_points = sizes[faces], points[corners].astype(np.uint64)
        starts = run_starts(block_sizes)
        # Faces of equal size are compared together.
        for size in block_sizes[:1] if (block_sizes == block_sizes[0]).all() else np.unique(block_sizes):
            faces_of_size = np.flatnonzero(block_sizes == size)
            # Axes: corner of the face, face.
            points_of_faces = block_points[starts[faces_of_size] + np.arange(size)[:, None]]
            sorted_points = np.sort(points_of_faces, axis=0)
            distinct[faces][faces_of_size] = (sorted_points[1:] != sorted_points[:-1]).all(axis=0)
            # A directed edge becomes one number of 64 bits: 32 bits for each of its two points.
            edges = points_of_faces << np.uint64(32) | np.roll(points_of_faces, -1, axis=0)
            # 1 is added since the hash of 0 is 0: an edge from point 0 to itself would not count.
            key[faces][faces_of_size] = mix_bits(edges + np.uint64(1)).sum(axis=0)
    sorted_keys = np.sort(key)
    if (sorted_keys[1:] == sorted_keys[:-1]).any():
        first = np.unique(key, return_index=True)[1]
        is_repeated = np.ones(len(sizes), bool)
        is_repeated[first] = False
        distinct &= ~is_repeated
    return distinct
