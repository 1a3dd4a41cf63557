"""Chooses the refinement levels of an asset's cages by their size in the frame.

Each refinement halves the edges. A refinement also divides the distance between the limit surface and the chord of an
edge by four, and the angle by which the surface turns along an edge by two. Distance and angle are measured at the
cage's edges, on the limit surface itself. At the chosen level, the distance is at most `SURFACE_TOLERANCE` pixels, and
the angle is at most `MAX_TURN` or the edge at most `SMALL_EDGE` pixels long. The edges that need the highest levels, up
to `OUTLIER_FRACTION` of the total length, may need one level more than the chosen level.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lookdev.arrays import Bools, Floats, Floats32, Indices
from lookdev.asset.mesh import Asset, Instance, Mesh
from lookdev.asset.normals import next_corners, run_starts
from lookdev.asset.subdivision.batch import group_cages, join_cages
from lookdev.asset.subdivision.cage import build_cage
from lookdev.asset.subdivision.limit import complete_normals, limit_surface
from lookdev.asset.subdivision.refine import mask_rules, refined_values
from lookdev.asset.subdivision.rules import interpolate
from lookdev.asset.subdivision.topology import HalfEdges, first_child, split_faces

SURFACE_TOLERANCE = 0.1
"""Pixels between the limit surface and its facets: not visible in an antialiased silhouette."""

MAX_TURN = 0.1
"""Radians from one end of an edge to the other: a larger turn is visible at a terminator despite smooth normals."""

SMALL_EDGE = 3.0
"""Pixels: a shorter edge may turn by any angle."""

OUTLIER_FRACTION = 0.01
"""The fraction of a cage's edge length that may need one level more: a few sharp bends must not refine all of it."""

UV_TOLERANCE = 0.5
"""Pixels by which a texture may shift on an unrefined cage, whose UVs are linear over a face."""

DISPLACED_EDGE = 2.0
"""Pixels: the greatest length of an edge of a displaced mesh."""

MAX_LEVEL = 6
"""The highest level of a mesh that is not displaced."""

MAX_DISPLACED_LEVEL = 10
"""The highest level of a displaced mesh: sufficient for a single face in a frame of more than a thousand pixels."""

MAX_CORNERS = 8_000_000
"""The greatest number of refined corners of an asset, which need about 2 GB during refinement."""

PixelSize = Callable[[Floats, Floats], Floats]
"""A function of the centres (k, 3), in world space, and the radii (k,) of spheres.

It returns metres per pixel (k,) at the point of each sphere that is nearest to the camera, over the whole turntable.
"""


@dataclass(frozen=True)
class Refinement:
    """The level of each mesh of an asset, 0 for a mesh without subdivision, and notes for the user."""

    levels: tuple[int, ...]
    notes: tuple[str, ...] = ()


def orbit_pixel_size(position: Sequence[float], pivot: Sequence[float], slope: float) -> PixelSize:
    """Return the pixel size of a camera that orbits on a turntable.

    Parameters
    ----------
    position, pivot
        A position of the camera (3,), and x and y of the vertical axis that the camera orbits, in metres. For a camera
        that does not move, `pivot` is its own x and y.
    slope
        The width of a pixel at depth 1: the frame's width at that depth divided by the number of pixels.
    """
    # The camera moves on a horizontal circle, with this radius about the axis and at this height.
    offset = np.asarray(position[:2], np.float64) - pivot[:2]
    radius, height = float(np.hypot(*offset)), float(position[2])

    def pixel_size(centers: Floats, radii: Floats) -> Floats:
        from_axis = np.hypot(centers[:, 0] - pivot[0], centers[:, 1] - pivot[1])
        nearest = np.hypot(from_axis - radius, centers[:, 2] - height) - radii
        return np.asarray(slope * np.maximum(nearest, 0.0))

    return pixel_size


def refinement_levels(
    asset: Asset,
    pixel_size: PixelSize,
    displaced: Collection[int] = (),
    max_level: int = MAX_LEVEL,
    max_corners: int = MAX_CORNERS,
) -> Refinement:
    """Return, for each mesh, the level at which it looks like its limit surface where it is nearest to the camera.

    A mesh has one level for all its instances. The edges of displaced meshes, whose numbers are `displaced`, become at
    most `DISPLACED_EDGE` pixels long. No level is above `max_level`, or above `MAX_DISPLACED_LEVEL` for displaced
    meshes. If the asset would have more than `max_corners` refined corners, the meshes with the most corners are
    refined less, and a note reports it.

    Raises
    ------
    AssetError
        A tag of a cage is wrong (`cage.read_tags`).
    """
    # Cages are examined at level 1. A cage that would exceed `max_corners` at level 1 is not examined and gets level 1.
    # Of the others, the surface decides the level; cages that would stay at level 0 are examined for their UVs, too.
    cages = [i for i, mesh in enumerate(asset.meshes) if mesh.subdivision is not None]
    levels = np.zeros(len(asset.meshes), np.intp)
    sizes = _pixel_sizes(asset.meshes, asset.instances, pixel_size)
    is_displaced = np.isin(np.arange(len(levels)), list(displaced))
    longest_edges = np.where(is_displaced, DISPLACED_EDGE, np.inf)
    max_levels = np.where(is_displaced, MAX_DISPLACED_LEVEL, max_level)
    refinable = [i for i in cages if 4 * len(asset.meshes[i].corner_points) <= max_corners]
    bare_cages = [replace(asset.meshes[i], uvs={}, primvars={}) for i in refinable]
    for batch, _ in group_cages(bare_cages, [1] * len(bare_cages)):
        numbers = np.array(refinable)[batch]
        batch_cages = [bare_cages[i] for i in batch]
        levels[numbers] = _surface_levels(batch_cages, sizes[numbers], longest_edges[numbers], max_levels[numbers])
    unrefined = [i for i in refinable if levels[i] == 0 and asset.meshes[i].uvs]
    textured_cages = [replace(asset.meshes[i], primvars={}) for i in unrefined]
    for batch, _ in group_cages(textured_cages, [1] * len(unrefined)):
        numbers = np.array(unrefined)[batch]
        levels[numbers] = _texture_levels([textured_cages[i] for i in batch], sizes[numbers], max_level)
    levels[list(set(cages) - set(refinable))] = min(1, max_level)
    desired = levels.tolist()
    limited = _limit_corners([len(mesh.corner_points) for mesh in asset.meshes], desired, max_corners)
    reduced = [i for i in cages if limited[i] < desired[i]]
    notes = (_reduction_note(asset.meshes, reduced, desired, limited, max_corners),) if reduced else ()
    return Refinement(tuple(limited), notes)


def _pixel_sizes(meshes: Sequence[Mesh], instances: Sequence[Instance], pixel_size: PixelSize) -> Floats:
    """Return metres of object space per pixel for each mesh (k,): the least over its instances, or infinity."""
    sizes = np.full(len(meshes), np.inf)
    if not instances:
        return sizes
    boxes = [np.array([mesh.points.min(axis=0), mesh.points.max(axis=0)], np.float64) for mesh in meshes]
    mesh_numbers = np.array([instance.mesh for instance in instances])
    matrices = np.stack([instance.matrix for instance in instances])
    centers = np.stack([box.mean(axis=0) for box in boxes])[mesh_numbers]
    radii = np.array([0.5 * np.linalg.norm(np.ptp(box, axis=0)) for box in boxes])[mesh_numbers]
    stretch = np.linalg.norm(matrices[:, :3, :3], ord=2, axis=(1, 2))
    world = np.einsum("kij,kj->ki", matrices[:, :3, :3], centers) + matrices[:, :3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        instance_sizes = np.where(stretch > 0.0, pixel_size(world, radii * stretch) / stretch, np.inf)
    np.minimum.at(sizes, mesh_numbers, instance_sizes)
    return sizes


def _surface_levels(meshes: list[Mesh], pixel_sizes: Floats, longest_edges: Floats, max_levels: Indices) -> Indices:
    """Return the level (k,) that the surface of each of k cages needs.

    The cages have equal rules, and neither UVs nor primvars. `pixel_sizes` (k,) are metres of object space per pixel.
    `longest_edges` (k,) are the greatest allowed lengths of edges, in pixels. `max_levels` (k,) are the highest allowed
    levels.
    """
    subdivision = meshes[0].subdivision
    assert subdivision is not None, "a batch has cages only"
    control, rules = join_cages(meshes), mask_rules(subdivision)
    cage = build_cage(control, subdivision)
    half_edges = cage.half_edges
    # The number of the mesh of each face.
    mesh_numbers = np.repeat(np.arange(len(meshes)), [len(mesh.face_sizes) for mesh in meshes])
    # The limit surface at the points of level 1: the points, edges' middles and, for quads, faces' centres of the cage.
    child = split_faces(half_edges, rules.triangles)
    limits, normals = limit_surface(child, interpolate(half_edges, control.points, rules), rules)
    complete_normals(child, limits, normals)

    # From here to `required`, arrays are over the half-edges of the cage (m,), which has level 0. `distance` is the
    # distance between the limit surface and the half-edge's chord. Corners of `child`: `first` is at the start of a
    # half-edge, `first` + 1 at its middle, and `first` + 2, for quads, at the face's centre.
    first = first_child(np.arange(len(half_edges.points)), rules.triangles)
    start, middle = limits[half_edges.points], limits[len(control.points) + half_edges.edges]
    turn = _turn_angles(half_edges, normals, first)
    chord = start[half_edges.next] - start
    length = np.linalg.norm(chord, axis=1)
    offset = middle - 0.5 * (start + start[half_edges.next])
    # At a boundary or crease, the line itself is visible, and so is any offset across the chord. Elsewhere, only an
    # offset along the normal is visible, not one within the surface.
    is_feature = (half_edges.twins < 0) | (half_edges.edge_sharpness[half_edges.edges] > 0.0)
    along = np.einsum("ij,ij->i", offset, chord) / np.maximum(length, np.finfo(np.float64).tiny)
    across = np.sqrt(np.maximum(np.einsum("ij,ij->i", offset, offset) - along**2, 0.0))
    distance = np.where(is_feature, across, np.abs(np.einsum("ij,ij->i", offset, normals[first + 1])))
    if rules.triangles:
        # On a sphere, the centre of an equilateral triangle is 4/3 as far from the surface as the middles of its edges.
        distance *= 4.0 / 3.0
    else:
        means = np.add.reduceat(start, run_starts(half_edges.sizes), axis=0) / half_edges.sizes[:, None]
        center_offset = limits[len(limits) - len(half_edges.sizes) :] - means
        center_offsets = center_offset[half_edges.faces]
        distance = np.maximum(distance, np.abs(np.einsum("ij,ij->i", center_offsets, normals[first + 2])))

    edge_meshes = mesh_numbers[half_edges.faces]  # the number of the mesh of each half-edge
    size = pixel_sizes[edge_meshes]
    with np.errstate(divide="ignore", invalid="ignore"):
        by_distance = np.log2(distance / (SURFACE_TOLERANCE * size)) / 2.0
        # At a semi-sharp feature, the whole turn stays on one edge until the sharpness has decayed, while the edge is
        # halved at each level. The sagitta of the arc, about length * turn / 8, is therefore halved at the first
        # `delay` levels, and divided by four only afterwards.
        arc, delay = np.log2(length * turn / (8.0 * SURFACE_TOLERANCE * size)), _sharpness_delay(half_edges)
        by_arc = np.where(delay > 0.0, np.minimum(arc, 0.5 * (arc + delay)), 0.0)
        by_turn = np.minimum(np.log2(turn / MAX_TURN) + np.ceil(delay), np.log2(length / (SMALL_EDGE * size)))
        by_length = np.log2(length / (longest_edges[edge_meshes] * size))
        is_far_from_limit = np.linalg.norm(start - control.points[half_edges.points], axis=1) > SURFACE_TOLERANCE * size
    required = np.where(is_far_from_limit, 1.0, 0.0)
    for criterion in (by_distance, by_arc, by_turn, by_length):
        required = np.fmax(required, criterion)
    is_visible: Bools = ~cage.is_hidden[half_edges.faces]
    edge_levels = np.ceil(np.minimum(required, max_levels[edge_meshes])).astype(np.intp)[is_visible]
    return _level_of_most_edges(edge_meshes[is_visible], edge_levels, length[is_visible], len(meshes))


def _texture_levels(meshes: list[Mesh], pixel_sizes: Floats, max_level: int) -> Indices:
    """Return the level (k,) at which the UVs of each of k cages are off by at most `UV_TOLERANCE` pixels.

    The cages have equal rules, and their surfaces need level 0 only. `pixel_sizes` (k,) are metres of object space per
    pixel.
    """
    subdivision = meshes[0].subdivision
    assert subdivision is not None, "a batch has cages only"
    control = join_cages(meshes)
    is_visible, refined_columns = refined_values(control, subdivision)
    # `corners` are the corners of visible faces. An edge starts at each corner, and `following` is the index in
    # `corners` of the edge's end.
    corners, following = np.flatnonzero(np.repeat(is_visible, control.sizes)), next_corners(control.sizes[is_visible])
    first = first_child(corners, subdivision.scheme == "loop")
    points = control.points[control.corners[corners]]
    face_meshes = np.repeat(np.arange(len(meshes)), [len(mesh.face_sizes) for mesh in meshes])
    mesh_numbers = np.repeat(face_meshes, control.sizes)[corners]
    # The length of each edge in pixels; `edge_length` below is its length in the texture.
    length = np.linalg.norm(points[following] - points, axis=1) / pixel_sizes[mesh_numbers]
    required = np.zeros(len(corners))
    for (interpolation, values), refined in zip(control.values, refined_columns, strict=True):
        if interpolation in ("constant", "uniform"):
            continue
        start, end = values[corners], values[corners][following]
        # The error of linear UVs at the start and at the middle of each edge.
        error = np.linalg.norm([refined[first] - start, refined[first + 1] - 0.5 * (start + end)], axis=2).max(axis=0)
        edge_length = np.linalg.norm(end - start, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            required = np.fmax(
                required, np.where(edge_length > 0.0, np.log2(error / edge_length * length / UV_TOLERANCE) / 2.0, 0.0)
            )
    levels = np.zeros(len(meshes), np.intp)
    np.maximum.at(levels, mesh_numbers, np.ceil(np.minimum(required, max_level)).astype(np.intp))
    return levels


def _level_of_most_edges(mesh: Indices, edge_levels: Indices, length: Floats, count: int) -> Indices:
    """Return the level (k,) that suffices for all but `OUTLIER_FRACTION` of the length of each mesh's half-edges.

    The other half-edges need at most one level more. `mesh`, `edge_levels` and `length` (m,) are, for each half-edge,
    the number of its mesh, the level that it needs, and its length; `count` is the number of meshes.
    """
    # `total` has the length by mesh and level, and `length_from_level` the length of the half-edges that need
    # at least each level.
    counts = int(edge_levels.max(initial=0)) + 1
    total = np.bincount(mesh * counts + edge_levels, length, count * counts).reshape(count, counts)
    length_from_level = np.cumsum(total[:, ::-1], axis=1)[:, ::-1]
    level = (length_from_level > OUTLIER_FRACTION * length_from_level[:, :1]).sum(axis=1) - 1
    lowest = np.zeros(count, np.intp)
    np.maximum.at(lowest, mesh, edge_levels - 1)
    return np.maximum(np.maximum(level, lowest), 0)


def _turn_angles(half_edges: HalfEdges, normals: Floats32, first: Indices) -> Floats:
    """Return the angle (m,), in radians, that the normal turns along each half-edge of the cage.

    The angle is the turn to the edge's middle plus the turn from there to the end. `normals` (m', 3) are the normals at
    the corners of level 1, and `first` (m,) the corners of level 1 at the starts of the half-edges.
    """
    corner_normals, middle_normals = normals[first].astype(np.float64), normals[first + 1].astype(np.float64)
    halves = np.linalg.norm([middle_normals - corner_normals, corner_normals[half_edges.next] - middle_normals], axis=2)
    return np.asarray(2.0 * np.arcsin(np.minimum(0.5 * halves, 1.0)).sum(axis=0))


def _sharpness_delay(half_edges: HalfEdges) -> Floats:
    """Return the number of levels (m,) before the turn along a half-edge decreases.

    The number is the largest finite sharpness of the two points at the ends of the half-edge, and of all edges at these
    points.
    """
    edge_sharpness = np.where(np.isfinite(half_edges.edge_sharpness), half_edges.edge_sharpness, 0.0)
    point_sharpness = np.where(np.isfinite(half_edges.point_sharpness), half_edges.point_sharpness, 0.0)
    np.maximum.at(point_sharpness, half_edges.ends.ravel(), np.repeat(edge_sharpness, 2))
    return np.maximum(point_sharpness[half_edges.points], point_sharpness[half_edges.points[half_edges.next]])


def _limit_corners(counts: list[int], desired: list[int], max_corners: int) -> list[int]:
    """Return the desired levels of meshes with `counts` corners, reduced until the total is at most `max_corners`.

    Each step reduces the level of the mesh with the most refined corners, at most until all levels are 0. Meshes with
    the desired level 0 are not counted.
    """
    levels = list(desired)
    total = sum(count * 4**level for count, level in zip(counts, levels, strict=True) if level)
    heap = [(-count * 4**level, i) for i, (count, level) in enumerate(zip(counts, levels, strict=True)) if level]
    heapq.heapify(heap)
    while total > max_corners and heap:
        largest, i = heapq.heappop(heap)
        levels[i] -= 1
        total += largest - largest // 4
        if levels[i]:
            heapq.heappush(heap, (largest // 4, i))
    return levels


def _reduction_note(
    meshes: Sequence[Mesh], reduced: list[int], desired: list[int], levels: list[int], max_corners: int
) -> str:
    """Return the note that the meshes with the numbers `reduced` have lower levels than desired."""
    worst = max(reduced, key=lambda i: (desired[i] - levels[i]) * len(meshes[i].corner_points))
    surfaces = "1 surface is" if len(reduced) == 1 else f"{len(reduced)} surfaces are"
    return (
        f"subdivision: {surfaces} refined less than the size in the frame requires, because an asset may have at most "
        f"{max_corners:,} refined corners; {meshes[worst].name} is refined {levels[worst]} times instead of "
        f"{desired[worst]}"
    )
