"""Reading a UsdShade network: connections, typed constants, and all faults."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pxr import Gf, Sdf, Sdr, Usd, UsdShade

from lookdev.errors import Fault, nearest_hint, shortened
from lookdev.material.look import Formula

TERMINAL = "outputs:lookdev:surface"
"""The output of a material that is connected to its layers."""

LAYER_INPUT = re.compile(r"layer([1-9][0-9]{0,8})(Mask|Enabled|Mode)?")
"""The inputs of a LookdevLayers but its base."""

_MOST_FAULTS = 1000
_MOST_UNKNOWN = 100  # inputs of a shader, reported one by one
_VECTORS = (Gf.Vec2f, Gf.Vec3f, Gf.Vec4f)


@dataclass(frozen=True)
class Source:
    """The shader output that computes the value of an input."""

    shader: UsdShade.Shader
    output: str

    @property
    def path(self) -> Sdf.Path:
        """Path of the shader prim."""
        return self.shader.GetPath()


class Network:
    """The network of a look. Reading continues after a fault: `faults` holds all of them in the end.

    Where it `opens_images`, the header of every image is read, and an unreadable one is a fault.
    """

    def __init__(self, file: Path, opens_images: bool = True) -> None:
        self.file = file
        self.opens_images = opens_images
        # Expressions by node and the kind that is wanted, and by identity how many of them are in a row.
        self.formulas: dict[tuple[Sdf.Path, str], Formula | None] = {}
        self.depths: dict[int, int] = {}
        self._faults: list[Fault] = []

    @property
    def faults(self) -> tuple[Fault, ...]:
        """Every fault so far, in order; those of a node that several inputs share only once."""
        unique = list(dict.fromkeys(self._faults))
        if more := len(unique[_MOST_FAULTS:]):
            unique[_MOST_FAULTS:] = [Fault(str(self.file), "", f"{more} more faults", "mend those above first")]
        return tuple(unique)

    def fault(self, where: object, what: str, hint: str = "") -> None:
        """Note a fault. `where` is an attribute, a prim by its schema, or a path."""
        place = where.GetPath() if isinstance(where, Usd.Object | Usd.SchemaBase) else where
        self._faults.append(Fault(str(self.file), shortened(str(place)), shortened(what), hint))

    def note(self, fault: Fault) -> None:
        """Note a fault of another file."""
        self._faults.append(fault)

    def surface(self, material: UsdShade.Material) -> Source | None:
        """Return the stack or the single layer of a material; None where its terminal is not connected to a shader."""
        attribute = material.GetPrim().GetAttribute(TERMINAL)
        source = self.follow(attribute) if attribute else None
        return source if isinstance(source, Source) else None

    def follow(self, attribute: Usd.Attribute) -> Usd.Attribute | Source | None:
        """Return the attribute that holds the value of an input, or the shader output that computes it.

        Connections are followed through interface inputs and node graphs; None, and a fault, where one is broken.
        """
        seen: set[Sdf.Path] = set()
        while paths := attribute.GetConnections():
            path, target = attribute.GetPath(), paths[0]
            prim = attribute.GetStage().GetPrimAtPath(target.GetPrimPath())
            name, kind = UsdShade.Utils.GetBaseNameAndType(target.name)
            if len(paths) > 1:
                self.fault(path, f"has {len(paths)} connections", "an input takes one")
                return None
            if path in seen:
                self.fault(path, "its connections run in a cycle")
                return None
            if prim and prim.IsA(UsdShade.Shader) and kind == UsdShade.AttributeType.Output:
                return Source(UsdShade.Shader(prim), name)
            attribute = prim.GetAttribute(target.name) if prim and not prim.IsA(UsdShade.Shader) else None
            if not attribute:
                self.fault(path, f"is connected to <{target}>, which is no output of a shader and no interface input")
                return None
            seen.add(path)
        return attribute

    def has_type(self, place: Usd.Attribute, holder: Usd.Attribute, expected: Sdf.ValueTypeName) -> bool:
        """Return whether `holder`, whose value goes into `place`, has the expected type, whatever its role."""
        actual = holder.GetTypeName()
        texts = (Sdf.ValueTypeNames.String, Sdf.ValueTypeNames.Token)  # varname has been either
        if actual.type == expected.type or (expected == Sdf.ValueTypeNames.String and actual in texts):
            return True
        elsewhere = "" if holder == place else f" at <{holder.GetPath()}>"
        self.fault(place, f"has type {actual}{elsewhere}", f"it must be {expected}")
        return False

    def value(self, place: Usd.Attribute, holder: Usd.Attribute, expected: Sdf.ValueTypeName) -> Any:
        """Return the constant of `holder` for `place`; None where unset, or wrong and noted."""
        if not self.has_type(place, holder, expected):
            return None
        if holder.GetNumTimeSamples():
            self.fault(place, "is animated", "a look is not animated; author one default value")
            return None
        value = holder.Get()
        if value is not None and not isinstance(value, type(expected.defaultValue)):  # as damaged binary files have it
            self.fault(place, f"holds a value of type {type(value).__name__}", f"it must be {expected}")
            return None
        numbers = (value,) if isinstance(value, float) else tuple(value) if isinstance(value, _VECTORS) else ()
        if not all(map(math.isfinite, numbers)):
            self.fault(place, f"{value} is not finite")
            return None
        return value

    def constant(self, attribute: Usd.Attribute, expected: Sdf.ValueTypeName) -> Any:
        """Return the value of an input that must be constant; None where unset, or wrong and noted."""
        if not self.has_type(attribute, attribute, expected):
            return None
        holder = self.follow(attribute)
        if isinstance(holder, Source):
            self.fault(attribute, f"is computed by <{holder.path}>", "it must be a constant")
            return None
        return None if holder is None else self.value(attribute, holder, expected)

    def node_value(self, shader: UsdShade.Shader, name: str) -> Any:
        """Return a constant input of one of USD's nodes, by USD's definition of it; None where wrong and noted."""
        definition = _definition(shader).GetShaderInput(name)
        attribute = shader.GetPrim().GetAttribute(f"inputs:{name}")
        noted = len(self._faults)
        value = self.constant(attribute, definition.GetTypeAsSdfType().GetSdfType()) if attribute else None
        if value is None:
            return definition.GetDefaultValueAsSdfType() if len(self._faults) == noted else None
        options = [option for option, _ in definition.GetOptions()]
        if options and value not in options:
            self.fault(attribute, f"unknown value '{value}'", nearest_hint(value, options))
            return None
        return value

    def check_node(self, place: object, source: Source, outputs: Sequence[str] = ("result",)) -> None:
        """Note inputs that one of USD's nodes does not have, and an output that `place` cannot use."""
        self.check_inputs(source.shader, _definition(source.shader).GetShaderInputNames())
        if source.output not in outputs:
            what = f"cannot use <{source.path}.outputs:{source.output}>"
            self.fault(place, what, f"use outputs:{' or '.join(outputs)}")

    def check_inputs(self, shader: UsdShade.Shader, known: Sequence[str]) -> None:
        """Note every input of a shader that is not among `known`."""
        unknown = [given for given in shader.GetInputs() if given.GetBaseName() not in known]
        for given in unknown[:_MOST_UNKNOWN]:
            self.fault(given.GetAttr(), "unknown input", nearest_hint(given.GetBaseName(), known))
        if more := len(unknown[_MOST_UNKNOWN:]):
            self.fault(shader.GetPath(), f"{more} more unknown inputs", f"known: {', '.join(known)}")


def shader_id(shader: UsdShade.Shader) -> str:
    """Return a shader's info:id; '' where it has none."""
    return shader.GetShaderId() or ""


def is_set(attribute: Usd.Attribute) -> bool:
    """Return whether an input has a connection or a value."""
    return bool(attribute.HasAuthoredConnections() or attribute.HasAuthoredValue())


def authored_properties(prim: Usd.Prim) -> int:
    """Count the properties of a prim in its layers, each layer's: composing their names would take long."""
    return sum(len(spec.properties) for spec in prim.GetPrimStack())


def _definition(shader: UsdShade.Shader) -> Any:
    return Sdr.Registry().GetShaderNodeByIdentifier(shader_id(shader))
