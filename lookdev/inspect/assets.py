"""Describes the parts and materials of an asset, or the lights of a rig, as rendered, for `lookdev inspect`.

A part is a mesh, or a GeomSubset of a mesh, to which one material is bound.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import takewhile
from pathlib import Path

import numpy as np

from lookdev.asset import Asset, Mesh
from lookdev.asset.silhouette import hull_points
from lookdev.asset.usd import read_usd
from lookdev.inspect.rigs import InspectedRig, inspect_rig
from lookdev.light.rig import holds_only_lights, read_rig
from lookdev.material import Bump, Look, Texture, leaf_sources
from lookdev.material.usd.bound import BoundLook, read_bound_looks
from lookdev.safe_text import align_columns
from lookdev.stage import Composition, compose

MAX_PARTS_LISTED = 200
"""The greatest number of parts that the text lists; ``--json`` lists all."""


@dataclass(frozen=True)
class InspectedPart:
    """A mesh, or a GeomSubset of a mesh.

    - path: the path of the first instance
    - paths: the distinct paths of all instances
    - instances: the number of instances
    - faces: the number of faces of one instance, not refined
    - subdivision: the scheme, and the numbers of creases, corners and holes; "" for polygons
    - uv_sets, primvars: their names
    - material: the path of the bound material, or "" if no material is bound
    """

    path: str
    paths: tuple[str, ...]
    instances: int
    faces: int
    subdivision: str
    uv_sets: tuple[str, ...]
    primvars: tuple[str, ...]
    material: str


@dataclass(frozen=True)
class InspectedMaterial:
    """A material that is bound to parts.

    `layers` are the reflectance models of its layers, from the base up. `textures` is the number of its images, and
    `displaced` whether it has a displacement. `lost` has a message for each feature that is not carried over.
    """

    path: str
    layers: tuple[str, ...]
    textures: int
    displaced: bool
    lost: tuple[str, ...]


@dataclass(frozen=True)
class Inspection:
    """The description of an asset with its parts and materials. Lengths are in metres, and z is up.

    `minimum` and `maximum` (3,) are the corners of the bounding box, and `radius` is the radius of the bounding sphere.
    `meshes`, `instances`, `points` and `faces` are numbers; points and faces are counted once for each mesh. `notes`
    list unsupported content and repairs.
    """

    file: str
    minimum: tuple[float, ...]
    maximum: tuple[float, ...]
    radius: float
    meshes: int
    instances: int
    points: int
    faces: int
    faces_shown: int  # the number of faces, counted for each instance
    parts: tuple[InspectedPart, ...]
    materials: tuple[InspectedMaterial, ...]
    notes: tuple[str, ...]

    def data(self) -> dict[str, object]:
        """Return all fields for JSON."""
        return asdict(self)

    def text(self) -> str:
        """Return the size and the counts, the tree of at most `MAX_PARTS_LISTED` parts, the materials and the notes."""
        size = " x ".join(f"{b - a:.4g}" for a, b in zip(self.minimum, self.maximum, strict=True))
        more = f" ({self.faces_shown:,} with instances)" if self.faces_shown > self.faces else ""
        counts = [_count_text(self.meshes, "mesh", "es"), _count_text(self.instances, "instance")]
        counts.append(_count_text(self.points, "point"))
        lines = [f"{self.file}: {size} m, {', '.join(counts)}, {_count_text(self.faces, 'face')}{more}", ""]
        lines += align_columns(list(_tree_rows(self.parts[:MAX_PARTS_LISTED])))
        if (unlisted := len(self.parts) - MAX_PARTS_LISTED) > 0:
            lines.append(f"... and {unlisted:,} more parts; --json lists all")
        if self.materials:
            lines += ["", "materials"]
        for material in self.materials:
            lines += _material_lines(material)
        if self.notes:
            lines += ["", "notes", *(f"  {note}" for note in self.notes)]
        return "\n".join(lines)


def inspect_file(
    composition: Composition,
    time: float | None = None,
    purposes: tuple[str, ...] = ("default", "render"),
    *,
    rig: bool = False,
) -> tuple[Inspection, Asset] | tuple[InspectedRig, None]:
    """Read an asset and the materials bound to it; return the inspection and the asset itself.

    `time` and `purposes` are as in `read_usd`. With `rig`, or if the stage has lights and no geometry, read a rig and
    return the inspection of its lights and None. Raises AssetError or FaultsError if the asset or rig cannot be
    rendered.
    """
    composed = compose(composition)
    if rig or holds_only_lights(composed):
        return inspect_rig(read_rig(composed, sampled=False)), None
    asset = read_usd(composed, time, purposes)
    paths = dict.fromkeys(slot.material for slot in asset.slots if slot.material)
    bound = read_bound_looks(composed, paths)
    return inspect_asset(composition.file, asset, bound), asset


def inspect_asset(file: Path, asset: Asset, bound: Mapping[str, BoundLook]) -> Inspection:
    """Return the inspection of an asset; `bound` has the looks of its materials by path."""
    # By number of the mesh: the number of its instances, and their distinct paths in order.
    uses = Counter(instance.mesh for instance in asset.instances)
    paths: dict[int, dict[str, None]] = {}
    for instance in asset.instances:
        paths.setdefault(instance.mesh, {})[instance.path] = None
    sizes = [len(mesh.face_sizes) for mesh in asset.meshes]
    points = hull_points(asset.meshes, asset.instances)
    return Inspection(
        file=str(file),
        minimum=tuple(points.min(axis=0).tolist()),
        maximum=tuple(points.max(axis=0).tolist()),
        radius=asset.radius,
        meshes=len(asset.meshes),
        instances=len(asset.instances),
        points=sum(len(mesh.points) for mesh in asset.meshes),
        faces=sum(sizes),
        faces_shown=sum(size * uses[number] for number, size in enumerate(sizes)),
        parts=tuple(
            part
            for number, mesh in enumerate(asset.meshes)
            for part in _inspect_parts(asset, mesh, paths.get(number, ()), uses[number])
        ),
        materials=tuple(_inspect_material(path, bound_look) for path, bound_look in bound.items()),
        notes=asset.notes,
    )


def _inspect_parts(asset: Asset, mesh: Mesh, paths: Iterable[str], instances: int) -> Iterator[InspectedPart]:
    """Yield the parts of a mesh; `paths` are the distinct paths of its instances, `instances` is their number."""
    numbers, counts = np.unique(mesh.face_slots, return_counts=True)
    for number, count in zip(numbers.tolist(), counts.tolist(), strict=True):
        slot = asset.slots[number]
        yield InspectedPart(
            slot.path,
            tuple(path + slot.path.removeprefix(mesh.name) for path in paths),
            instances,
            count,
            _subdivision_text(mesh),
            tuple(mesh.uvs),
            tuple(mesh.primvars),
            slot.material or "",
        )


def _subdivision_text(mesh: Mesh) -> str:
    """Return the text of `InspectedPart.subdivision`."""
    rules = mesh.subdivision
    if rules is None:
        return ""
    tags = {"crease": rules.crease_sharpness, "corner": rules.corner_sharpness, "hole": rules.holes}
    counts = [_count_text(len(values), name) for name, values in tags.items() if len(values)]
    return f"{rules.scheme} ({', '.join(counts)})" if counts else rules.scheme


def _inspect_material(path: str, bound: BoundLook) -> InspectedMaterial:
    """Return the description of a material from the look that it becomes."""
    look = bound.look
    lost = tuple(str(fault).removeprefix(f"{fault.file}: ") for fault in bound.losses)
    return InspectedMaterial(path, bound.titles, _image_count(look), look.displacement is not None, lost)


def _image_count(look: Look) -> int:
    """Return the number of image files that a look names in its inputs, masks, bumps and displacement.

    The look's shader may read fewer images, since constants are folded when it is generated.
    """
    sources = [source for layer in look.layers for source in (*layer.inputs.values(), layer.mask)]
    heights = [look.displacement.height] if look.displacement else []
    leaves = (leaf.height if isinstance(leaf, Bump) else leaf for leaf in leaf_sources([*sources, *heights]))
    return len({leaf.file for leaf in leaves if isinstance(leaf, Texture)})


def _tree_rows(parts: Sequence[InspectedPart]) -> Iterator[tuple[str, ...]]:
    """Yield rows of cells: a row for each part, after a row for each of the part's ancestors without a row."""
    ancestors: list[str] = []
    for part in parts:
        *groups, name = part.path.strip("/").split("/")
        shared = takewhile(lambda pair: pair[0] == pair[1], zip(ancestors, groups, strict=False))
        for depth in range(len(list(shared)), len(groups)):
            yield ("  " * depth + groups[depth],)
        ancestors = [*groups, name]  # includes the part: the rows of a mesh's GeomSubsets can follow its row
        yield (
            "  " * len(groups) + name,
            _count_text(part.faces, "face") + (f" x {part.instances:,}" if part.instances != 1 else ""),
            part.subdivision,
            f"uv {', '.join(part.uv_sets)}" if part.uv_sets else "no uv",
            f"primvars {', '.join(part.primvars)}" if part.primvars else "",
            part.material or ("displayColor" if "displayColor" in part.primvars else "no material"),
        )


def _count_text(number: int, noun: str, plural: str = "s") -> str:
    """Return a number with its noun, to which `plural` is appended unless the number is 1."""
    return f"{number:,} {noun}{plural if number != 1 else ''}"


def _material_lines(material: InspectedMaterial) -> Iterator[str]:
    """Yield the lines of text about a material."""
    images = f", {_count_text(material.textures, 'image')}" if material.textures else ""
    displaced = ", displaced" * material.displaced
    yield f"  {material.path}: {' under '.join(material.layers)}{images}{displaced}"
    yield from (f"    not carried over: {lost}" for lost in material.lost)
