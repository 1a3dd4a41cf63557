"""Imports MaterialX documents as looks in USD: each surface of the model `disney_principled` becomes a Disney layer.

The command ``lookdev materials import`` uses this package. Inputs are carried over by name, and all losses are listed.

The node `disney_principled` has the parameters of Burley's BRDF. Its node graph in the MaterialX library approximates
this BRDF by stock lobes; here the parameters have the meaning of Burley's paper. docs/materialx.md lists the
differences.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count
from pathlib import Path, PurePosixPath

import MaterialX as mx
from pxr import Sdf, Sdr, Tf, Usd, UsdShade

from lookdev.brdf.disney import DISNEY
from lookdev.cache import atomic_path
from lookdev.errors import Fault, OutputError, nearest_hint
from lookdev.material import Primvar
from lookdev.material.definitions import USD_TYPES
from lookdev.material.library import LOOK_SUFFIXES
from lookdev.material.library.nodes import relative_path
from lookdev.material.materialx.inputs import (
    MATERIALX_TYPES,
    DocumentValue,
    ImageChannel,
    ImageNode,
    Transform2d,
    parse_constant,
    read_value,
)
from lookdev.material.materialx.network import DocumentNetwork
from lookdev.mtlx import library_inputs

SURFACE_NODE = "disney_principled"
"""The only surface shader that is imported."""

_JOB_HINT = "the document itself, as 'material' of a look in a job, is read whatever its model"
_PARAMETERS = DISNEY.parameters
# Why inputs of a `disney_principled` that a Disney layer does not have are lost, by name.
_LOSS_REASONS = {
    "specTrans": "a LookdevDisney layer lets no light through",
    "ior": "it bends the light of specTrans; what is reflected at normal incidence is specular's",
    "subsurfaceDistance": "subsurface is a shape of the diffuse lobe: light leaves where it entered",
}
_IDENTITY = Transform2d()
_TYPES = Sdf.ValueTypeNames


@dataclass(frozen=True)
class ImportedMaterial:
    """A surfacematerial of a document as one Disney layer. `inputs` has values other than the layer's defaults."""

    name: str
    inputs: dict[str, DocumentValue]


@dataclass(frozen=True)
class ImportedDocument:
    """The materials of a document. `losses` has each input, node and connection that is not carried over."""

    file: Path
    materials: tuple[ImportedMaterial, ...]
    losses: tuple[Fault, ...]


def import_materialx(file: Path) -> ImportedDocument:
    """Read every surfacematerial of a MaterialX document whose surface shader is a `disney_principled`.

    Raises
    ------
    LookError
        The file is missing, is not MaterialX, or has faults (connections that are missing or in a cycle, wrong types,
        values that are not numbers), or none of its materials has such a shader.
    """
    network = DocumentNetwork(file)
    nodes = network.document.getMaterialNodes()
    network.connect(nodes)
    network.raise_faults()
    layers: dict[str, dict[str, DocumentValue]] = {}
    materials = tuple(imported for material in nodes if (imported := _read_material(network, material, layers)))
    if not nodes:
        network.add_fault("", "holds no surfacematerial", f"one whose surface shader is a {SURFACE_NODE} is right")
    elif not materials:
        for loss in network.losses:
            network.add_fault(loss.where, loss.what, loss.hint)
    network.raise_faults()
    network.add_unread_losses()
    return ImportedDocument(file, materials, network.losses)


def write_usda(imported: ImportedDocument, path: Path, *, replace: bool = False) -> None:
    """Write imported materials to a USD file as looks, each with one LookdevDisney layer.

    A single material becomes the default prim. Image paths relative to the document become relative to `path`. Raises
    OutputError where `path` is not the path of a USD file, or exists and `replace` is not set.
    """
    if path.suffix.lower() not in LOOK_SUFFIXES:
        raise OutputError(f"{path}: is not the name of a look; it would end with {', '.join(LOOK_SUFFIXES)}")
    if path.exists() and not replace:
        raise OutputError(f"{path} exists; another name would be right")
    stage = Usd.Stage.CreateInMemory()
    stage.GetRootLayer().documentation = f"Imported from {imported.file.name} (MaterialX, {SURFACE_NODE})."
    names: set[str] = set()
    for material in imported.materials:
        _Writer(stage, _unique_name(material.name, names), imported.file, path).write(material)
    if len(imported.materials) == 1:
        stage.SetDefaultPrim(*stage.GetPseudoRoot().GetChildren())
    with atomic_path(path) as temporary:
        if not stage.GetRootLayer().Export(str(temporary)):
            raise OutputError(f"{path}: USD cannot write it")


def _read_material(
    network: DocumentNetwork, material: mx.Node, layers: dict[str, dict[str, DocumentValue]]
) -> ImportedMaterial | None:
    """Return a surfacematerial as a Disney layer; None, with a loss added, where it has another surface shader.

    `layers` caches the inputs of layers by the path of the shader, which several materials may share.
    """
    port = material.getInput("surfaceshader")
    source = network.source_of(port) if port else None
    category = source.element.getCategory() if source and source.is_computed else ""
    network.mark_carried(material, "surfaceshader")
    if source and category == SURFACE_NODE:
        path = source.element.getNamePath()
        if path not in layers:
            layers[path] = _read_layer(network, source.element)
        return ImportedMaterial(material.getName(), layers[path])
    present = f"the surface shader <{category}>" if category else "no surface shader"
    network.add_loss(material, f"has {present}", f"only {SURFACE_NODE} is imported; {_JOB_HINT}")
    return None


def _read_layer(network: DocumentNetwork, shader: mx.Node) -> dict[str, DocumentValue]:
    """Return the inputs of a Disney layer for a `disney_principled` node, and add its losses."""
    definitions = library_inputs(SURFACE_NODE, f"ND_{SURFACE_NODE}")
    names = [port.getName() for port in shader.getInputs()]
    network.mark_carried(shader, *names)
    for name in names:
        if name not in definitions:
            network.add_value_loss(shader.getInput(name), f"unknown input; {nearest_hint(name, list(definitions))}")
    inputs: dict[str, DocumentValue] = {}
    for name, definition in definitions.items():
        parameter, port = _PARAMETERS.get(name), shader.getInput(name)
        if parameter is None:
            if port:
                network.add_value_loss(port, _LOSS_REASONS.get(name, "LookdevDisney has no such input"))
            continue
        value: DocumentValue | None = None
        if port and port.getType() != MATERIALX_TYPES[parameter.kind]:
            network.add_fault(port.getNamePath(), f"has type '{port.getType()}'", f"it must be {definition.getType()}")
        elif port:
            value = read_value(network, port, parameter)
            if value is None:
                network.add_value_loss(port, f"{definition.getValueString()} is taken")
        if value is None:
            default = parse_constant(definition.getValueString())
            value = None if default == parameter.default else default
        if value is not None:
            inputs[name] = value
    return inputs


def _unique_name(name: str, used_names: set[str]) -> str:
    """Return a prim name for a MaterialX name that is not among `used_names`, and add it to them."""
    valid = Tf.MakeValidIdentifier(name)
    choice = next(candidate for n in count(1) if (candidate := valid if n == 1 else f"{valid}_{n}") not in used_names)
    used_names.add(choice)
    return choice


class _Writer:
    """Writes one material as prims of a stage. `source` is the document, and `target` the USD file.

    `_written` maps an image, a primvar or the name of a UV set to its written node, which several inputs may share.
    """

    def __init__(self, stage: Usd.Stage, name: str, source: Path, target: Path) -> None:
        self._material = UsdShade.Material.Define(stage, f"/{name}")
        self._source, self._target = source, target
        self._names: set[str] = set()
        self._written: dict[ImageNode | Primvar | str, UsdShade.Shader] = {}

    def write(self, material: ImportedMaterial) -> None:
        """Write the layer of a material, and the nodes of its inputs."""
        customs = {"file": self._source.name, "material": material.name}
        self._material.GetPrim().SetCustomDataByKey("lookdev:materialx", customs)
        layer = self._define_node("Layer", "LookdevDisney")
        output = layer.CreateOutput("layer", _TYPES.Token)
        self._material.CreateOutput("lookdev:surface", _TYPES.Token).ConnectToSource(output)
        for name, value in material.inputs.items():
            kind = _PARAMETERS[name].kind
            layer_input = layer.CreateInput(name, _TYPES.Find(USD_TYPES[kind]))
            if isinstance(value, ImageChannel):
                _set_input(layer_input, self._write_image(value))
            else:
                _set_input(layer_input, self._write_primvar(value, kind) if isinstance(value, Primvar) else value)

    def _define_node(self, name: str, shader_id: str, **inputs: object) -> UsdShade.Shader:
        """Define a shader with `inputs`, each a constant or an output to connect, and return it.

        USD's registry of shaders states the types of the inputs.
        """
        path = self._material.GetPath().AppendChild(_unique_name(name, self._names))
        shader = UsdShade.Shader.Define(self._material.GetPrim().GetStage(), path)
        shader.CreateIdAttr(shader_id)
        definition = Sdr.Registry().GetShaderNodeByIdentifier(shader_id)
        for name, value in inputs.items():
            kind = definition.GetShaderInput(name).GetTypeAsSdfType().GetSdfType()
            _set_input(shader.CreateInput(name, kind), value)
        return shader

    def _write_image(self, sampled: ImageChannel) -> UsdShade.Output:
        """Return the output for a channel of an image, whose UsdUVTexture is written if missing."""
        image = sampled.image
        if image not in self._written:
            inputs = {"file": self._relative_asset(image.file), "sourceColorSpace": image.colorspace}
            inputs |= {"wrapS": image.wrap_s, "wrapT": image.wrap_t, "st": self._write_coordinates(image)}
            self._written[image] = self._define_node(image.name, "UsdUVTexture", **inputs)
        kind = _TYPES.Float3 if sampled.channel == "rgb" else _TYPES.Float
        return self._written[image].CreateOutput(sampled.channel, kind)

    def _write_coordinates(self, image: ImageNode) -> UsdShade.Output:
        """Write the nodes of an image's texture coordinates, the UV set and its transforms; return the last output."""
        if image.st not in self._written:
            self._written[image.st] = self._define_node(image.st, "UsdPrimvarReader_float2", varname=image.st)
        output = self._written[image.st].CreateOutput("result", _TYPES.Float2)
        for transform in image.transforms:
            changed = {name: value for name, value in vars(transform).items() if value != getattr(_IDENTITY, name)}
            placed = self._define_node(f"{image.name}_place", "UsdTransform2d", **{"in": output}, **changed)
            output = placed.CreateOutput("result", _TYPES.Float2)
        return output

    def _write_primvar(self, primvar: Primvar, kind: str) -> UsdShade.Output:
        """Return the output of the node that reads a primvar, written if missing; `kind` is the parameter's kind."""
        result = "float" if kind == "float" else "float3"
        if primvar not in self._written:
            inputs = {"varname": primvar.name, "fallback": primvar.fallback}
            self._written[primvar] = self._define_node(primvar.name, f"UsdPrimvarReader_{result}", **inputs)
        return self._written[primvar].CreateOutput("result", _TYPES.Find(result))

    def _relative_asset(self, file: str) -> Sdf.AssetPath:
        """Return the path of an image for the written file: a relative path becomes relative to that file."""
        is_absolute = PurePosixPath(file).is_absolute()
        return Sdf.AssetPath(file if is_absolute else relative_path(self._source.parent / file, self._target.parent))


def _set_input(node_input: UsdShade.Input, value: object) -> None:
    """Connect an input to `value` if that is an output, else set it to the constant."""
    if isinstance(value, UsdShade.Output):
        node_input.ConnectToSource(value)
    else:
        node_input.Set(value)
