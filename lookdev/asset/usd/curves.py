"""UsdGeom's BasisCurves and NurbsCurves as tubes, or as ribbons where they have normals; Points as spheres.

A curve is sampled where it bends: chords deviate from a segment by about 5e-4 of its length. Tubes have 32 sides, but
fewer sides, and then fewer chords, where the curves of one prim would have more than a million faces; at least 8 sides
and a chord for each segment. Ends are flat and closed; where the width is 0, a tube ends in a point. A curve that ends
where it began is closed. `lookdev.asset.tubes` states ``st``, which a primvar of that name replaces.

Widths, normals and primvars are interpolated as UsdGeom defines it: `vertex` ones by the curve's basis, `varying` ones
linearly over a segment (on NURBS, for which UsdGeom does not define it, as `vertex`). A single value is constant
whatever its interpolation, as in Hydra. Without widths, the width is 1, as in RenderMan.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import UsdGeom

from lookdev.asset.normals import dot, unit_or
from lookdev.asset.shape import Attribute, Doubles, Index, Shape
from lookdev.asset.splines import WRAPS, Splines, basis_splines, nurbs_splines, starts_of
from lookdev.asset.tubes import Rings, ribbons, tubes
from lookdev.asset.usd.attributes import check_interpolation, checked_array, read_array, read_token
from lookdev.asset.usd.primitives import sphere_shape
from lookdev.errors import AssetError

_TOKENS = (("type", ("linear", "cubic")), ("basis", ("bezier", "bspline", "catmullRom")), ("wrap", WRAPS))
_TOLERANCE = 5e-4
_MOST_CHORDS = 64
_MOST_FACES = 1_000_000
_SIDES = (32, 16, 8)
_CLOSE = 1e-6  # relative; points of float32 that are the same


def curve_shape(
    prim: Any, time: Any, unit: float, attributes: Sequence[Attribute] = (), points: Doubles | None = None
) -> Shape:
    """Return the curves of a prim at a time as a mesh in metres; `unit` is the length of the stage's unit in metres.

    `attributes` are primvars of the prim, any indices applied; the mesh has them by point or by face. `points` (n, 3),
    in the stage's unit, replace those of the prim. Curves without length or width have no faces.

    Raises
    ------
    AssetError
        Counts of vertices, widths, knots or primvars do not agree, or a value is not a number.
    """
    where = str(prim.GetPath())
    nothing = Shape(where, np.zeros((0, 3)), np.zeros(0, np.intp), np.zeros(0, np.intp))
    if points is None:
        points = read_array(prim, "points", time, np.float64, (3,))
    counts = read_array(prim, "curveVertexCounts", time, np.intp)
    if counts.sum() != len(points) or (counts < 0).any():
        raise AssetError(f"{where}: curveVertexCounts add up to {counts.sum()}, but there are {len(points)} points")
    if len(counts) == 0:
        return nothing
    splines = _splines(prim, time, counts)
    widths = _widths(prim, time)
    facing = _shaping(prim, "normals", time, 3)

    samples, sides = _sampled(splines, points, widths, where, ribbon=facing is not None)
    positions = unit * samples.vertices(points)
    radii = 0.5 * unit * np.maximum(samples.of(widths, f"{where}: widths")[:, 0], 0.0)  # a cubic can dip below 0
    kept = _kept(samples.segments, positions, radii)
    if not kept.any():
        return nothing
    rings, curves = _rings(samples, kept, positions, radii, unit * samples.slopes(points))
    facing_rings = None if facing is None else samples.of(facing, f"{where}: normals")[kept]
    strips = tubes(rings, sides) if facing_rings is None else ribbons(rings, facing_rings)
    point_samples, face_curves = np.flatnonzero(kept)[strips.point_rings], curves[strips.face_curves]
    carried = {"st": Attribute("st", strips.st, "vertex", is_uv=True)}
    for each in attributes:
        if each.name not in ("widths", "normals"):
            carried[each.name] = samples.carried(each, f"{where}: primvars:{each.name}", point_samples, face_curves)
    return Shape(
        name=where,
        points=strips.points,
        face_sizes=strips.face_sizes,
        face_points=strips.face_points,
        attributes=tuple(carried.values()),
        normals=Attribute("normals", strips.normals, "vertex"),
    )


def point_shape(
    prim: Any, time: Any, unit: float, error: float = 1e-4, points: Doubles | None = None
) -> tuple[Shape, Doubles]:
    """Return a sphere in metres for UsdGeom.Points, and where it is seen: matrices (k, 4, 4) for row vectors.

    The sphere has the radius of one unit of the stage, and the matrices map it to the prim's space in that unit, as
    those of a PointInstancer do: one for each point of a positive width, in their order. Ids and normals of points do
    not matter. `error` is that of `primitive_shape`; `points` (n, 3) replace those of the prim.

    Raises
    ------
    AssetError
        Widths do not fit the points, or a value is not a number.
    """
    where = str(prim.GetPath())
    if points is None:
        points = read_array(prim, "points", time, np.float64, (3,))
    widths = _widths(prim, time).values[:, 0]
    if len(widths) not in (1, len(points)):
        raise AssetError(f"{where}: there are {len(widths)} widths, but {len(points)} points")
    radii = np.broadcast_to(0.5 * widths, len(points))
    placed = np.zeros((len(points), 4, 4))
    placed[:, [0, 1, 2], [0, 1, 2]] = radii[:, None]
    placed[:, 3, :3] = points
    placed[:, 3, 3] = 1.0
    return sphere_shape(where, unit, error), placed[radii > 0.0]


@dataclass(frozen=True, eq=False)
class _Samples:
    """Samples (r,) of curves: their segment, t in it, and what `Splines.at` returns for them."""

    splines: Splines
    segments: Index
    t: Doubles
    index: Index
    weights: Doubles
    rates: Doubles

    @classmethod
    def at(cls, splines: Splines, chords: Index) -> _Samples:
        """Return the samples between which each segment (s,) has a number of chords of equal t."""
        segments = np.repeat(np.arange(len(chords)), chords + 1)
        t = (np.arange(len(segments)) - starts_of(chords + 1)[segments]) / chords[segments]
        return cls(splines, segments, t, *splines.at(segments, t))

    @property
    def curves(self) -> Index:
        counts = self.splines.segment_counts
        return np.repeat(np.arange(len(counts)), counts)[self.segments]

    def vertices(self, values: Doubles) -> Doubles:
        """Return values (r, c) from those of the vertices (n, c)."""
        return np.asarray(np.einsum("rk,rkc->rc", self.weights, self.splines.with_phantoms(values)[self.index]))

    def slopes(self, values: Doubles) -> Doubles:
        """Return derivatives by t (r, c) from the values of the vertices (n, c)."""
        return np.asarray(np.einsum("rk,rkc->rc", self.rates, self.splines.with_phantoms(values)[self.index]))

    def of(self, attribute: Attribute, what: str) -> Doubles:
        """Return the values (r, c) of an attribute of the curves; AssetError where their number is wrong."""
        count, kind = len(attribute.values), attribute.interpolation
        values = np.asarray(attribute.values, np.float64).reshape(count, -1)
        if count == 1:
            return np.broadcast_to(values, (len(self.t), values.shape[1]))
        if kind == "varying" and self.splines.varying:
            return self._varying(values, what)
        vertex_count = int(self.splines.vertex_counts.sum())
        needed = {"uniform": len(self.splines.vertex_counts), "vertex": vertex_count, "varying": vertex_count}
        if count != needed.get(kind, 1):
            raise AssetError(f"{what} has {count} values; interpolation '{kind}' of curves needs {needed.get(kind, 1)}")
        return values[self.curves] if kind == "uniform" else self.vertices(values)

    def _varying(self, values: Doubles, what: str) -> Doubles:
        splines, curves = self.splines, self.curves
        number = self.segments - starts_of(splines.segment_counts)[curves]
        counts = splines.segment_counts + (not splines.periodic)
        following = (number + 1) % counts[curves]
        if len(values) != (needed := int(counts.sum())):
            # UsdGeom counts the values of pinned curves as if they had no phantoms: those repeat the ends.
            counts = np.maximum(splines.vertex_counts - 4, 0) + 2
            if not splines.pinned or len(values) != counts.sum():
                raise AssetError(f"{what} has {len(values)} values; interpolation 'varying' of curves needs {needed}")
            last = counts[curves] - 1
            number, following = np.clip(number - 1, 0, last), np.clip(number, 0, last)
        first = starts_of(counts)[curves]
        t = self.t[:, None]
        return np.asarray((1.0 - t) * values[first + number] + t * values[first + following])

    def carried(self, attribute: Attribute, what: str, samples: Index, curves: Index) -> Attribute:
        """Return an attribute of a mesh by the sample of each of its points (n,) and the curve of each face (f,)."""
        values, kind = self.of(attribute, what), attribute.interpolation
        if len(attribute.values) == 1:
            return Attribute(attribute.name, attribute.values, "constant", attribute.is_uv)
        if kind == "uniform":
            return Attribute(attribute.name, attribute.values[curves], kind, attribute.is_uv)
        by_point = values[samples].reshape(-1, *attribute.values.shape[1:])
        return Attribute(attribute.name, by_point, "vertex", attribute.is_uv)


def _sampled(splines: Splines, points: Doubles, widths: Attribute, where: str, ribbon: bool) -> tuple[_Samples, int]:
    """Return samples of curves, closer where they or their radii bend, and the number of sides of a tube."""
    probe = _Samples.at(splines, np.full(int(splines.segment_counts.sum()), 4))
    path = np.hstack([probe.vertices(points), 0.5 * probe.of(widths, f"{where}: widths")]).reshape(-1, 5, 4)
    bend = 16.0 * np.linalg.norm(path[:, 2:] - 2.0 * path[:, 1:-1] + path[:, :-2], axis=2).max(axis=1)
    length = np.linalg.norm(np.diff(path, axis=1), axis=2).sum(axis=1)
    # A chord deviates from a curve by at most its second derivative times the square of the step in t, over 8.
    chords = np.sqrt(bend / (8.0 * _TOLERANCE * np.where(length > 0.0, length, 1.0)))
    chords = np.clip(np.ceil(chords), 1.0, _MOST_CHORDS)
    sides = 1 if ribbon else next((n for n in _SIDES if n * chords.sum() <= _MOST_FACES), _SIDES[-1])
    fewer = min(1.0, _MOST_FACES / (sides * chords.sum()))
    return _Samples.at(splines, np.maximum(np.floor(fewer * chords), 1.0).astype(np.intp)), sides


def _kept(segments: Index, positions: Doubles, radii: Doubles) -> NDArray[np.bool_]:
    """Return which samples (r,) are of segments that have a length and a width."""
    starts = np.flatnonzero(np.diff(segments, prepend=-1))
    solid = (_path_lengths(positions, starts) > 0.0) & (np.maximum.reduceat(radii, starts) > 0.0)
    return np.asarray(solid[segments])


def _path_lengths(positions: Doubles, starts: Index) -> Doubles:
    """Return the length of each path through positions (r, 3), from where it starts to the next one."""
    steps = np.linalg.norm(np.diff(positions, axis=0, prepend=positions[:1]), axis=1)
    steps[starts] = 0.0
    return np.add.reduceat(steps, starts)


def _rings(
    samples: _Samples, kept: NDArray[np.bool_], positions: Doubles, radii: Doubles, slopes: Doubles
) -> tuple[Rings, Index]:
    """Return rings at the samples that are kept, and which of the splines each of their curves is."""
    positions, radii, slopes, t = positions[kept], radii[kept], slopes[kept], samples.t[kept]
    _, pieces = np.unique(samples.segments[kept], return_inverse=True)
    numbers, curves = np.unique(samples.curves[kept], return_inverse=True)
    begins = np.diff(pieces, prepend=-1) != 0
    here = np.arange(len(pieces))
    before, after = here - ~begins, here + ~np.append(begins[1:], True)
    # The derivative is 0 at a vertex that its neighbour coincides with.
    chords = positions[after] - positions[before]
    still = dot(slopes, slopes) <= dot(chords, chords) * (_CLOSE / (t[after] - t[before])[:, None]) ** 2
    directions = unit_or(np.where(still, chords, slopes), np.array([0.0, 0.0, 1.0]))
    first = np.flatnonzero(np.diff(curves, prepend=-1))
    last = np.append(first[1:], len(curves)) - 1
    gaps = np.linalg.norm(positions[first] - positions[last], axis=1) / _path_lengths(positions, first)
    meets = (gaps < _CLOSE) & (np.abs(radii[first] - radii[last]) <= _CLOSE * radii[first])
    meets &= (directions[first] * directions[last]).sum(axis=1) > 0.0
    return Rings(positions, directions, radii, pieces, curves, meets | samples.splines.periodic), numbers


def _splines(prim: Any, time: Any, counts: Index) -> Splines:
    where = str(prim.GetPath())
    if prim.IsA(UsdGeom.NurbsCurves):
        orders, knots = read_array(prim, "order", time, np.intp), read_array(prim, "knots", time, np.float64)
        ranges = read_array(prim, "ranges", time, np.float64, (2,))
        weights = read_array(prim, "pointWeights", time, np.float64)
        return nurbs_splines(counts, orders, knots, ranges, weights, where)
    kind, basis, wrap = (read_token(prim, name, time, known) for name, known in _TOKENS)
    return basis_splines(kind if kind == "linear" else basis, wrap, counts, where)


def _widths(prim: Any, time: Any) -> Attribute:
    """Return widths (k, 1)."""
    widths = _shaping(prim, "widths", time, 1) or Attribute("widths", np.ones((1, 1)), "constant")
    if (widths.values < 0.0).any():
        raise AssetError(f"{prim.GetPath()}: widths[{int(widths.values.argmin())}] is negative; it must be at least 0")
    return widths


def _shaping(prim: Any, name: str, time: Any, width: int) -> Attribute | None:
    """Return values (k, width) that shape curves: a primvar of the name, maybe inherited, else the attribute."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
    if primvar and primvar.HasValue():
        attribute, kind = primvar.GetAttr(), primvar.GetInterpolation()
        value = primvar.ComputeFlattened(time)
    else:
        attribute = prim.GetAttribute(name)
        value, kind = attribute.Get(time), attribute.GetMetadata("interpolation") or UsdGeom.Tokens.vertex
    shape = (width,) if width > 1 else ()
    values = checked_array(value, attribute.GetPrim(), attribute.GetName(), np.float64, shape).reshape(-1, width)
    if len(values) == 0:
        return None
    return Attribute(name, values, check_interpolation(attribute.GetPrim(), attribute.GetName(), kind))
