"""MaterialX documents as Disney layers: inputs are carried over by name, and all that are not is listed.

The node `disney_principled` has the parameters of Burley's BRDF. Its node graph in the MaterialX library approximates
it by stock lobes; here the parameters have the meaning of Burley's paper. docs/materialx.md has the differences.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import count
from pathlib import Path, PurePosixPath
from typing import Any

import MaterialX as mx
from pxr import Sdf, Sdr, Tf, Usd, UsdShade

from lookdev.brdf.disney import DISNEY
from lookdev.cache import atomic_path
from lookdev.errors import Fault, OutputError, nearest_hint
from lookdev.material.definitions import USD_TYPES
from lookdev.material.library import SUFFIXES
from lookdev.material.library.nodes import relative_path
from lookdev.material.look import Primvar
from lookdev.material.materialx.inputs import TYPES, Image, Sampled, Transform2d, Value, parse_constant, read_value
from lookdev.material.materialx.network import Network

NODE = "disney_principled"
"""The one surface shader that is imported."""

_ELSEWHERE = "the document itself, as 'material' of a look in a job, is read whatever its model"
_PARAMETERS = DISNEY.parameters
_WHY = {
    "specTrans": "a LookdevDisney layer lets no light through",
    "ior": "it bends the light of specTrans; what is reflected at normal incidence is specular's",
    "subsurfaceDistance": "subsurface is a shape of the diffuse lobe: light leaves where it entered",
}
_IDENTITY = Transform2d()


@dataclass(frozen=True)
class ImportedMaterial:
    """A surfacematerial as one Disney layer; `inputs` omits the layer's own defaults."""

    name: str
    inputs: dict[str, Value]


@dataclass(frozen=True)
class Imported:
    """The materials of a document, and each input, node and connection that is not carried over."""

    file: Path
    materials: tuple[ImportedMaterial, ...]
    unmapped: tuple[Fault, ...]


def import_materialx(file: Path) -> Imported:
    """Read every surfacematerial of a MaterialX document whose surface shader is a `disney_principled`.

    Raises
    ------
    LookError
        The file is missing, is not MaterialX, or has faults: connections that are missing or in a cycle, wrong types,
        values that are not numbers; or none of its materials has such a shader.
    """
    network = Network(file)
    found = network.document.getMaterialNodes()
    network.connect(found)
    network.check()
    layers: dict[str, dict[str, Value]] = {}
    materials = tuple(each for material in found if (each := _read_material(network, material, layers)))
    if not found:
        network.fault("", "holds no surfacematerial", f"one whose surface shader is a {NODE} is right")
    elif not materials:
        for lost in network.unmapped:
            network.fault(lost.where, lost.what, lost.hint)
    network.check()
    network.lose_the_rest()
    return Imported(file, materials, network.unmapped)


def write_usda(imported: Imported, path: Path, *, replace: bool = False) -> None:
    """Write imported materials as looks, each a layer LookdevDisney; a sole one is the default prim.

    Image paths relative to the document become relative to `path`. OutputError where that exists, unless `replace`, or
    is no path of a USD file.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise OutputError(f"{path}: is no name of a look; it would end with {', '.join(SUFFIXES)}")
    if path.exists() and not replace:
        raise OutputError(f"{path} exists; another name would be right")
    stage = Usd.Stage.CreateInMemory()
    stage.GetRootLayer().documentation = f"Imported from {imported.file.name} (MaterialX, {NODE})."
    names: set[str] = set()
    for material in imported.materials:
        _Writer(stage, _unique(material.name, names), imported.file, path).write(material)
    if len(imported.materials) == 1:
        stage.SetDefaultPrim(*stage.GetPseudoRoot().GetChildren())
    with atomic_path(path) as temporary:
        if not stage.GetRootLayer().Export(str(temporary)):
            raise OutputError(f"{path}: USD cannot write it")


@cache
def _definition() -> dict[str, tuple[str, str]]:
    """Return type and default, as text, of every input of the node in the MaterialX library."""
    library = mx.createDocument()
    mx.readFromXmlFile(library, mx.getDefaultDataSearchPath().find(f"libraries/bxdf/{NODE}.mtlx"))
    inputs = library.getNodeDef(f"ND_{NODE}").getInputs()
    return {each.getName(): (each.getType(), each.getValueString()) for each in inputs}


def _read_material(network: Network, material: Any, layers: dict[str, dict[str, Value]]) -> ImportedMaterial | None:
    """Read a material; None, and a note, where it has another surface shader. `layers` are those read so far."""
    port = material.getInput("surfaceshader")
    source = network.source(port) if port else None
    category = source.element.getCategory() if source and source.computed else ""
    network.carry(material, "surfaceshader")
    if source and category == NODE:
        path = source.element.getNamePath()
        if path not in layers:
            layers[path] = _read_layer(network, source.element)
        return ImportedMaterial(material.getName(), layers[path])
    found = f"the surface shader <{category}>" if category else "no surface shader"
    network.lose(material, f"has {found}", f"only {NODE} is imported; {_ELSEWHERE}")
    return None


def _read_layer(network: Network, shader: Any) -> dict[str, Value]:
    definition = _definition()
    given = [port.getName() for port in shader.getInputs()]
    network.carry(shader, *given)
    for name in given:
        if name not in definition:
            network.lose_value(shader.getInput(name), f"unknown input; {nearest_hint(name, list(definition))}")
    inputs: dict[str, Value] = {}
    for name, (kind, text) in definition.items():
        parameter, port = _PARAMETERS.get(name), shader.getInput(name)
        if parameter is None:
            if port:
                network.lose_value(port, _WHY.get(name, "LookdevDisney has no such input"))
            continue
        value: Value | None = None
        if port and port.getType() != TYPES[parameter.kind]:
            network.fault(port.getNamePath(), f"has type '{port.getType()}'", f"it must be {kind}")
        elif port:
            value = read_value(network, port, parameter)
            if value is None:
                network.lose_value(port, f"{text} is taken")
        if value is None:
            default = parse_constant(text)
            value = None if default == parameter.default else default
        if value is not None:
            inputs[name] = value
    return inputs


def _unique(name: str, taken: set[str]) -> str:
    """Return an unused prim name for a MaterialX name."""
    valid = Tf.MakeValidIdentifier(name)
    choice = next(each for n in count(1) if (each := valid if n == 1 else f"{valid}_{n}") not in taken)
    taken.add(choice)
    return choice


class _Writer:
    """Writes one material as prims of a stage."""

    def __init__(self, stage: Usd.Stage, name: str, source: Path, target: Path) -> None:
        self._material = UsdShade.Material.Define(stage, f"/{name}")
        self._source, self._target = source, target
        self._names: set[str] = set()
        self._written: dict[Image | Primvar | str, UsdShade.Shader] = {}

    def write(self, material: ImportedMaterial) -> None:
        customs = {"file": self._source.name, "material": material.name}
        self._material.GetPrim().SetCustomDataByKey("lookdev:materialx", customs)
        layer = self._shader("Layer", "LookdevDisney")
        output = layer.CreateOutput("layer", Sdf.ValueTypeNames.Token)
        self._material.CreateOutput("lookdev:surface", Sdf.ValueTypeNames.Token).ConnectToSource(output)
        for name, value in material.inputs.items():
            kind = _PARAMETERS[name].kind
            given = layer.CreateInput(name, Sdf.ValueTypeNames.Find(USD_TYPES[kind]))
            if isinstance(value, Sampled):
                given.ConnectToSource(self._image(value))
            elif isinstance(value, Primvar):
                given.ConnectToSource(self._primvar(value, kind))
            else:
                given.Set(value)

    def _shader(self, name: str, shader_id: str, **inputs: Any) -> UsdShade.Shader:
        """Define a node, whose inputs have the types of USD's own definition."""
        path = self._material.GetPath().AppendChild(_unique(name, self._names))
        shader = UsdShade.Shader.Define(self._material.GetPrim().GetStage(), path)
        shader.CreateIdAttr(shader_id)
        definition = Sdr.Registry().GetShaderNodeByIdentifier(shader_id)
        for name, value in inputs.items():
            kind = definition.GetShaderInput(name).GetTypeAsSdfType().GetSdfType()
            given = shader.CreateInput(name, kind)
            if isinstance(value, UsdShade.Output):
                given.ConnectToSource(value)
            else:
                given.Set(value)
        return shader

    def _image(self, sampled: Sampled) -> UsdShade.Output:
        image = sampled.image
        if image not in self._written:
            inputs = {"file": self._relative(image.file), "sourceColorSpace": image.colorspace}
            inputs |= {"wrapS": image.wrap_s, "wrapT": image.wrap_t, "st": self._coordinates(image)}
            self._written[image] = self._shader(image.name, "UsdUVTexture", **inputs)
        kind = Sdf.ValueTypeNames.Float3 if sampled.channel == "rgb" else Sdf.ValueTypeNames.Float
        return self._written[image].CreateOutput(sampled.channel, kind)

    def _coordinates(self, image: Image) -> UsdShade.Output:
        if image.st not in self._written:
            self._written[image.st] = self._shader(image.st, "UsdPrimvarReader_float2", varname=image.st)
        output = self._written[image.st].CreateOutput("result", Sdf.ValueTypeNames.Float2)
        for transform in image.transforms:
            changed = {name: value for name, value in vars(transform).items() if value != getattr(_IDENTITY, name)}
            placed = self._shader(f"{image.name}_place", "UsdTransform2d", **{"in": output}, **changed)
            output = placed.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        return output

    def _primvar(self, primvar: Primvar, kind: str) -> UsdShade.Output:
        if primvar not in self._written:
            reader = "UsdPrimvarReader_float" if kind == "float" else "UsdPrimvarReader_float3"
            self._written[primvar] = self._shader(primvar.name, reader, varname=primvar.name, fallback=primvar.fallback)
        result = Sdf.ValueTypeNames.Float if kind == "float" else Sdf.ValueTypeNames.Float3
        return self._written[primvar].CreateOutput("result", result)

    def _relative(self, file: str) -> Sdf.AssetPath:
        """Return the path of an image, relative to the file that is written where it is relative to the document."""
        if PurePosixPath(file).is_absolute():
            return Sdf.AssetPath(file)
        return Sdf.AssetPath(relative_path(self._source.parent / file, self._target.parent))
