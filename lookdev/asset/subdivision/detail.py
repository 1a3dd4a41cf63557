"""How often each cage of an asset is refined, by its size in the frame.

Each refinement halves edges. So the distance between the limit surface and its chord falls by four, the angle by which
the surface turns along an edge by two. Both are measured at the cage's edges, on the limit surface itself. The level is
the least one at which the distance is `TOLERANCE` pixels, and the angle `TURN` or the edge `FACET` pixels, along all of
the cage's edges but the worst `REST` of their length, which may be one level short of it.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lookdev.asset.mesh import Asset, Floats, Instance, Mesh
from lookdev.asset.normals import next_corners
from lookdev.asset.subdivision.batch import batches, joined
from lookdev.asset.subdivision.cage import build_cage
from lookdev.asset.subdivision.limit import complete_normals, limit
from lookdev.asset.subdivision.refine import masks_of, refined_values
from lookdev.asset.subdivision.rules import interpolate
from lookdev.asset.subdivision.topology import Doubles, Flags, Index, Level, first_child, split

TOLERANCE = 0.1
"""Pixels between the limit surface and its facets: below what antialiasing shows of a silhouette."""

TURN = 0.1
"""Radians from one end of an edge to the other: facets that turn more show at a terminator in spite of normals."""

FACET = 3.0
"""Pixels: a shorter edge may turn by any angle."""

REST = 0.01
"""Of the length of a cage's edges: a few sharp bends of a large cage do not multiply all of its faces by four."""

TEXTURE = 0.5
"""Pixels by which UVs that are linear over a cage's own faces may shift a texture, where its faces are flat enough."""

DETAIL = 2.0
"""Pixels: the longest edge of a mesh that has to carry detail."""

FINEST = 6
"""The highest level."""

FINEST_DETAIL = 10
"""The highest level of a mesh that has to carry detail: of a single face in a frame of a thousand pixels, and more."""

CORNERS = 8_000_000
"""Refined corners of an asset, about 2 GB while they are made."""

PixelSize = Callable[[Doubles, Doubles], Doubles]
"""From spheres, centres (k, 3) in the world and radii (k,), to metres a pixel (k,) where they come nearest."""


@dataclass(frozen=True)
class Refinement:
    """The level of each mesh of an asset, 0 of one without subdivision, and what a user should know of them."""

    levels: tuple[int, ...]
    notes: tuple[str, ...] = ()


def orbit_pixel(position: Sequence[float], pivot: Sequence[float], slope: float) -> PixelSize:
    """Return the size of a pixel of a camera on a turntable.

    Parameters
    ----------
    position, pivot
        A place of the camera (3,), and x and y of the vertical axis that it orbits, metres; if it stays, its own.
    slope
        Width of a pixel at depth 1: the frame's width at that depth over the number of pixels.
    """
    offset = np.asarray(position[:2], np.float64) - pivot[:2]
    reach, height = float(np.hypot(*offset)), float(position[2])

    def pixel(centers: Doubles, radii: Doubles) -> Doubles:
        from_axis = np.hypot(centers[:, 0] - pivot[0], centers[:, 1] - pivot[1])
        nearest = np.hypot(from_axis - reach, centers[:, 2] - height) - radii
        return np.asarray(slope * np.maximum(nearest, 0.0))

    return pixel


def refinement_levels(
    asset: Asset,
    pixel: PixelSize,
    detailed: Collection[int] = (),
    finest: int = FINEST,
    corners: int = CORNERS,
) -> Refinement:
    """Return the level of each mesh at which it looks like its limit surface where it comes nearest the camera.

    A mesh has one level for all its instances. The edges of those that are `detailed`, by their numbers, as displaced
    ones are, become no longer than `DETAIL` pixels. No level is above `finest`, or `FINEST_DETAIL` for these; of an
    asset that would have more than `corners` refined corners, the meshes that have the most are refined less, and a
    note says so.

    Raises
    ------
    AssetError
        As `refine`.
    """
    cages = [i for i, mesh in enumerate(asset.meshes) if mesh.subdivision is not None]
    wanted = [0] * len(asset.meshes)
    sizes = _pixels(asset.meshes, asset.instances, pixel)
    small = [i for i in cages if 4 * len(asset.meshes[i].corner_points) <= corners]
    bare = [replace(asset.meshes[i], uvs={}, primvars={}) for i in small]
    for numbers, _ in batches(bare, [1] * len(bare)):
        own = [small[i] for i in numbers]
        longest = np.array([DETAIL if i in detailed else np.inf for i in own])
        most = np.array([FINEST_DETAIL if i in detailed else finest for i in own])
        levels = _levels([bare[i] for i in numbers], sizes[own], longest, most).tolist()
        for i, level in zip(own, levels, strict=True):
            wanted[i] = level
    flat = [i for i in small if wanted[i] == 0 and asset.meshes[i].uvs]
    textured = [replace(asset.meshes[i], primvars={}) for i in flat]
    for numbers, _ in batches(textured, [1] * len(flat)):
        own = [flat[i] for i in numbers]
        levels = _texture_levels([textured[i] for i in numbers], sizes[own], finest).tolist()
        for i, level in zip(own, levels, strict=True):
            wanted[i] = level
    for i in set(cages) - set(small):
        wanted[i] = min(1, finest)
    levels = _affordable([len(mesh.corner_points) for mesh in asset.meshes], wanted, corners)
    less = [i for i in cages if levels[i] < wanted[i]]
    return Refinement(tuple(levels), (_note(asset.meshes, less, wanted, levels, corners),) if less else ())


def _pixels(meshes: Sequence[Mesh], instances: Sequence[Instance], pixel: PixelSize) -> Doubles:
    """Return metres a pixel in the object space of each mesh, the least of its instances; infinite without one."""
    sizes = np.full(len(meshes), np.inf)
    if not instances:
        return sizes
    boxes = [np.array([mesh.points.min(axis=0), mesh.points.max(axis=0)], np.float64) for mesh in meshes]
    number = np.array([each.mesh for each in instances])
    matrices = np.stack([each.matrix for each in instances])
    centers = np.stack([box.mean(axis=0) for box in boxes])[number]
    radii = np.array([0.5 * np.linalg.norm(np.ptp(box, axis=0)) for box in boxes])[number]
    stretch = np.linalg.norm(matrices[:, :3, :3], ord=2, axis=(1, 2))
    world = np.einsum("kij,kj->ki", matrices[:, :3, :3], centers) + matrices[:, :3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        own = np.where(stretch > 0.0, pixel(world, radii * stretch) / stretch, np.inf)
    np.minimum.at(sizes, number, own)
    return sizes


def _levels(meshes: list[Mesh], pixels: Doubles, longest: Doubles, finest: Index) -> Index:
    """Return the level (k,) of cages of the same rules and without values.

    pixels (k,) metres a pixel; longest (k,) edge, in pixels; finest (k,) level.
    """
    subdivision = meshes[0].subdivision
    assert subdivision is not None, "a batch has cages only"
    control, rules = joined(meshes), masks_of(subdivision)
    cage = build_cage(control, subdivision)
    level, mesh = cage.level, np.repeat(np.arange(len(meshes)), [len(each.face_sizes) for each in meshes])
    child = split(level, rules.triangles)
    limits, normals = limit(child, interpolate(level, control.points, rules), rules)
    complete_normals(child, limits, normals)

    first = first_child(np.arange(len(level.points)), rules.triangles)
    start, middle, turn = limits[level.points], limits[len(control.points) + level.edges], _turns(level, normals, first)
    chord = start[level.next] - start
    length = np.linalg.norm(chord, axis=1)
    away = middle - 0.5 * (start + start[level.next])
    # At a boundary or crease the edge itself is seen; elsewhere what lies in the surface is not.
    edge = (level.twins < 0) | (level.edge_sharpness[level.edges] > 0.0)
    along = np.einsum("ij,ij->i", away, chord) / np.maximum(length, np.finfo(np.float64).tiny)
    across = np.sqrt(np.maximum(np.einsum("ij,ij->i", away, away) - along**2, 0.0))
    distance = np.where(edge, across, np.abs(np.einsum("ij,ij->i", away, normals[first + 1])))
    if rules.triangles:
        # On a sphere, the middle of an equilateral triangle is 4/3 as far away as those of its edges.
        distance *= 4.0 / 3.0
    else:
        means = np.add.reduceat(start, np.cumsum(level.sizes) - level.sizes, axis=0) / level.sizes[:, None]
        inner = limits[len(limits) - len(level.sizes) :] - means
        distance = np.maximum(distance, np.abs(np.einsum("ij,ij->i", inner[level.faces], normals[first + 2])))

    size = pixels[mesh[level.faces]]
    with np.errstate(divide="ignore", invalid="ignore"):
        by_distance = np.log2(distance / (TOLERANCE * size)) / 2.0
        # The arc at a semi-sharp feature is within half of the last edge, until its sharpness has decayed.
        arc, delay = np.log2(length * turn / (8.0 * TOLERANCE * size)), _delay(level)
        by_arc = np.where(delay > 0.0, np.minimum(arc, 0.5 * (arc + delay)), 0.0)
        by_turn = np.minimum(np.log2(turn / TURN) + np.ceil(delay), np.log2(length / (FACET * size)))
        by_length = np.log2(length / (longest[mesh[level.faces]] * size))
        moved = np.linalg.norm(start - control.points[level.points], axis=1) > TOLERANCE * size
    needed = np.where(moved, 1.0, 0.0)
    for each in (by_distance, by_arc, by_turn, by_length):
        needed = np.fmax(needed, each)
    shown: Flags = ~cage.hidden[level.faces]
    level_of = np.ceil(np.minimum(needed, finest[mesh[level.faces]])).astype(np.intp)[shown]
    return _all_but_the_rest(mesh[level.faces][shown], level_of, length[shown], len(meshes))


def _texture_levels(meshes: list[Mesh], pixels: Doubles, finest: int) -> Index:
    """Return the level (k,) of cages of the same rules, flat enough for level 0, at which their UVs are as smooth."""
    subdivision = meshes[0].subdivision
    assert subdivision is not None, "a batch has cages only"
    control = joined(meshes)
    shown, refined = refined_values(control, subdivision)
    corners, following = np.flatnonzero(np.repeat(shown, control.sizes)), next_corners(control.sizes[shown])
    first = first_child(corners, subdivision.scheme == "loop")
    points = control.points[control.corners[corners]]
    mesh = np.repeat(np.arange(len(meshes)), [len(each.face_sizes) for each in meshes])
    mesh = np.repeat(mesh, control.sizes)[corners]
    length = np.linalg.norm(points[following] - points, axis=1) / pixels[mesh]
    needed = np.zeros(len(corners))
    for (interpolation, values), smooth in zip(control.values, refined, strict=True):
        if interpolation in ("constant", "uniform"):
            continue
        here, there = values[corners], values[corners][following]
        moved = np.linalg.norm([smooth[first] - here, smooth[first + 1] - 0.5 * (here + there)], axis=2).max(axis=0)
        edge = np.linalg.norm(there - here, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            needed = np.fmax(needed, np.where(edge > 0.0, np.log2(moved / edge * length / TEXTURE) / 2.0, 0.0))
    levels = np.zeros(len(meshes), np.intp)
    np.maximum.at(levels, mesh, np.ceil(np.minimum(needed, finest)).astype(np.intp))
    return levels


def _all_but_the_rest(mesh: Index, needed: Index, length: Doubles, count: int) -> Index:
    """Return the level (k,) of each mesh that `REST` of its half-edges' length, by what they need, does not reach."""
    counts = int(needed.max(initial=0)) + 1
    total = np.bincount(mesh * counts + needed, length, count * counts).reshape(count, counts)
    beyond = np.cumsum(total[:, ::-1], axis=1)[:, ::-1]
    enough = (beyond > REST * beyond[:, :1]).sum(axis=1) - 1
    least = np.zeros(count, np.intp)
    np.maximum.at(least, mesh, needed - 1)
    return np.maximum(np.maximum(enough, least), 0)


def _turns(level: Level, normals: Floats, first: Index) -> Doubles:
    """Return the angle (m,) by which the normal turns along each half-edge, by way of the edge's middle."""
    here, middle = normals[first].astype(np.float64), normals[first + 1].astype(np.float64)
    halves = np.linalg.norm([middle - here, here[level.next] - middle], axis=2)
    return np.asarray(2.0 * np.arcsin(np.minimum(0.5 * halves, 1.0)).sum(axis=0))


def _delay(level: Level) -> Doubles:
    """Return the levels (m,) that pass at each half-edge before semi-sharp features at its ends begin to turn less."""
    semi = np.where(np.isfinite(level.edge_sharpness), level.edge_sharpness, 0.0)
    points = np.where(np.isfinite(level.point_sharpness), level.point_sharpness, 0.0)
    np.maximum.at(points, level.ends.ravel(), np.repeat(semi, 2))
    return np.maximum(points[level.points], points[level.points[level.next]])


def _affordable(counts: list[int], wanted: list[int], corners: int) -> list[int]:
    """Return levels of meshes with `counts` corners, as wanted but for those that together have more than `corners`."""
    levels = list(wanted)
    total = sum(count * 4**level for count, level in zip(counts, levels, strict=True) if level)
    heap = [(-count * 4**level, i) for i, (count, level) in enumerate(zip(counts, levels, strict=True)) if level]
    heapq.heapify(heap)
    while total > corners and heap:
        largest, i = heapq.heappop(heap)
        levels[i] -= 1
        total += largest - largest // 4
        if levels[i]:
            heapq.heappush(heap, (largest // 4, i))
    return levels


def _note(meshes: Sequence[Mesh], less: list[int], wanted: list[int], levels: list[int], corners: int) -> str:
    worst = max(less, key=lambda i: (wanted[i] - levels[i]) * len(meshes[i].corner_points))
    return (
        f"subdivision: {len(less)} of the surfaces are refined less than their size in the frame asks for, as all may "
        f"have {corners:,} corners: {meshes[worst].name} {levels[worst]} times instead of {wanted[worst]}"
    )
