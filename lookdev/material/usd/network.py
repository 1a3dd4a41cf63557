"""Reads networks of UsdShade shaders: follows connections, checks types of constants, finds files, collects faults.

All readers of materials use a `Network`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TypeVar

from pxr import Ar, Gf, Sdf, Sdr, Usd, UsdShade

from lookdev.errors import Fault, TextureError, nearest_hint, shorten
from lookdev.material import Formula
from lookdev.material.textures import UDIM
from lookdev.stage.packages import unpack

V = TypeVar("V")

TERMINAL = "outputs:lookdev:surface"
"""The output of a material that is connected to its stack of layers, or to its only layer."""

LAYER_INPUT = re.compile(r"layer([1-9][0-9]{0,8})(Mask|Enabled|Mode)?")
"""Matches the inputs of a LookdevLayers shader except ``base``. Group 1 is the layer's number, group 2 the suffix."""

_MAX_FAULTS = 1000  # the most faults that are listed one by one
_MAX_UNKNOWN_INPUTS = 100  # the most unknown inputs of one shader that are reported one by one
_VECTORS = (Gf.Vec2f, Gf.Vec3f, Gf.Vec4f)


@dataclass(frozen=True)
class OutputSource:
    """A shader, and the name of its output. This output computes the value of an input."""

    shader: UsdShade.Shader
    output: str

    @property
    def path(self) -> Sdf.Path:
        """The path of the shader's prim."""
        return self.shader.GetPath()


class Network:
    """The shader network of a material in `file`. Reading continues after a fault, and `faults` collects all of them.

    With `opens_images`, readers read the header of every image, and an unreadable image is a fault.
    """

    def __init__(self, file: Path, opens_images: bool = True) -> None:
        self.file = file
        self.opens_images = opens_images
        # The expressions that have been read, by the path of the node and the kind of the parameter: several inputs may
        # share an expression. `depths` has the depth of nesting of an expression, by its id().
        self.formulas: dict[tuple[Sdf.Path, str], Formula | None] = {}
        self.depths: dict[int, int] = {}
        self._faults: list[Fault] = []

    @property
    def faults(self) -> tuple[Fault, ...]:
        """All faults so far, in the order in which they were found, without duplicates."""
        unique = list(dict.fromkeys(self._faults))
        if more := len(unique[_MAX_FAULTS:]):
            unique[_MAX_FAULTS:] = [Fault(str(self.file), "", f"{more} more faults", "mend those above first")]
        return tuple(unique)

    def add_fault(self, where: object, message: str, hint: str = "") -> None:
        """Add a fault. `where` is an attribute, a prim or schema object, or a path."""
        path = where.GetPath() if isinstance(where, Usd.Object | Usd.SchemaBase) else where
        self._faults.append(Fault(str(self.file), shorten(str(path)), shorten(message), hint))

    def add_unset_fault(self, where: str) -> None:
        """Add the fault of an input without a value."""
        self.add_fault(where, "is neither set nor connected", "give it a value, or connect it")

    def add_external_fault(self, fault: Fault) -> None:
        """Add a fault of another file."""
        self._faults.append(fault)

    def surface_source(self, material: UsdShade.Material) -> OutputSource | None:
        """Return the output of the stack, or of the only layer, of a material; None where none is connected."""
        attribute = material.GetPrim().GetAttribute(TERMINAL)
        source = self.follow(attribute) if attribute else None
        return source if isinstance(source, OutputSource) else None

    def follow(self, attribute: Usd.Attribute) -> Usd.Attribute | OutputSource | None:
        """Return the attribute that holds the value of an input, or the shader output that computes the value.

        The search follows connections through interface inputs and node graphs. It returns None, with a fault added,
        where a connection is broken.
        """
        seen: set[Sdf.Path] = set()
        while paths := attribute.GetConnections():
            path, target = attribute.GetPath(), paths[0]
            prim = attribute.GetStage().GetPrimAtPath(target.GetPrimPath())
            name, kind = UsdShade.Utils.GetBaseNameAndType(target.name)
            if len(paths) > 1:
                self.add_fault(path, f"has {len(paths)} connections", "an input takes one")
                return None
            if path in seen:
                self.add_fault(path, "its connections run in a cycle")
                return None
            if prim and prim.IsA(UsdShade.Shader) and kind == UsdShade.AttributeType.Output:
                return OutputSource(UsdShade.Shader(prim), name)
            attribute = prim.GetAttribute(target.name) if prim and not prim.IsA(UsdShade.Shader) else None
            if not attribute:
                message = "which is neither an output of a shader nor an interface input"
                self.add_fault(path, f"is connected to <{target}>, {message}")
                return None
            seen.add(path)
        return attribute

    def check_type(self, attribute: Usd.Attribute, holder: Usd.Attribute, expected: Sdf.ValueTypeName) -> bool:
        """Return whether `holder`, which has the value of `attribute`, has the type `expected`; if not, add a fault."""
        actual = holder.GetTypeName()
        texts = (Sdf.ValueTypeNames.String, Sdf.ValueTypeNames.Token)  # varname has had both types in versions of USD
        if actual.type == expected.type or (expected == Sdf.ValueTypeNames.String and actual in texts):
            return True
        elsewhere = "" if holder == attribute else f" at <{holder.GetPath()}>"
        self.add_fault(attribute, f"has type {actual}{elsewhere}", f"it must be {expected}")
        return False

    def read_value(self, attribute: Usd.Attribute, holder: Usd.Attribute, expected: Sdf.ValueTypeName) -> object:
        """Return the constant that `holder`, the result of `follow`, has for `attribute`.

        Returns None where the value is unset or, with a fault added, of another type, animated or not finite.
        """
        if not self.check_type(attribute, holder, expected):
            return None
        if holder.GetNumTimeSamples():
            self.add_fault(attribute, "is animated", "a look is not animated; author one default value")
            return None
        value = holder.Get()
        if value is not None and not isinstance(value, type(expected.defaultValue)):  # as damaged binary files have it
            self.add_fault(attribute, f"holds a value of type {type(value).__name__}", f"it must be {expected}")
            return None
        numbers = (value,) if isinstance(value, float) else tuple(value) if isinstance(value, _VECTORS) else ()
        if not all(map(math.isfinite, numbers)):
            self.add_fault(attribute, f"{value} is not finite")
            return None
        return value

    def read_constant(self, attribute: Usd.Attribute | None, expected: Sdf.ValueTypeName) -> object:
        """Return the value of an input that must be constant; None where it is unset or, with a fault added, wrong."""
        if not attribute or not self.check_type(attribute, attribute, expected):
            return None
        holder = self.follow(attribute)
        if isinstance(holder, OutputSource):
            self.add_fault(attribute, f"is computed by <{holder.path}>", "it must be a constant")
            return None
        return None if holder is None else self.read_value(attribute, holder, expected)

    def read_float(self, attribute: Usd.Attribute | None, default: float) -> float:
        """Return the value of an input that must be a constant float, or the default where it is unset or wrong."""
        value = self.read_constant(attribute, Sdf.ValueTypeNames.Float)
        return value if isinstance(value, float) else default

    def read_choice(self, attribute: Usd.Attribute | None, choices: Sequence[V]) -> V:
        """Return the value of an input that must be one of `choices`; the first of them where it is unset or wrong."""
        token = self.read_constant(attribute, Sdf.ValueTypeNames.Token)
        if token is not None and token not in choices:
            self.add_fault(attribute, f"unknown value '{token}'", nearest_hint(str(token), [*map(str, choices)]))
        return next((choice for choice in choices if choice == token), choices[0])

    def read_node_value(self, shader: UsdShade.Shader, name: str, kind: type[V]) -> V | None:
        """Return the constant input `name`, or its default, of a node that USD defines.

        `kind` is the Python type of the value. Returns None, with a fault added, where the value is wrong.
        """
        definition = _sdr_node(shader).GetShaderInput(name)
        attribute = shader.GetPrim().GetAttribute(f"inputs:{name}")
        fault_count = len(self._faults)
        value = self.read_constant(attribute, definition.GetTypeAsSdfType().GetSdfType())
        if value is None:
            return definition.GetDefaultValueAsSdfType() if len(self._faults) == fault_count else None
        options = [option for option, _ in definition.GetOptions()]
        if options and value not in options:
            self.add_fault(attribute, f"unknown value '{value}'", nearest_hint(str(value), options))
            return None
        return value if isinstance(value, kind) else None

    def check_node(self, attribute: object, source: OutputSource, outputs: Sequence[str] = ("result",)) -> None:
        """Add faults of a node that USD defines: its unknown inputs, and an output that `attribute` cannot use.

        `outputs` are the names of the outputs that `attribute` can use.
        """
        self.check_inputs(source.shader, _sdr_node(source.shader).GetShaderInputNames())
        if source.output not in outputs:
            message = f"cannot use <{source.path}.outputs:{source.output}>"
            self.add_fault(attribute, message, f"use outputs:{' or '.join(outputs)}")

    def check_inputs(self, shader: UsdShade.Shader, valid_names: Sequence[str]) -> None:
        """Add a fault for every input of a shader that is not among `valid_names`."""
        unknown = [shader_input for shader_input in shader.GetInputs() if shader_input.GetBaseName() not in valid_names]
        for shader_input in unknown[:_MAX_UNKNOWN_INPUTS]:
            hint = nearest_hint(shader_input.GetBaseName(), valid_names)
            self.add_fault(shader_input.GetAttr(), "unknown input", hint)
        if more := len(unknown[_MAX_UNKNOWN_INPUTS:]):
            self.add_fault(shader.GetPath(), f"{more} more unknown inputs", f"known: {', '.join(valid_names)}")


def shader_id(shader: UsdShade.Shader) -> str:
    """Return the info:id of a shader, or '' where it has none."""
    return shader.GetShaderId() or ""


def is_authored(attribute: Usd.Attribute) -> bool:
    """Return whether an input has a connection or a value."""
    return bool(attribute.HasAuthoredConnections() or attribute.HasAuthoredValue())


def authored_property_count(prim: Usd.Prim) -> int:
    """Return the number of property specs of a prim in all USD layers, without composing them, which would be slow."""
    return sum(len(spec.properties) for spec in prim.GetPrimStack())


def _sdr_node(shader: UsdShade.Shader) -> Sdr.ShaderNode:
    """Return the definition of a shader's node from USD's registry of shaders."""
    return Sdr.Registry().GetShaderNodeByIdentifier(shader_id(shader))


def image_path(network: Network, attribute: Usd.Attribute, asset: Sdf.AssetPath) -> Path:
    """Return the image file that `asset`, the value of an input, names, without opening it.

    For a set of tiles, this is the path with ``<UDIM>``.

    Raises
    ------
    TextureError
        There is no such file.
    """
    if UDIM in asset.path:
        layer = _value_layer(network, attribute)
        tiles = [path for path, _ in UsdShade.UdimUtils.ResolveUdimTilePaths(asset.path, layer)]
        if not tiles:
            raise TextureError(f"no tile of this set: {asset.path}")
        if Ar.IsPackageRelativePath(tiles[0]):
            return unpack(tiles).with_name(PurePosixPath(asset.path.rstrip("]")).name)
        return Path(UsdShade.UdimUtils.ResolveUdimPath(asset.path, layer))
    return asset_file(asset, "image file")


def asset_file(asset: Sdf.AssetPath, kind: str = "file") -> Path:
    """Return the file that a value of USD names, which may be inside an archive; TextureError where there is none.

    `kind` is the word for the file in messages.
    """
    if not asset.path:
        raise TextureError(f"names no {kind}")
    if not asset.resolvedPath:
        raise TextureError(f"no such {kind}: {asset.path}")
    if Ar.IsPackageRelativePath(asset.resolvedPath):
        return unpack([asset.resolvedPath])
    return Path(asset.resolvedPath)


def _value_layer(network: Network, attribute: Usd.Attribute) -> Sdf.Layer | None:
    """Return the USD layer that states an attribute's value, to which relative paths in the value are relative."""
    holder = network.follow(attribute)
    stack = holder.GetPropertyStack() if isinstance(holder, Usd.Attribute) else []
    return next((spec.layer for spec in stack if spec.default is not None), None)
