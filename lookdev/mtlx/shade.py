"""Converts a MaterialX document to a USD layer in which prims have the paths that USD's MaterialX plugin gives them.

- /MaterialX/Materials/<name> is a Material, whose `outputs:mtlx:surface` is connected to its shader. The shader's
  inputs without a connection are also inputs of the material, which other layers may override.
- A node is a Shader. Its `info:id` is the name of its node definition, by the convention ``ND_<category>_<type>``.
- Values, connections and colour spaces (as `colorSpace` of an attribute) are as in the document. Paths of images
  become absolute, lengths are in metres, and angles in degrees.

All nodes upstream of a material are written into that material, so that a reference to the material alone is complete.
In the code, a port is an input or output of a MaterialX element.
"""

from __future__ import annotations

import math
import posixpath
import re
from dataclasses import astuple
from itertools import count
from pathlib import Path

import MaterialX as mx
from pxr import Ar, Sdf, Tf

from lookdev.arrays import MAX_MAGNITUDE
from lookdev.cache import Content
from lookdev.errors import Fault, LookError
from lookdev.mtlx.document import INVALID_IMAGE_PATH, library_inputs, read_document
from lookdev.safe_text import TextError, read_bytes

NOTES_KEY = "lookdev:notes"
"""The key of a layer's customLayerData for notes about the parts of the document that the layer lacks.

The value has a line for each note: file, path, text and hint, separated by tabs."""

_MAX_PRIMS = 100_000  # of a layer
# The types of attributes in USD, by type in MaterialX; other types become tokens.
_TYPES = {
    "float": Sdf.ValueTypeNames.Float,
    "integer": Sdf.ValueTypeNames.Int,
    "boolean": Sdf.ValueTypeNames.Bool,
    "string": Sdf.ValueTypeNames.String,
    "filename": Sdf.ValueTypeNames.Asset,
    "color3": Sdf.ValueTypeNames.Color3f,
    "color4": Sdf.ValueTypeNames.Color4f,
    "vector2": Sdf.ValueTypeNames.Float2,
    "vector3": Sdf.ValueTypeNames.Float3,
    "vector4": Sdf.ValueTypeNames.Float4,
}
_COMPONENT_COUNTS = {"float": 1, "integer": 1, "vector2": 2, "color3": 3, "vector3": 3, "color4": 4, "vector4": 4}
# The XML attributes of a port that connect it: to an input of its graph, a graph, a node, or an output.
_CONNECTION_ATTRIBUTES = ("interfacename", "nodegraph", "nodename", "output")
# Factors from the units of MaterialX to metres and to degrees.
_UNITS = {"meter": 1.0, "micrometer": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "kilometer": 1e3}
_UNITS |= {"inch": 0.0254, "foot": 0.3048, "yard": 0.9144, "mile": 1609.344}
_UNITS |= {"degree": 1.0, "radian": math.degrees(1.0)}
# By category of a surface shader: the file of the MaterialX library that has its node definition.
_DEFINITION_FILES = {name: name for name in ("standard_surface", "open_pbr_surface", "gltf_pbr")}
_DEFINITION_FILES |= {"UsdPreviewSurface": "usd_preview_surface"}
# Suffixes of the names of node definitions, for versions of a category that are not the default.
_VERSION_SUFFIXES = {("standard_surface", "1.0.0"): "_100"}
# The inputs of a material node that are read, and the names of the corresponding outputs of a Material.
_TERMINALS = {"surfaceshader": "surface", "displacementshader": "displacement"}


def document_layer(path: str) -> Path:
    """Return the cached file of the USD layer that a MaterialX document converts to.

    Parameters
    ----------
    path
        The path of the document, which may be inside a package: ``a.usdz[b.mtlx]``.

    Raises
    ------
    LookError
        The document is missing or malformed. The error has all faults, with their locations in the document.
    """
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path)) if Ar.IsPackageRelativePath(path) else None
    try:
        data = asset.GetBuffer() if asset else read_bytes(Path(path))
    except TextError as error:
        raise LookError(error.faults) from None
    text = _Writer(data, path).layer_text()
    return Content.store_bytes(text.encode(), ".usda").path


class _Writer:
    """Writes the materials of a document to a layer.

    `notes` are about parts of the document that the layer lacks; `faults` are errors of the document.
    """

    def __init__(self, data: bytes, file: str) -> None:
        self.file = file
        self.document, notes = read_document(data, file)
        self.notes = list(notes)
        self.faults: list[Fault] = []
        self._layer = Sdf.Layer.CreateAnonymous(".usda")
        self._prim_count = 0
        # State of the current material. `_written` has the prims of nodes and graphs, by the paths of their MaterialX
        # elements. `_pending` has the nodes whose prims still lack inputs, by the paths of the prims.
        self._material: Sdf.PrimSpec
        self._written: dict[str, Sdf.PrimSpec] = {}
        self._pending: dict[Sdf.Path, tuple[mx.Node, Sdf.PrimSpec]] = {}

    def layer_text(self) -> str:
        """Write the materials and return the layer as text; raises LookError with all faults of the document."""
        root = self._define_prim(self._layer, "MaterialX", "Scope")
        materials = self._define_prim(root, "Materials", "Scope")
        for node in self.document.getMaterialNodes():
            self._write_material(materials, node)
        for child in self.document.getChildren():
            if not isinstance(child, mx.Node | mx.NodeGraph | mx.Output):
                self._add_note(child, f"<{child.getCategory()}> is not read")
        if self.faults:
            raise LookError(self.faults)
        self._layer.defaultPrim = "MaterialX"
        if self.notes:
            lines = ("\t".join(" ".join(text.split()) for text in astuple(note)) for note in self.notes)
            self._layer.customLayerData = {NOTES_KEY: "\n".join(lines)}
        return str(self._layer.ExportToString())

    def _add_note(self, element: mx.Element, message: str, hint: str = "") -> None:
        """Add a note about an element of the document."""
        self.notes.append(Fault(self.file, element.getNamePath(), message, hint))

    def _define_prim(self, parent: Sdf.Layer | Sdf.PrimSpec, name: str, kind: str) -> Sdf.PrimSpec:
        """Define a prim of the type `kind` with a MaterialX name, which is changed if it is invalid or not unique."""
        self._prim_count += 1
        if self._prim_count > _MAX_PRIMS:
            message = f"its materials are made of more than {_MAX_PRIMS} nodes, each counted for every material"
            raise LookError([Fault(self.file, "", message)])
        siblings = parent.rootPrims if isinstance(parent, Sdf.Layer) else parent.nameChildren
        valid = Tf.MakeValidIdentifier(name.replace(":", "__"))
        unique = next(candidate for n in count(1) if (candidate := valid if n == 1 else f"{valid}_{n}") not in siblings)
        return Sdf.PrimSpec(parent, unique, Sdf.SpecifierDef, kind)

    def _write_material(self, materials: Sdf.PrimSpec, node: mx.Node) -> None:
        """Write a material node, with all nodes upstream, below the prim `materials`."""
        self._material = self._define_prim(materials, node.getName(), "Material")
        self._written.clear()
        for name, terminal in _TERMINALS.items():
            if (port := node.getInput(name)) and (target := self._write_target(port, self.document)):
                output = self._get_attribute(self._material, f"outputs:mtlx:{terminal}", "token")
                output.connectionPathList.explicitItems = [target]
                self._write_terminal_shader(target.GetPrimPath())
        for port in node.getInputs():
            if port.getName() not in _TERMINALS:
                self._add_note(port, "is not read", f"only {' and '.join(_TERMINALS)} are")
        while self._pending:
            _, (element, shader) = self._pending.popitem()
            self._write_inputs(shader, element, element.getParent())

    def _write_terminal_shader(self, path: Sdf.Path) -> None:
        """Write the inputs of the shader at `path`, whose output is connected to the material.

        An input without a connection of its own is connected to an input of the material with the same name, which has
        the value. Nothing is written if the shader's inputs have been written before.
        """
        if path not in self._pending:
            return
        # `interface` has the inputs of the shader's definition, with defaults, and `ports` the inputs in the document.
        node, shader = self._pending.pop(path)
        ports = {port.getName(): port for port in node.getInputs()}
        category = node.getCategory()
        interface = (
            library_inputs(_DEFINITION_FILES[category], f"ND_{category}_surfaceshader")
            if category in _DEFINITION_FILES
            else {}
        )
        types = {name: port.getType() for name, port in (interface | ports).items()}
        for name, kind in types.items():
            inner = self._get_attribute(shader, f"inputs:{name}", kind)
            if name in ports and _is_connected(ports[name]):
                self._set_attribute(inner, ports[name], node.getParent())
                continue
            outer = self._get_attribute(self._material, f"inputs:{name}", kind)
            inner.connectionPathList.explicitItems = [outer.path]
            if name in ports:
                self._set_attribute(outer, ports[name], node.getParent())

    def _write_inputs(self, prim: Sdf.PrimSpec, element: mx.InterfaceElement, scope: mx.GraphElement) -> None:
        """Write the inputs of an element to its prim; `scope` is as in `_write_target`."""
        for port in element.getInputs():
            self._set_attribute(self._get_attribute(prim, f"inputs:{port.getName()}", port.getType()), port, scope)

    def _get_attribute(self, prim: Sdf.PrimSpec, name: str, kind: str) -> Sdf.AttributeSpec:
        """Return a prim's attribute, or create it with the MaterialX type `kind`; an invalid `name` is changed."""
        valid = ":".join(map(Tf.MakeValidIdentifier, name.split(":")))
        attribute = prim.attributes.get(valid)
        return attribute or Sdf.AttributeSpec(prim, valid, _TYPES.get(kind, Sdf.ValueTypeNames.Token))

    def _set_attribute(self, attribute: Sdf.AttributeSpec, port: mx.PortElement, scope: mx.GraphElement) -> None:
        """Set the value or the connection of an attribute from a port; `scope` is as in `_write_target`."""
        if target := self._write_target(port, scope):
            if channels := port.getAttribute("channels"):
                target = self._add_swizzle(attribute, target, port, channels)
            attribute.connectionPathList.explicitItems = [target]
            return
        if not port.getValueString():
            empty = [name for name in ("value", *_CONNECTION_ATTRIBUTES) if port.hasAttribute(name)]
            if empty and port.getType() not in ("string", "filename"):
                self._add_note(port, f"has an empty '{empty[0]}'", "its default is taken")
            return
        value = self._read_value(port)
        if value is not None:
            attribute.default = value
        space = port.getActiveColorSpace()
        if space and port.getType() in ("color3", "color4", "filename"):
            attribute.SetInfo("colorSpace", space)

    def _add_swizzle(
        self, attribute: Sdf.AttributeSpec, target: Sdf.Path, port: mx.PortElement, channels: str
    ) -> Sdf.Path:
        """Add a swizzle node between a port and its source `target`, for the channels that the port names.

        Return the path of the swizzle's output.
        """
        name = f"{attribute.owner.name}_{port.getName()}_channels"
        swizzle = self._define_shader(attribute.owner.nameParent, name, f"ND_swizzle_{port.getType()}")
        self._get_attribute(swizzle, "inputs:in", "token").connectionPathList.explicitItems = [target]
        self._get_attribute(swizzle, "inputs:channels", "string").default = channels
        return self._get_attribute(swizzle, "outputs:out", port.getType()).path

    def _define_shader(self, parent: Sdf.PrimSpec, name: str, identifier: str) -> Sdf.PrimSpec:
        """Define a Shader with the name of a node definition as its `info:id`."""
        shader = self._define_prim(parent, name, "Shader")
        Sdf.AttributeSpec(shader, "info:id", Sdf.ValueTypeNames.Token, Sdf.VariabilityUniform).default = identifier
        return shader

    def _write_target(self, port: mx.PortElement, scope: mx.GraphElement) -> Sdf.Path | None:
        """Write the prims to which a port is connected; return the path of the connected property, or None for a value.

        `scope` is the document or the node graph whose children the port's connections name. The result for a missing
        element is a path without a prim, which the reader of the material reports.
        """
        seen = set()  # the outputs followed so far, since they can be connected in a cycle
        while _is_connected(port):
            interface, graph, node, output = (port.getAttribute(name) for name in _CONNECTION_ATTRIBUTES)
            parent = self._define_container(scope)
            if interface:
                return parent.path.AppendProperty(f"inputs:{Tf.MakeValidIdentifier(interface)}")
            if graph or node:
                sibling = scope.getChild(graph or node) or self.document.getChild(graph or node)
                if isinstance(sibling, mx.NodeGraph):
                    return self._write_graph_output(sibling, output)
                if isinstance(sibling, mx.Node):
                    shader = self._define_node(sibling)
                    return self._get_attribute(shader, f"outputs:{output or 'out'}", sibling.getType()).path
            elif (sibling := scope.getOutput(output)) and output not in seen:
                seen.add(output)
                port = sibling
                continue
            missing = Tf.MakeValidIdentifier(graph or node or output)
            return parent.path.AppendChild(missing).AppendProperty("outputs:out")
        return None

    def _define_container(self, scope: mx.GraphElement) -> Sdf.PrimSpec:
        """Return the parent prim for the nodes of a scope: the material for the document, or else a NodeGraph."""
        if not isinstance(scope, mx.NodeGraph):
            return self._material
        path = scope.getNamePath()
        if path not in self._written:
            self._written[path] = self._define_prim(self._material, scope.getName(), "NodeGraph")
            self._write_inputs(self._written[path], scope, self.document)
        return self._written[path]

    def _write_graph_output(self, graph: mx.NodeGraph, name: str) -> Sdf.Path:
        """Write an output of a node graph, by default its only output, and return the path of its attribute."""
        outputs = graph.getOutputs()
        name = name or (outputs[0].getName() if len(outputs) == 1 else "out")
        prim = self._define_container(graph)
        path: Sdf.Path = prim.path.AppendProperty(f"outputs:{Tf.MakeValidIdentifier(name)}")
        output = graph.getOutput(name)
        if output and path.name not in prim.attributes:
            self._set_attribute(self._get_attribute(prim, path.name, output.getType()), output, graph)
        return path

    def _define_node(self, node: mx.Node) -> Sdf.PrimSpec:
        """Return the Shader of a node in the current material; a new one is added to `_pending`."""
        path = node.getNamePath()
        if path not in self._written:
            version = _VERSION_SUFFIXES.get((node.getCategory(), node.getVersionString()), "")
            identifier = node.getNodeDefString() or f"ND_{node.getCategory()}_{node.getType()}{version}"
            parent = self._define_container(node.getParent())
            self._written[path] = self._define_shader(parent, node.getName(), identifier)
            self._pending[self._written[path].path] = (node, self._written[path])
        return self._written[path]

    def _read_value(self, port: mx.PortElement) -> object:
        """Return the value of a port in a type that USD takes, or None.

        None means that a note about an unknown type or a fault about a malformed value has been added.
        """
        kind, text = port.getType(), port.getValueString()
        if kind == "filename":
            return self._read_asset(port)
        if kind == "string":
            return text
        if kind == "boolean" and text in ("true", "false"):
            return text == "true"
        if kind in _COMPONENT_COUNTS:
            try:
                numbers = tuple(float(part) for part in re.split(r"[,\s]+", text.strip()))
            except ValueError:
                numbers = ()
            is_integral = kind != "integer" or all(number.is_integer() for number in numbers)
            if (
                is_integral
                and len(numbers) == _COMPONENT_COUNTS[kind]
                and all(abs(number) <= MAX_MAGNITUDE for number in numbers)
            ):
                scale = self._unit_scale(port)
                numbers = tuple(number * scale for number in numbers)
                return int(numbers[0]) if kind == "integer" else numbers[0] if len(numbers) == 1 else numbers
        elif kind != "boolean":
            self._add_note(port, f"a value of type '{kind:.40}' is not read")
            return None
        sort = "whole" if kind == "integer" else "finite"
        hint = f"{_COMPONENT_COUNTS.get(kind, 1)} {sort} numbers, separated by commas, within {MAX_MAGNITUDE:g}"
        hint = "true or false" if kind == "boolean" else hint
        self.faults.append(Fault(self.file, port.getNamePath(), f"'{text:.40}' is not a value", hint))
        return None

    def _unit_scale(self, port: mx.PortElement) -> float:
        """Return the factor from a port's unit to metres or degrees; 1 without a unit, or for an unknown unit."""
        unit = port.getUnit()
        if unit and unit not in _UNITS:
            self._add_note(port, f"the unit '{unit:.40}' is unknown", f"one of {', '.join(_UNITS)} is read")
        return _UNITS.get(unit, 1.0)

    def _read_asset(self, port: mx.PortElement) -> Sdf.AssetPath | None:
        """Return the absolute path of the image that a port names, or None, with a note, if the name is not allowed.

        The name may be relative to the document, and the document may have a prefix for the names of files.
        """
        # Documents come from all operating systems: either slash can separate folders.
        prefix, name = port.getActiveFilePrefix(), port.getValueString()
        prefixed, plain = (mx.FilePath(path).asString(mx.FormatPosix) for path in (prefix + name, name))
        if INVALID_IMAGE_PATH.search(prefixed):
            self._add_note(port, f"'{prefixed:.80}' is not read", "the path of one image or of a <UDIM> set is")
            return None
        image = self._absolute_path(prefixed)
        if prefix and not Path(image).exists() and Path(self._absolute_path(plain)).is_file():
            self._add_note(port, f"there is no {prefixed:.80}", f"{plain:.80}, without the fileprefix, is taken")
            image = self._absolute_path(plain)
        return Sdf.AssetPath(image)

    def _absolute_path(self, name: str) -> str:
        """Return the absolute path of a file, which may be in the document's package."""
        if posixpath.isabs(name):
            return name
        if Ar.IsPackageRelativePath(self.file):
            package, inner = Ar.SplitPackageRelativePathInner(self.file)
            inside = posixpath.normpath(posixpath.join(posixpath.dirname(inner), name))
            return str(Ar.JoinPackageRelativePath(package, inside))
        return posixpath.normpath(posixpath.join(Path(self.file).absolute().parent.as_posix(), name))


def _is_connected(port: mx.PortElement) -> bool:
    """Return whether a port has a connection instead of a value."""
    return any(port.getAttribute(name) for name in _CONNECTION_ATTRIBUTES)
