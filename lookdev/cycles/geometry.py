"""An asset as Blender data: its meshes, with the attributes that the sources on them read, and what shows them.

Blender and Cycles spend a fraction of a millisecond on every object and every mesh, in every render. So small meshes
are joined (`lookdev.asset.gather`), and the instances of a mesh are points of a single object, which its geometry
nodes replace by the mesh.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from lookdev.asset.gather import gathered, unstretched
from lookdev.asset.mesh import Asset, Floats, Mesh
from lookdev.asset.normals import blocks, face_starts
from lookdev.asset.tangents import handedness
from lookdev.asset.triangles import triangulated
from lookdev.codegen import HANDEDNESS, TANGENT, AttributeBinding, Source, short_name


@dataclass(frozen=True)
class Shown:
    """An asset in a scene of Blender.

    `root` is the empty that is the parent of all; `objects` are those whose colour the shaders read; `meshes` are the
    meshes of Blender with those that they were made of.
    """

    root: Any
    objects: list[Any]
    meshes: list[tuple[Any, Mesh]]


def add_asset(
    scene: Any,
    asset: Asset,
    sources: Sequence[Source],
    worn: Sequence[int],
    materials: Sequence[Any],
    *,
    groups: Sequence[int] = (),
    apart: bool = False,
    covered: bool = False,
) -> Shown:
    """Add an asset to a scene.

    Parameters
    ----------
    asset
        Geometry about the origin.
    sources, worn, materials
        The sources, the number of each slot's, and the material of each source.
    groups
        The group of each slot, which `rig_group` of the shaders finds at what a ray has hit; (): all are of group 0.
    apart
        Make an object of every instance, and meshes with edges and all of their UV sets, as users of Blender expect
        them. The picture is the same.
    covered
        Give every mesh a UV set: the pass of texture coordinates is 1 in its third channel only where there is one.
    """
    root = bpy.data.objects.new("root", None)
    scene.collection.objects.link(root)
    if not apart:
        asset = gathered(asset)
    if any(groups):
        asset = _grouped(asset, np.array(groups))
    numbers = np.array(worn)
    meshes = [_build_mesh(mesh, sources, numbers, materials, whole=apart) for mesh in asset.meshes]
    for data, mesh in zip(meshes, asset.meshes, strict=True):
        if any(groups):
            _mark_groups(data, mesh, np.array(groups))
        if covered and not data.uv_layers:
            data.uv_layers.new(name="lookdev_covered", do_init=False)
    shown = np.array([instance.mesh for instance in asset.instances])
    counts = np.bincount(shown, minlength=len(meshes))
    many = np.zeros(len(shown), bool) if apart else counts[shown] > 1
    objects = []
    for number in np.flatnonzero(~many):
        instance = asset.instances[number]
        item = _add_object(scene.collection, asset.name, meshes[instance.mesh])
        item.parent = root
        # An object's own transform has no shear; the transform that it inherits is a matrix.
        item.matrix_parent_inverse = Matrix(instance.matrix.tolist())
        objects.append(item)
        if counts[instance.mesh] == 1:
            _share(scene, meshes[instance.mesh], asset)
    if many.any():
        used, prototypes = np.unique(shown[many], return_inverse=True)
        matrices = np.array([instance.matrix for instance, one in zip(asset.instances, many, strict=True) if one])
        objects.append(_add_instances(scene, asset.name, [meshes[number] for number in used], prototypes, matrices))
        objects[-1].parent = root
    return Shown(root, objects, list(zip(meshes, asset.meshes, strict=True)))


def _grouped(asset: Asset, groups: NDArray[Any]) -> Asset:
    """Return an asset in which the angles that `_mark_groups` makes stay: of triangles, and not stretched."""
    marked = {number for number, mesh in enumerate(asset.meshes) if groups[mesh.face_slots].any()}
    meshes = (triangulated(mesh) if number in marked else mesh for number, mesh in enumerate(asset.meshes))
    return unstretched(replace(asset, meshes=tuple(meshes)), marked)


def _mark_groups(data: Any, mesh: Mesh, groups: NDArray[Any]) -> None:
    """Mark faces by their groups: the mesh's own normals are as many degrees off the facets.

    Of what a ray has hit, Cycles gives a shader the normals alone, on Blender 4.5.
    """
    group = groups[mesh.face_slots]
    if not group.any():
        return
    a, b, c = (mesh.points[mesh.corner_points[i::3]].astype(np.float64) for i in range(3))
    facet = np.cross(b - a, c - a)
    angle = np.radians(group)[:, None]
    with np.errstate(invalid="ignore"):
        # Along an edge, which is in the plane.
        along, across = ((each / np.linalg.norm(each, axis=-1, keepdims=True)) for each in (b - a, facet))
    marked = np.nan_to_num(np.cos(angle) * across + np.sin(angle) * along)
    # Without edges Blender passes other normals to Cycles.
    data.update(calc_edges=True)
    _add_attribute(data, "custom_normal", np.repeat(marked, 3, axis=0).astype(np.float32))


def _add_object(collection: Any, name: str, data: Any) -> Any:
    item = bpy.data.objects.new(name, data)
    collection.objects.link(item)
    # Nothing moves while the shutter is open: without this, Cycles evaluates every object at three times.
    item.cycles.use_motion_blur = False
    # Facets shadow themselves without smoothing.
    item.shadow_terminator_geometry_offset = item.shadow_terminator_shading_offset = 0.0
    return item


def _share(scene: Any, data: Any, asset: Asset) -> None:
    """Give a mesh a second user, so that Cycles keeps it as an instance with an acceleration structure of its own.

    The mesh of a single object is merged into the scene's, which any change of an object rebuilds: 40 ms for 260,000
    triangles, twice a frame. The second user is a speck far below, hidden from every kind of ray that contributes to a
    picture, but not from all rays: Cycles would leave it out.
    """
    speck = _add_object(scene.collection, "speck", data)
    speck.location = (0.0, 0.0, -1e3 * asset.radius)
    speck.scale = (1e-6, 1e-6, 1e-6)
    speck.visible_camera = speck.visible_diffuse = speck.visible_glossy = False
    speck.visible_transmission = speck.visible_shadow = False
    speck.visible_volume_scatter = True


def _add_instances(scene: Any, name: str, meshes: Sequence[Any], numbers: NDArray[Any], matrices: NDArray[Any]) -> Any:
    """Add an object that shows `meshes[numbers[i]]` by each of the matrices (n, 4, 4); instances have its colour."""
    # In no scene, so that only instances are seen. Blender numbers the objects of a collection by their names.
    prototypes = bpy.data.collections.new("prototypes")
    for number, mesh in enumerate(meshes):
        _add_object(prototypes, f"prototype {number:09}", mesh)
    points = bpy.data.meshes.new("instances")
    points.vertices.add(len(numbers))
    points.attributes.new("prototype", "INT", "POINT").data.foreach_set("value", numbers.astype(np.int32))
    by_columns = np.ascontiguousarray(np.swapaxes(matrices, 1, 2), np.float32)
    points.attributes.new("matrix", "FLOAT4X4", "POINT").data.foreach_set("value", by_columns.ravel())
    item = _add_object(scene.collection, name, points)
    item.modifiers.new("instances", "NODES").node_group = _instancing_tree(prototypes)
    return item


def _instancing_tree(prototypes: Any) -> Any:
    """Return geometry nodes that replace each point by a prototype, as its attributes say."""
    tree = bpy.data.node_groups.new("instances", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")

    def add(kind: str, **inputs: Any) -> Any:
        node = tree.nodes.new(kind)
        for name, value in inputs.items():
            socket = next(each for each in node.inputs if each.identifier == name)
            if isinstance(value, bpy.types.NodeSocket):
                tree.links.new(value, socket)
            else:
                socket.default_value = value
        return node

    def attribute(name: str, kind: str) -> Any:
        node = add("GeometryNodeInputNamedAttribute", Name=name)
        node.data_type = kind
        return next(each for each in node.outputs if each.enabled and each.name == "Attribute")

    meshes = add("GeometryNodeCollectionInfo", Collection=prototypes, **{"Separate Children": True})
    instances = add(
        "GeometryNodeInstanceOnPoints",
        Points=add("NodeGroupInput").outputs[0],
        Instance=meshes.outputs[0],
        **{"Pick Instance": True, "Instance Index": attribute("prototype", "INT")},
    )
    placed = add(
        "GeometryNodeSetInstanceTransform",
        Instances=instances.outputs[0],
        Transform=attribute("matrix", "FLOAT4X4"),
    )
    tree.links.new(placed.outputs[0], add("NodeGroupOutput").inputs[0])
    return tree


def _build_mesh(
    mesh: Mesh, sources: Sequence[Source], worn: NDArray[Any], materials: Sequence[Any], *, whole: bool
) -> Any:
    data = bpy.data.meshes.new(mesh.name)
    data.vertices.add(len(mesh.points))
    data.loops.add(len(mesh.corner_points))
    data.polygons.add(len(mesh.face_sizes))
    data.polygons.foreach_set("loop_start", face_starts(mesh.face_sizes).astype(np.int32))
    # As attributes they are copied as a whole.
    data.attributes["position"].data.foreach_set("vector", mesh.points.ravel())
    data.attributes[".corner_vert"].data.foreach_set("value", mesh.corner_points)
    face_sources = worn[mesh.face_slots]
    is_used = np.bincount(face_sources) > 0
    used = np.flatnonzero(is_used)
    for number in used:
        data.materials.append(materials[number])
    if len(used) > 1:
        index = np.cumsum(is_used, dtype=np.int32) - 1
        _add_attribute(data, "material_index", index[face_sources], "FACE")
    if whole:
        data.update(calc_edges=True)
    # Shaders bring their own normals. Blender's cancel at points where faces meet their reversed doubles.
    _add_attribute(data, "sharp_face", np.ones(len(mesh.face_sizes), bool), "FACE")
    bindings = {number: sources[number].attributes for number in used.tolist()}
    read = {binding.attribute for each in bindings.values() for binding in each if binding.kind == "uv"}
    for name, uv in mesh.uvs.items():
        if whole or name in read:
            short = short_name(name)
            data.uv_layers.new(name=short, do_init=False)
            data.attributes[short].data.foreach_set("vector", uv.ravel())
    # Blender's own custom normals have 16 bits; attributes have 32.
    _add_attribute(data, "lookdev_normal", *_compact(mesh, mesh.normals))
    for name, values in _attributes(mesh, face_sources, bindings).items():
        _add_attribute(data, name, *_compact(mesh, values))
    return data


def _compact(mesh: Mesh, values: Floats) -> tuple[Floats, str]:
    """Return values of corners as those of faces or points, where their corners have equal ones, and Blender's domain.

    Cycles keeps values of corners three times for every triangle.
    """
    sizes = mesh.face_sizes
    at_faces = values[face_starts(sizes)]
    if all(
        np.array_equal(values[corners], np.repeat(at_faces[faces], sizes[faces], axis=0))
        for faces, corners in blocks(sizes)
    ):
        return at_faces, "FACE"
    at_points = np.zeros((len(mesh.points), *values.shape[1:]), np.float32)
    at_points[mesh.corner_points] = values
    if all(np.array_equal(values[corners], at_points[mesh.corner_points[corners]]) for _, corners in blocks(sizes)):
        return at_points, "POINT"
    return values, "CORNER"


def _attributes(
    mesh: Mesh, face_sources: NDArray[Any], bindings: dict[int, tuple[AttributeBinding, ...]]
) -> dict[str, Floats]:
    """Return the attributes, other than UV sets, that sources read, by name; what a mesh lacks has their fallbacks."""
    found: dict[str, Floats] = {}
    lacking: dict[str, dict[int, tuple[float, ...]]] = {}
    for number, each in bindings.items():
        for binding in each:
            if binding.attribute == HANDEDNESS:
                found[HANDEDNESS] = handedness(mesh)
            elif binding.attribute == TANGENT:
                assert mesh.tangents is not None, "a scene task has the tangents that its sources read"
                found[TANGENT] = mesh.tangents
            elif binding.attribute in mesh.primvars:
                found[binding.stored] = mesh.primvars[binding.attribute]
            elif binding.fallback is not None:
                lacking.setdefault(binding.stored, {})[number] = binding.fallback
    for name, fallbacks in lacking.items():
        width = max(map(len, fallbacks.values()))
        at_faces = np.zeros((len(face_sources), width) if width > 1 else len(face_sources), np.float32)
        for number, fallback in fallbacks.items():
            at_faces[face_sources == number] = fallback if width > 1 else fallback[0]
        found[name] = np.repeat(at_faces, mesh.face_sizes, axis=0)
    return found


_ATTRIBUTE_TYPES = {
    ("b", 1): ("BOOLEAN", "value"),
    ("i", 1): ("INT", "value"),
    ("f", 1): ("FLOAT", "value"),
    ("f", 2): ("FLOAT_VECTOR", "vector"),
}
"""Blender's type and field of an array, by its kind of numbers and its dimensions.

Colours are vectors, too, to which no colour space applies.
"""


def _add_attribute(data: Any, name: str, values: NDArray[Any], domain: str = "CORNER") -> None:
    kind, field = _ATTRIBUTE_TYPES[values.dtype.kind, values.ndim]
    attribute = data.attributes.new(name, kind, domain)
    attribute.data.foreach_set(field, np.ascontiguousarray(values).ravel())
