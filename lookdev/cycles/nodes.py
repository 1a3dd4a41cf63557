"""Builds materials and node groups of Blender from the plain data of a `NodeSource`, and adds single nodes."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence, Sized
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

import bpy
from bpy.types import NodeTreeInterface, NodeTreeInterfacePanel, ShaderNodeTree

from lookdev.codegen.source import GroupSocket, NodeLink, NodeSource, NodeTree, ShaderNode, SocketValue
from lookdev.cycles import version
from lookdev.errors import ContentError, RenderError, nearest_hint

# The sockets of these nodes are looked up by name, because Blender generates the identifiers of a group's sockets. The
# sockets of other nodes are looked up by identifier.
_SOCKETS_BY_NAME = ("ShaderNodeGroup", "NodeGroupInput", "NodeGroupOutput")

SocketInput: TypeAlias = "bpy.types.NodeSocket | float | Sequence[float]"
"""An input of a node: the output of another node, or a value."""

Groups = dict[str, ShaderNodeTree]
"""Node groups that are built, by a digest of their content. Looks with equal groups share a datablock."""


def build_material(source: NodeSource, shared_groups: Groups | None = None) -> bpy.types.Material:
    """Build a material and its node groups. Groups are taken from `shared_groups`, or built and added there.

    Raises
    ------
    RenderError
        Blender lacks a kind of node, a property or a socket, or a group or an image is missing.
    """
    cache: Groups = {} if shared_groups is None else shared_groups
    groups: Groups = {}
    digests: dict[str, str] = {}
    for tree in source.trees[:-1]:
        group_digests = [digests.get(node.group) for node in tree.nodes if node.group]
        digests[tree.name] = digest = hashlib.sha256(f"{tree!r} {group_digests}".encode()).hexdigest()
        if digest not in cache:
            cache[digest] = _build_group(source, tree, groups)
        groups[tree.name] = cache[digest]
    material = bpy.data.materials.new(source.name)
    # Cycles must not treat the material as a light. Cycles must not correct bumped normals either: the nodes bend them.
    material.cycles.emission_sampling = "NONE"
    material.cycles.use_bump_map_correction = False
    material.use_transparent_shadow = True
    _fill_tree(source, source.trees[-1], version.clear_node_tree(material), groups)
    return material


def add_node(
    tree: ShaderNodeTree, kind: str, inputs: Mapping[Any, SocketInput] = MappingProxyType({}), **settings: object
) -> bpy.types.Node:
    """Add a shader node to a tree and return it.

    `kind` is Blender's type without the prefix ``ShaderNode``. `inputs` has values or sockets by the name or index of
    the input. `settings` are attributes of the node.
    """
    node = tree.nodes.new(f"ShaderNode{kind}")
    for name, setting in settings.items():
        setattr(node, name, setting)
    for key, value in inputs.items():
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, node.inputs[key])
        else:
            node.inputs[key].default_value = value
    return node


def load_image(file: Path) -> bpy.types.Image:
    """Load a linear image without conversion or premultiplication; raises RenderError where it cannot be loaded.

    Blender loads a file only once.
    """
    try:
        image = bpy.data.images.load(str(file), check_existing=True)
    except RuntimeError as error:
        raise RenderError(f"{file}: Blender cannot load the image: {str(error).strip()}") from error
    image.colorspace_settings.name = "Non-Color"
    image.alpha_mode = "CHANNEL_PACKED"
    return image


def _build_group(source: NodeSource, tree: NodeTree, groups: Groups) -> ShaderNodeTree:
    """Build a node group with its interface; `groups` has the groups that it contains, by name."""
    group = bpy.data.node_groups.new(tree.name, "ShaderNodeTree")
    panels: dict[str, NodeTreeInterfacePanel] = {}
    for in_out, sockets in (("OUTPUT", tree.outputs), ("INPUT", tree.inputs)):
        for socket in sockets:
            if socket.panel and socket.panel not in panels:
                panels[socket.panel] = group.interface.new_panel(socket.panel)
            _add_socket(group.interface, socket, in_out, panels.get(socket.panel))
    _fill_tree(source, tree, group, groups)
    return group


def _add_socket(
    interface: NodeTreeInterface, socket: GroupSocket, in_out: str, panel: NodeTreeInterfacePanel | None
) -> None:
    """Add a socket to the interface of a group; `in_out` is ``"INPUT"`` or ``"OUTPUT"``."""
    kind = f"NodeSocket{socket.kind.title()}"
    socket_item = interface.new_socket(
        socket.name, description=socket.help, in_out=in_out, socket_type=kind, parent=panel
    )
    if in_out == "OUTPUT" or socket.kind == "shader":
        return
    if socket.kind != "color":
        if socket.kind == "float" and socket.soft == (0.0, 1.0):
            socket_item.subtype = "FACTOR"
        socket_item.min_value, socket_item.max_value = socket.soft
    socket_item.default_value = _pad_color(socket.default, socket_item.default_value)


def _fill_tree(source: NodeSource, tree: NodeTree, node_tree: ShaderNodeTree, groups: Groups) -> None:
    """Add the nodes of `tree`, then their links, to Blender's `node_tree`."""
    location = f"look '{source.name}', nodes '{tree.name}'"
    nodes = {}
    for node in tree.nodes:
        try:
            nodes[node.name] = _add_node(node, node_tree, groups)
        except (ContentError, RenderError) as error:
            raise RenderError(f"{location}, '{node.name}': {error}") from error
    # Blender updates a whole tree whenever a property in it is set. Therefore all locations are set at once, and other
    # values only if they change.
    node_tree.nodes.foreach_set("location", [x for node in tree.nodes for x in node.position])
    for node in tree.nodes:
        for identifier, value in node.inputs.items():
            if not isinstance(value, NodeLink):
                continue
            if value.node not in nodes:
                raise RenderError(
                    f"{location}, '{node.name}': '{identifier}' is linked to a missing node '{value.node}'"
                )
            try:
                start = _socket(nodes[value.node], "outputs", value.socket)
                end = _socket(nodes[node.name], "inputs", identifier)
            except RenderError as error:
                raise RenderError(f"{location}, '{value.node}' to '{node.name}': {error}") from error
            node_tree.links.new(start, end)


def _add_node(node: ShaderNode, node_tree: ShaderNodeTree, groups: Groups) -> bpy.types.Node:
    """Add a node with its properties and values, but without links."""
    kind = node.kind if node.kind.startswith("Node") else f"ShaderNode{node.kind}"
    try:
        blender_node = node_tree.nodes.new(kind)
    except RuntimeError as error:
        raise RenderError(f"Blender {version.VERSION} has no node of kind '{node.kind}'") from error
    blender_node.name = node.name
    blender_node.label = node.label
    if node.group:
        if node.group not in groups:
            raise RenderError(f"it shows a group '{node.group}', which no tree before it defines")
        blender_node.node_tree = groups[node.group]
    if node.image is not None:
        blender_node.image = load_image(node.image.path)
    for name, setting in node.properties.items():
        _set_property(blender_node, name, setting)
    for identifier, value in node.inputs.items():
        if not isinstance(value, NodeLink):
            socket = _socket(blender_node, "inputs", identifier)
            try:
                _set_changed(socket, "default_value", _pad_color(value, socket.default_value))
            except (TypeError, ValueError, AttributeError) as error:
                raise RenderError(f"socket '{identifier}' does not take {value!r}: {error}") from error
    return blender_node


def _set_property(node: bpy.types.Node, name: str, value: SocketValue | bool) -> None:
    """Set a property of a node; raises RenderError where Blender lacks the property or does not take the value."""
    try:
        if name not in node.bl_rna.properties:
            raise AttributeError("there is none")
        # The value may come from JSON, where whole numbers may be floats.
        convert = {"INT": int, "BOOLEAN": bool}.get(node.bl_rna.properties[name].type)
        _set_changed(node, name, convert(value) if convert else value)
    except (TypeError, ValueError, AttributeError) as error:
        raise RenderError(f"property '{name}' cannot be {value!r}: {error}") from error


def _set_changed(owner: bpy.types.Node | bpy.types.NodeSocket, name: str, value: object) -> None:
    """Set an attribute, unless it has the value already."""
    old = getattr(owner, name)
    if (tuple(old) if isinstance(value, tuple) else old) != value:
        setattr(owner, name, value)


def _socket(node: bpy.types.Node, side: str, identifier: str) -> bpy.types.NodeSocket:
    """Return a socket of a node; raises RenderError where the socket is missing or disabled.

    Blender lets a disabled socket be set and linked, without effect.
    """
    key = "name" if node.bl_idname in _SOCKETS_BY_NAME else "identifier"
    enabled = {getattr(socket, key): socket for socket in getattr(node, side) if socket.enabled}
    if identifier not in enabled:
        raise RenderError(f"no socket '{identifier}' among the {side} ({nearest_hint(identifier, list(enabled))})")
    return enabled[identifier]


def _pad_color(value: SocketValue, old: Sized) -> SocketValue:
    """Return a value for a socket: a colour gets a fourth channel if the socket's old value has one."""
    if isinstance(value, tuple) and len(value) == 3 and len(old) == 4:
        return (*value, 1.0)
    return value
