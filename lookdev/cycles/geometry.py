"""Builds an asset as Blender data: meshes, with the attributes that their shaders read, and objects that show them.

Blender and Cycles spend a fraction of a millisecond on every object and every mesh, in every render. Small meshes are
therefore joined (`lookdev.asset.gather`). The instances of a mesh are points of a single object, and geometry nodes
replace each point by the mesh.

A slot is a part of the asset with one look. A source is the generated shader, or the nodes, of a look.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import bpy
import numpy as np
from mathutils import Matrix

from lookdev.arrays import Elements, Floats, Floats32, Indices, Ints
from lookdev.asset.gather import join_small_meshes, move_stretch_to_meshes
from lookdev.asset.mesh import Asset, Mesh
from lookdev.asset.normals import face_blocks, run_starts
from lookdev.asset.tangents import handedness
from lookdev.asset.triangles import triangulate
from lookdev.codegen.source import HANDEDNESS, TANGENT, AttributeBinding, GeneratedSource, short_name


@dataclass(frozen=True)
class AssetObjects:
    """An asset in a scene of Blender."""

    root: bpy.types.Object  # an empty, the parent of all objects
    objects: list[bpy.types.Object]  # those that show the asset; shaders read their colour and properties
    meshes: list[tuple[bpy.types.Mesh, Mesh]]  # pairs of Blender's mesh and the asset's mesh


def add_asset(
    scene: bpy.types.Scene,
    asset: Asset,
    sources: Sequence[GeneratedSource],
    slot_sources: Sequence[int],
    materials: Sequence[bpy.types.Material],
    *,
    groups: Sequence[int] = (),
    separate: bool = False,
    add_uv: bool = False,
) -> AssetObjects:
    """Add an asset to a scene.

    Parameters
    ----------
    asset
        The asset, with its centre at the origin.
    sources
        The sources of all looks.
    slot_sources
        The number of the source of each slot.
    materials
        The material of each source.
    groups
        The shadow group of each slot, which the shaders' function `rig_group` reads at the hit of a ray: a light's
        shadow may exclude groups. If `groups` is empty, all slots are in group 0.
    separate
        Make an object of every instance, and meshes with edges and all of their UV sets, as users of Blender expect
        them. The picture is the same.
    add_uv
        Give every mesh a UV set. The pass of texture coordinates then has 1 in its third channel on every surface.
    """
    root = bpy.data.objects.new("root", None)
    scene.collection.objects.link(root)
    if not separate:
        asset = join_small_meshes(asset)
    if any(groups):
        asset = _prepare_groups(asset, np.array(groups))
    source_numbers = np.array(slot_sources)
    meshes = [_build_mesh(mesh, sources, source_numbers, materials, separate=separate) for mesh in asset.meshes]
    for data, mesh in zip(meshes, asset.meshes, strict=True):
        if any(groups):
            _encode_groups(data, mesh, np.array(groups))
        if add_uv and not data.uv_layers:
            data.uv_layers.new(name="lookdev_covered", do_init=False)
    instance_meshes = np.array([instance.mesh for instance in asset.instances])
    counts = np.bincount(instance_meshes, minlength=len(meshes))
    is_repeated = np.zeros(len(instance_meshes), bool) if separate else counts[instance_meshes] > 1
    objects = []
    for number in np.flatnonzero(~is_repeated):
        instance = asset.instances[number]
        item = _add_object(scene.collection, asset.name, meshes[instance.mesh])
        item.parent = root
        # An object's own transform cannot have shear. What it inherits from its parent is a matrix, which can.
        item.matrix_parent_inverse = Matrix(instance.matrix.tolist())
        objects.append(item)
        if counts[instance.mesh] == 1:
            _add_second_user(scene, meshes[instance.mesh], asset)
    if is_repeated.any():
        used, prototypes = np.unique(instance_meshes[is_repeated], return_inverse=True)
        matrices = np.array([asset.instances[number].matrix for number in np.flatnonzero(is_repeated)])
        objects.append(_add_instances(scene, asset.name, [meshes[number] for number in used], prototypes, matrices))
        objects[-1].parent = root
    return AssetObjects(root, objects, list(zip(meshes, asset.meshes, strict=True)))


def _prepare_groups(asset: Asset, groups: Ints) -> Asset:
    """Return the asset for `_encode_groups`, which needs triangles, and matrices that do not change angles.

    Meshes with a group other than 0 are triangulated, and a stretch in their matrices is moved to their points.
    """
    marked = {number for number, mesh in enumerate(asset.meshes) if groups[mesh.face_slots].any()}
    meshes = (triangulate(mesh) if number in marked else mesh for number, mesh in enumerate(asset.meshes))
    return move_stretch_to_meshes(replace(asset, meshes=tuple(meshes)), marked)


def _encode_groups(data: bpy.types.Mesh, mesh: Mesh, groups: Ints) -> None:
    """Encode the group of each triangle in the normals of Blender's mesh: group n tilts them by n degrees.

    A shader that traces a ray reads the angle between these normals and the facet's normal at the hit. On Blender 4.5,
    Cycles tells the shader nothing else about the hit surface. Shading does not use these normals.
    """
    group = groups[mesh.face_slots]
    if not group.any():
        return
    a, b, c = (mesh.points[mesh.corner_points[i::3]].astype(np.float64) for i in range(3))
    facet = np.cross(b - a, c - a)
    angle = np.radians(group)[:, None]
    with np.errstate(invalid="ignore"):
        # `along` is an edge, which is in the plane of the facet; `across` is the normal of the facet.
        along, across = ((vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)) for vectors in (b - a, facet))
    tilted = np.nan_to_num(np.cos(angle) * across + np.sin(angle) * along)
    # If a mesh has no edges, Blender passes other normals to Cycles.
    data.update(calc_edges=True)
    _add_attribute(data, "custom_normal", np.repeat(tilted, 3, axis=0).astype(np.float32))


def _add_object(collection: bpy.types.Collection, name: str, data: bpy.types.Mesh) -> bpy.types.Object:
    """Add an object that shows a mesh to a collection, and return it."""
    item = bpy.data.objects.new(name, data)
    collection.objects.link(item)
    # Nothing moves while the shutter is open. Without this setting, Cycles evaluates every object at three times.
    item.cycles.use_motion_blur = False
    # Blender's smoothing of the shadow terminator is off.
    item.shadow_terminator_geometry_offset = item.shadow_terminator_shading_offset = 0.0
    return item


def _add_second_user(scene: bpy.types.Scene, data: bpy.types.Mesh, asset: Asset) -> None:
    """Give a mesh a second user, so that Cycles keeps it as an instance with its own acceleration structure.

    A user is an object that shows the mesh. Cycles merges a mesh with a single user into the acceleration structure of
    the scene, and rebuilds that after any change of an object: 40 ms for 260,000 triangles, twice a frame. The second
    user is a speck far below the asset, hidden from every kind of ray that contributes to a picture. It is not hidden
    from all kinds, because Cycles would then leave the object out.
    """
    speck = _add_object(scene.collection, "speck", data)
    speck.location = (0.0, 0.0, -1e3 * asset.radius)
    speck.scale = (1e-6, 1e-6, 1e-6)
    speck.visible_camera = speck.visible_diffuse = speck.visible_glossy = False
    speck.visible_transmission = speck.visible_shadow = False
    speck.visible_volume_scatter = True


def _add_instances(
    scene: bpy.types.Scene, name: str, meshes: Sequence[bpy.types.Mesh], numbers: Indices, matrices: Floats
) -> bpy.types.Object:
    """Add an object that shows n instances, instance i as ``meshes[numbers[i]]`` with the matrix ``matrices[i]``.

    numbers : (n,); matrices : (n, 4, 4). All instances have the colour of the object.
    """
    # The collection is linked to no scene, so that only the instances are visible. Blender orders the objects of a
    # collection by name, so the names have numbers of equal width.
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


def _instancing_tree(prototypes: bpy.types.Collection) -> bpy.types.GeometryNodeTree:
    """Return geometry nodes that replace each point by an instance.

    The attributes of the point have the index of an object in `prototypes`, and the matrix of the instance.
    """
    tree = bpy.data.node_groups.new("instances", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")

    def add(kind: str, **inputs: object) -> bpy.types.Node:
        """Add a node, with values or linked sockets as inputs, by identifier."""
        node = tree.nodes.new(kind)
        for name, value in inputs.items():
            socket = next(candidate for candidate in node.inputs if candidate.identifier == name)
            if isinstance(value, bpy.types.NodeSocket):
                tree.links.new(value, socket)
            else:
                socket.default_value = value
        return node

    def attribute(name: str, kind: str) -> bpy.types.NodeSocket:
        """Add a node that reads an attribute of points; return its output."""
        node = add("GeometryNodeInputNamedAttribute", Name=name)
        node.data_type = kind
        return next(output for output in node.outputs if output.enabled and output.name == "Attribute")

    meshes = add("GeometryNodeCollectionInfo", Collection=prototypes, **{"Separate Children": True})
    instances = add(
        "GeometryNodeInstanceOnPoints",
        Points=add("NodeGroupInput").outputs[0],
        Instance=meshes.outputs[0],
        **{"Pick Instance": True, "Instance Index": attribute("prototype", "INT")},
    )
    transformed = add(
        "GeometryNodeSetInstanceTransform",
        Instances=instances.outputs[0],
        Transform=attribute("matrix", "FLOAT4X4"),
    )
    tree.links.new(transformed.outputs[0], add("NodeGroupOutput").inputs[0])
    return tree


def _build_mesh(
    mesh: Mesh,
    sources: Sequence[GeneratedSource],
    slot_sources: Ints,
    materials: Sequence[bpy.types.Material],
    *,
    separate: bool,
) -> bpy.types.Mesh:
    """Build a mesh with its materials and the attributes that the sources of its slots read; see `add_asset`."""
    data = bpy.data.meshes.new(mesh.name)
    data.vertices.add(len(mesh.points))
    data.loops.add(len(mesh.corner_points))
    data.polygons.add(len(mesh.face_sizes))
    data.polygons.foreach_set("loop_start", run_starts(mesh.face_sizes).astype(np.int32))
    # These attributes are set as whole arrays, instead of one vertex or corner at a time.
    data.attributes["position"].data.foreach_set("vector", mesh.points.ravel())
    data.attributes[".corner_vert"].data.foreach_set("value", mesh.corner_points)
    face_sources = slot_sources[mesh.face_slots]
    is_used = np.bincount(face_sources) > 0
    used = np.flatnonzero(is_used)
    for number in used:
        data.materials.append(materials[number])
    if len(used) > 1:
        index = np.cumsum(is_used, dtype=np.int32) - 1
        _add_attribute(data, "material_index", index[face_sources], "FACE")
    if separate:
        data.update(calc_edges=True)
    # Shaders read the normals that are added below. For Blender, faces are flat: its smooth normals would cancel at
    # points where faces meet their reversed duplicates.
    _add_attribute(data, "sharp_face", np.ones(len(mesh.face_sizes), bool), "FACE")
    bindings = {number: sources[number].attributes for number in used.tolist()}
    read_uv_sets = {binding.attribute for bound in bindings.values() for binding in bound if binding.kind == "uv"}
    for name, uv in mesh.uvs.items():
        if separate or name in read_uv_sets:
            short = short_name(name)
            data.uv_layers.new(name=short, do_init=False)
            data.attributes[short].data.foreach_set("vector", uv.ravel())
    # Normals are stored as an attribute of 32-bit floats. Blender's own custom normals would have 16 bits.
    _add_attribute(data, "lookdev_normal", *_compact_values(mesh, mesh.normals))
    for name, values in _read_attributes(mesh, face_sources, bindings).items():
        _add_attribute(data, name, *_compact_values(mesh, values))
    return data


def _compact_values(mesh: Mesh, values: Floats32) -> tuple[Floats32, str]:
    """Return the values of corners in the smallest domain of Blender that has the same values, and that domain.

    The domain is ``"FACE"`` or ``"POINT"`` if the values of all corners of each face or point are equal, and
    ``"CORNER"`` otherwise. Cycles stores the values of corners three times for every triangle.
    """
    sizes = mesh.face_sizes
    at_faces = values[run_starts(sizes)]
    if all(
        np.array_equal(values[corners], np.repeat(at_faces[faces], sizes[faces], axis=0))
        for faces, corners in face_blocks(sizes)
    ):
        return at_faces, "FACE"
    at_points = np.zeros((len(mesh.points), *values.shape[1:]), np.float32)
    at_points[mesh.corner_points] = values
    if all(
        np.array_equal(values[corners], at_points[mesh.corner_points[corners]]) for _, corners in face_blocks(sizes)
    ):
        return at_points, "POINT"
    return values, "CORNER"


def _read_attributes(
    mesh: Mesh, face_sources: Ints, bindings: dict[int, tuple[AttributeBinding, ...]]
) -> dict[str, Floats32]:
    """Return the attributes of a mesh that sources read, except UV sets, by name: values at all corners.

    An attribute that the mesh lacks has the fallback of its binding. `face_sources` has the number of the source of
    each face. `bindings` has the attributes that each source reads, by the number of the source.
    """
    attributes: dict[str, Floats32] = {}
    lacking: dict[str, dict[int, tuple[float, ...]]] = {}
    for number, source_bindings in bindings.items():
        for binding in source_bindings:
            if binding.attribute == HANDEDNESS:
                attributes[HANDEDNESS] = handedness(mesh)
            elif binding.attribute == TANGENT:
                assert mesh.tangents is not None, "a scene task has the tangents that its sources read"
                attributes[TANGENT] = mesh.tangents
            elif binding.attribute in mesh.primvars:
                attributes[binding.mesh_name] = mesh.primvars[binding.attribute]
            elif binding.fallback is not None:
                lacking.setdefault(binding.mesh_name, {})[number] = binding.fallback
    for name, fallbacks in lacking.items():
        width = max(map(len, fallbacks.values()))
        at_faces = np.zeros((len(face_sources), width) if width > 1 else len(face_sources), np.float32)
        for number, fallback in fallbacks.items():
            at_faces[face_sources == number] = fallback if width > 1 else fallback[0]
        attributes[name] = np.repeat(at_faces, mesh.face_sizes, axis=0)
    return attributes


_ATTRIBUTE_TYPES = {
    ("b", 1): ("BOOLEAN", "value"),
    ("i", 1): ("INT", "value"),
    ("f", 1): ("FLOAT", "value"),
    ("f", 2): ("FLOAT_VECTOR", "vector"),
}
"""Blender's type of attribute and its field, by two properties of an array: the kind of its NumPy type, and `ndim`.

Colours are stored as vectors, to which Blender applies no colour space.
"""


def _add_attribute(data: bpy.types.Mesh, name: str, values: Elements, domain: str = "CORNER") -> None:
    """Add an attribute with a value for each element of a domain."""
    kind, field = _ATTRIBUTE_TYPES[values.dtype.kind, values.ndim]
    attribute = data.attributes.new(name, kind, domain)
    attribute.data.foreach_set(field, np.ascontiguousarray(values).ravel())
