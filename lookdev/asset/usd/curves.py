"""Makes tubes of UsdGeom's BasisCurves and NurbsCurves, or ribbons if they have normals, and spheres of Points.

Each segment of a curve is divided into chords between samples: more where it bends, so that the chords deviate from the
segment by about 5e-4 of its length. Tubes have 32 sides. If the curves of one prim would have more than a million
faces, they have fewer sides, then fewer chords, but at least 8 sides and a chord for each segment. Ends are flat and
closed; a tube whose width falls to 0 ends in a point. A curve that ends at its start is closed. `lookdev.asset.tubes`
defines ``st``, which a primvar of that name replaces.

Widths, normals and primvars are interpolated as UsdGeom defines. `vertex` values are interpolated by the curve's basis,
`varying` values linearly over a segment. On NURBS curves, for which UsdGeom does not define `varying`, it means
`vertex`. A single value is constant regardless of its interpolation, as in Hydra. Without widths, the width is 1, as in
RenderMan.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pxr import Usd, UsdGeom

from lookdev.arrays import Bools, Floats, Indices
from lookdev.asset.normals import dot, normalize_or, run_starts
from lookdev.asset.shape import Attribute, PolygonShape
from lookdev.asset.splines import WRAPS, Splines, basis_splines, nurbs_splines
from lookdev.asset.tubes import CurveSamples, ribbons, run_ends, tubes
from lookdev.asset.usd.attributes import check_array, check_interpolation, read_array, read_token
from lookdev.asset.usd.primitives import sphere_shape
from lookdev.errors import AssetError

_TYPES = ("linear", "cubic")
_BASES = ("bezier", "bspline", "catmullRom")  # of cubic curves
_CHORD_TOLERANCE = 5e-4  # the deviation of a chord from its segment, relative to the segment's length
_MAX_CHORDS = 64  # of a segment
_MAX_FACES = 1_000_000  # of the curves of a prim
_SIDES = (32, 16, 8)  # the numbers of sides that tubes can have
_COINCIDENCE = 1e-6  # the distance, relative to a length of the curve, up to which points in float32 coincide


def curve_shape(
    prim: Usd.Prim, time: Usd.TimeCode, unit: float, attributes: Sequence[Attribute] = (), points: Floats | None = None
) -> PolygonShape:
    """Return the curves of a prim at `time` as a shape in metres; `unit` is the length of the stage's unit in metres.

    `attributes` are primvars of the prim, with any indices applied; the shape has them by point, by face or constant.
    `points` (n, 3), in the stage's unit, replace the prim's points. Curves without length or width have no faces.

    Raises
    ------
    AssetError
        Counts of vertices, widths, knots or primvars do not agree, or a value is not a number.
    """
    path = str(prim.GetPath())
    empty = PolygonShape(path, np.zeros((0, 3)), np.zeros(0, np.intp), np.zeros(0, np.intp))
    if points is None:
        points = read_array(prim, "points", time, np.float64, (3,))
    counts = read_array(prim, "curveVertexCounts", time, np.intp)
    if counts.sum() != len(points) or (counts < 0).any():
        raise AssetError(f"{path}: curveVertexCounts add up to {counts.sum()}, but there are {len(points)} points")
    if len(counts) == 0:
        return empty
    splines = _splines(prim, time, counts)
    widths = _widths(prim, time)
    facing = _curve_attribute(prim, "normals", time, 3)

    samples, sides = _sample_curves(splines, points, widths, path, ribbon=facing is not None)
    positions = unit * samples.interpolate_vertices(points)
    # An interpolated width can be negative: a cubic can dip below 0.
    radii = 0.5 * unit * np.maximum(samples.interpolate(widths, f"{path}: widths")[:, 0], 0.0)
    is_used = _has_extent(samples.segments, positions, radii)
    if not is_used.any():
        return empty
    rings, curves = _rings(samples, is_used, positions, radii, unit * samples.derivatives(points))
    facing_rings = None if facing is None else samples.interpolate(facing, f"{path}: normals")[is_used]
    strips = tubes(rings, sides) if facing_rings is None else ribbons(rings, facing_rings)
    point_samples, face_curves = np.flatnonzero(is_used)[strips.point_rings], curves[strips.face_curves]
    mesh_attributes = {"st": Attribute("st", strips.st, "vertex", is_uv=True)}
    for attribute in attributes:
        if attribute.name not in ("widths", "normals"):
            mesh_attributes[attribute.name] = samples.mesh_attribute(
                attribute, f"{path}: primvars:{attribute.name}", point_samples, face_curves
            )
    return PolygonShape(
        name=path,
        points=strips.points,
        face_sizes=strips.face_sizes,
        face_points=strips.face_points,
        attributes=tuple(mesh_attributes.values()),
        normals=Attribute("normals", strips.normals, "vertex"),
    )


def point_shape(
    prim: Usd.Prim, time: Usd.TimeCode, unit: float, error: float = 1e-4, points: Floats | None = None
) -> tuple[PolygonShape, Floats]:
    """Return the sphere that each point of a UsdGeom.Points prim becomes, as a shape in metres, and its placements.

    The sphere has the radius of one unit of the stage. Its placements are matrices (k, 4, 4) for row vectors, which map
    the sphere to the prim's space in the stage's unit, as a PointInstancer does. There is one placement for each point
    of positive width, in order. Ids and normals of points have no effect. `unit` is the length of the stage's unit in
    metres, and `error` is as in `primitive_shape`. `points` (n, 3) replace the prim's points.

    Raises
    ------
    AssetError
        Widths do not fit the points, or a value is not a number.
    """
    path = str(prim.GetPath())
    if points is None:
        points = read_array(prim, "points", time, np.float64, (3,))
    widths = _widths(prim, time).values[:, 0]
    if len(widths) not in (1, len(points)):
        raise AssetError(f"{path}: there are {len(widths)} widths, but {len(points)} points")
    radii = np.broadcast_to(0.5 * widths, len(points))
    matrices = np.zeros((len(points), 4, 4))
    matrices[:, [0, 1, 2], [0, 1, 2]] = radii[:, None]
    matrices[:, 3, :3] = points
    matrices[:, 3, 3] = 1.0
    return sphere_shape(path, unit, error), matrices[radii > 0.0]


@dataclass(frozen=True, eq=False)
class _Samples:
    """The r samples of the curves in `splines`.

    - segments, t (r,): the segment of each sample, and the sample's parameter in the segment, from 0 to 1
    - index, weights, rates (r, k): the results of `Splines.evaluate`
    """

    splines: Splines
    segments: Indices
    t: Floats
    index: Indices
    weights: Floats
    rates: Floats

    @classmethod
    def evaluate(cls, splines: Splines, chords: Indices) -> _Samples:
        """Return samples that divide each segment (s,) into the given number of chords (s,), in equal steps of t."""
        segments = np.repeat(np.arange(len(chords)), chords + 1)
        t = (np.arange(len(segments)) - run_starts(chords + 1)[segments]) / chords[segments]
        return cls(splines, segments, t, *splines.evaluate(segments, t))

    @property
    def curves(self) -> Indices:
        """The number (r,) of each sample's curve."""
        counts = self.splines.segment_counts
        return np.repeat(np.arange(len(counts)), counts)[self.segments]

    def interpolate_vertices(self, values: Floats) -> Floats:
        """Return the values (r, c) at the samples from the values of the vertices (n, c)."""
        return np.asarray(np.einsum("rk,rkc->rc", self.weights, self.splines.with_phantoms(values)[self.index]))

    def derivatives(self, values: Floats) -> Floats:
        """Return the derivatives (r, c) by t at the samples from the values of the vertices (n, c)."""
        return np.asarray(np.einsum("rk,rkc->rc", self.rates, self.splines.with_phantoms(values)[self.index]))

    def interpolate(self, attribute: Attribute, label: str) -> Floats:
        """Return the values (r, c) of an attribute at the samples.

        Raises AssetError for a wrong number of values; the message names the attribute by `label`.
        """
        count, interpolation = len(attribute.values), attribute.interpolation
        values = np.asarray(attribute.values, np.float64).reshape(count, -1)
        if count == 1:
            return np.broadcast_to(values, (len(self.t), values.shape[1]))
        if interpolation == "varying" and self.splines.varying:
            return self._interpolate_varying(values, label)
        vertex_count = int(self.splines.vertex_counts.sum())
        counts = {"uniform": len(self.splines.vertex_counts), "vertex": vertex_count, "varying": vertex_count}
        if count != (expected := counts.get(interpolation, 1)):
            raise AssetError(f"{label} has {count} values; interpolation '{interpolation}' of curves needs {expected}")
        return values[self.curves] if interpolation == "uniform" else self.interpolate_vertices(values)

    def _interpolate_varying(self, values: Floats, label: str) -> Floats:
        """Return the result of `interpolate` for values (n, c) at the ends of segments, linear over each segment."""
        # For each sample: `number` is the number, in its curve, of the value at the start of the segment, and
        # `following` the number of the value at the end.
        splines, curves = self.splines, self.curves
        number = self.segments - run_starts(splines.segment_counts)[curves]
        counts = splines.segment_counts + (not splines.periodic)
        following = (number + 1) % counts[curves]
        if len(values) != (expected := int(counts.sum())):
            # For pinned curves, UsdGeom counts the values as if there were no phantom vertices. The segments at the
            # phantom vertices then repeat the values at the ends.
            counts = np.maximum(splines.vertex_counts - 4, 0) + 2
            if not splines.pinned or len(values) != counts.sum():
                raise AssetError(
                    f"{label} has {len(values)} values; interpolation 'varying' of curves needs {expected}"
                )
            last = counts[curves] - 1
            number, following = np.clip(number - 1, 0, last), np.clip(number, 0, last)
        first = run_starts(counts)[curves]
        t = self.t[:, None]
        return np.asarray((1.0 - t) * values[first + number] + t * values[first + following])

    def mesh_attribute(self, attribute: Attribute, label: str, samples: Indices, curves: Indices) -> Attribute:
        """Return an attribute of the shape for an attribute of the curves.

        `samples` (n,) is the sample of each point of the shape, `curves` (f,) the curve of each face.
        """
        values, interpolation = self.interpolate(attribute, label), attribute.interpolation
        if len(attribute.values) == 1:
            return Attribute(attribute.name, attribute.values, "constant", attribute.is_uv)
        if interpolation == "uniform":
            return Attribute(attribute.name, attribute.values[curves], interpolation, attribute.is_uv)
        by_point = values[samples].reshape(-1, *attribute.values.shape[1:])
        return Attribute(attribute.name, by_point, "vertex", attribute.is_uv)


def _sample_curves(
    splines: Splines, points: Floats, widths: Attribute, path: str, ribbon: bool
) -> tuple[_Samples, int]:
    """Return samples that are denser where the curves or their radii bend, and the number of sides, 1 for a ribbon."""
    # Each segment is first divided into 4 chords. Axes of `samples`: segment, sample in it, coordinates and radius.
    coarse = _Samples.evaluate(splines, np.full(int(splines.segment_counts.sum()), 4))
    points_and_radii = np.hstack(
        [coarse.interpolate_vertices(points), 0.5 * coarse.interpolate(widths, f"{path}: widths")]
    )
    samples = points_and_radii.reshape(-1, 5, 4)
    # The second derivative by t, from second differences at steps of 1/4 in t, and the length of each segment.
    bends = 16.0 * np.linalg.norm(samples[:, 2:] - 2.0 * samples[:, 1:-1] + samples[:, :-2], axis=2).max(axis=1)
    lengths = np.linalg.norm(np.diff(samples, axis=1), axis=2).sum(axis=1)
    # A chord deviates from a curve by at most its second derivative times the square of the step in t, over 8.
    chords = np.sqrt(bends / (8.0 * _CHORD_TOLERANCE * np.where(lengths > 0.0, lengths, 1.0)))
    chords = np.clip(np.ceil(chords), 1.0, _MAX_CHORDS)
    sides = 1 if ribbon else next((n for n in _SIDES if n * chords.sum() <= _MAX_FACES), _SIDES[-1])
    reduction = min(1.0, _MAX_FACES / (sides * chords.sum()))
    return _Samples.evaluate(splines, np.maximum(np.floor(reduction * chords), 1.0).astype(np.intp)), sides


def _has_extent(segments: Indices, positions: Floats, radii: Floats) -> Bools:
    """Return which samples (r,) belong to segments that have a length and, at some sample, a width."""
    starts = np.flatnonzero(np.diff(segments, prepend=-1))
    has_extent = (_path_lengths(positions, starts) > 0.0) & (np.maximum.reduceat(radii, starts) > 0.0)
    return np.asarray(has_extent[segments])


def _path_lengths(positions: Floats, starts: Indices) -> Floats:
    """Return the length (k,) of each of k consecutive polylines through positions (r, 3).

    `starts` (k,) are the indices at which the polylines start.
    """
    steps = np.linalg.norm(np.diff(positions, axis=0, prepend=positions[:1]), axis=1)
    steps[starts] = 0.0
    return np.add.reduceat(steps, starts)


def _rings(
    samples: _Samples, is_used: Bools, positions: Floats, radii: Floats, slopes: Floats
) -> tuple[CurveSamples, Indices]:
    """Return rings at the samples that are used, and, for each of the rings' c curves, its number (c,) in `samples`.

    `slopes` (r, 3) are the derivatives of the positions by t.
    """
    positions, radii, slopes, t = positions[is_used], radii[is_used], slopes[is_used], samples.t[is_used]
    _, pieces = np.unique(samples.segments[is_used], return_inverse=True)
    numbers, curves = np.unique(samples.curves[is_used], return_inverse=True)
    is_first = np.diff(pieces, prepend=-1) != 0
    index = np.arange(len(pieces))
    # The neighbours of each ring in its piece; at an end of the piece, one of them is the ring itself.
    before, after = index - ~is_first, index + ~np.append(is_first[1:], True)
    # Where the derivative is nearly 0, the chord between the neighbours gives the direction. The derivative is 0 at a
    # vertex that coincides with the next vertex.
    chords = positions[after] - positions[before]
    is_slow = dot(slopes, slopes) <= dot(chords, chords) * (_COINCIDENCE / (t[after] - t[before])[:, None]) ** 2
    directions = normalize_or(np.where(is_slow, chords, slopes), np.array([0.0, 0.0, 1.0]))
    # A curve is closed if its ends agree in position, radius and direction.
    first, last = run_ends(curves)
    gaps = np.linalg.norm(positions[first] - positions[last], axis=1) / _path_lengths(positions, first)
    is_closed = (gaps < _COINCIDENCE) & (np.abs(radii[first] - radii[last]) <= _COINCIDENCE * radii[first])
    is_closed &= (directions[first] * directions[last]).sum(axis=1) > 0.0
    return CurveSamples(positions, directions, radii, pieces, curves, is_closed | samples.splines.periodic), numbers


def _splines(prim: Usd.Prim, time: Usd.TimeCode, counts: Indices) -> Splines:
    """Return the splines of a prim's curves; `counts` (c,) are the numbers of the curves' vertices."""
    path = str(prim.GetPath())
    if prim.IsA(UsdGeom.NurbsCurves):
        orders, knots = read_array(prim, "order", time, np.intp), read_array(prim, "knots", time, np.float64)
        ranges = read_array(prim, "ranges", time, np.float64, (2,))
        weights = read_array(prim, "pointWeights", time, np.float64)
        return nurbs_splines(counts, orders, knots, ranges, weights, path)
    is_linear = read_token(prim, "type", time, _TYPES) == "linear"
    basis = "linear" if is_linear else read_token(prim, "basis", time, _BASES)
    return basis_splines(basis, read_token(prim, "wrap", time, WRAPS), counts, path)


def _widths(prim: Usd.Prim, time: Usd.TimeCode) -> Attribute:
    """Return the widths (k, 1) of a prim, or a single width of 1."""
    widths = _curve_attribute(prim, "widths", time, 1) or Attribute("widths", np.ones((1, 1)), "constant")
    if (widths.values < 0.0).any():
        raise AssetError(f"{prim.GetPath()}: widths[{int(widths.values.argmin())}] is negative; it must be at least 0")
    return widths


def _curve_attribute(prim: Usd.Prim, name: str, time: Usd.TimeCode, width: int) -> Attribute | None:
    """Return the values (k, width) of the primvar `name`, which may be inherited, or else of the attribute `name`.

    Return None if there are no values.
    """
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
    if primvar and primvar.HasValue():
        attribute, interpolation = primvar.GetAttr(), primvar.GetInterpolation()
        value = primvar.ComputeFlattened(time)
    else:
        attribute = prim.GetAttribute(name)
        value, interpolation = attribute.Get(time), attribute.GetMetadata("interpolation") or UsdGeom.Tokens.vertex
    shape = (width,) if width > 1 else ()
    values = check_array(value, attribute.GetPrim(), attribute.GetName(), np.float64, shape).reshape(-1, width)
    if len(values) == 0:
        return None
    return Attribute(name, values, check_interpolation(attribute.GetPrim(), attribute.GetName(), interpolation))
