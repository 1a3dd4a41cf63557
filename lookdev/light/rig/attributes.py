"""Readers of the attributes of a light prim, and the report that collects the faults and notes of a rig.

A value of a wrong type or range is a fault. All values are read at one time of the stage; an animated value adds a
note. An unknown name is a fault, because a picture does not show that a misspelt attribute has no effect.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TypeVar

from pxr import Ar, Gf, Sdf, Usd, UsdLux

from lookdev.errors import EnvironmentMapError, Fault, FaultsError, TextureError, close_hint, nearest_hint
from lookdev.space import Color
from lookdev.stage import quote
from lookdev.stage.colorspaces import colorspace_named, colorspace_of, to_linear_rec709
from lookdev.stage.packages import unpack

V = TypeVar("V")

SHAPING, SHADOW = "ShapingAPI", "ShadowAPI"

LOOKDEV_ATTRIBUTES: Mapping[str, str] = {
    "turns": "bool",
    "camera": "bool",
    "lightGroup": "token",
    "falloff:virtualDistance": "float",
    "falloff:exponent": "float",
    "falloff:start": "float",
    "falloff:end": "float",
    "local:radius": "float",
    "local:edge": "float",
}
"""The attributes of lights that this program adds to UsdLux's, in the namespace ``lookdev:``, and their types."""

_VECTORS = (Gf.Vec3f, Gf.Vec3d, Gf.Vec3h)  # the types of a colour's value


@cache
def schema_names(schema: str) -> tuple[str, ...]:
    """Return the names of the properties of an applied API schema, such as `SHAPING`."""
    return tuple(Usd.SchemaRegistry().FindAppliedAPIPrimDefinition(schema).GetPropertyNames())


@dataclass(eq=False)
class RigReport:
    """Faults and notes of the rig in `file`, in the order in which they occur.

    The keys of `notes` are the notes, so that each is there once.
    """

    file: str
    faults: list[Fault] = field(default_factory=list)
    notes: dict[str, None] = field(default_factory=dict)

    def fault(self, path: Sdf.Path | str, problem: str, hint: str = "") -> None:
        self.faults.append(Fault(self.file, str(path), problem, hint))

    def note(self, path: Sdf.Path | str, text: str) -> None:
        self.notes[f"{self.file}: {path}: {text}"] = None

    @contextmanager
    def collect(self, path: Sdf.Path | str) -> Iterator[None]:
        """In this context, turn errors of a light, of its image and of its profile into faults of `path`."""
        try:
            yield
        except FaultsError as error:
            for fault in error.faults:
                self.fault(path, f"{fault.file}: {fault.where + ': ' if fault.where else ''}{fault.what}", fault.hint)
        except (EnvironmentMapError, TextureError) as error:
            self.fault(path, str(error))


class LightPrim:
    """Reads the attributes of a light prim at a time code; faults and notes go to the report.

    The methods that read an attribute return a default if it has no value.
    """

    def __init__(self, prim: Usd.Prim, time: Usd.TimeCode, report: RigReport) -> None:
        self.prim = prim
        self.path = prim.GetPath()
        self._time = time
        self._report = report

    @property
    def is_dome(self) -> bool:
        """Whether the prim is a dome light: a ``DomeLight`` or a ``DomeLight_1``."""
        return bool(self.prim.IsA(UsdLux.DomeLight) or self.prim.IsA(UsdLux.DomeLight_1))

    def has(self, name: str) -> bool:
        """Return whether an attribute has a value, which may be the default of its schema."""
        attribute = self.prim.GetAttribute(name)
        return bool(attribute) and attribute.HasValue()

    def fault(self, name: str, problem: str, hint: str = "") -> None:
        """Add a fault of an attribute."""
        self._report.fault(self.path.AppendProperty(name), problem, hint)

    def note(self, name: str, text: str) -> None:
        """Add a note on an attribute, or on the light if the name is empty."""
        self._report.note(self.path.AppendProperty(name) if name else self.path, text)

    def number(self, name: str, *, least: float = -math.inf, above: float = -math.inf, default: float = 0.0) -> float:
        """Return a number, or `default` with a fault unless it is finite, at least `least` and above `above`."""
        value = self._value(name, (float, int), "float")
        if value is None:
            return default
        if math.isfinite(value) and value >= least and value > above:
            return float(value)
        right = f"above {above:g}" if above > -math.inf else f"of at least {least:g}" if least > -math.inf else ""
        self.fault(name, f"is {value:g}", f"a finite number{' ' * bool(right)}{right} would be right")
        return default

    def flag(self, name: str, default: bool = False) -> bool:
        """Return the value of a bool attribute."""
        value = self._value(name, (bool,), "bool")
        return default if value is None else bool(value)

    def text(self, name: str, default: str = "", allowed: Sequence[str] = ()) -> str:
        """Return the value of a token or string attribute; if `allowed` is not empty, it must be one of `allowed`."""
        value = self._value(name, (str,), "token")
        if value is None:
            return default
        if allowed and value not in allowed:
            self.fault(name, f"is {quote(value)}", nearest_hint(value, allowed))
            return default
        return str(value)

    def color(self, name: str) -> Color:
        """Return a colour in linear Rec.709, converted from the colour space of the attribute."""
        value = self._value(name, _VECTORS, "color3f")
        if value is None:
            return 1.0, 1.0, 1.0
        channels = [float(channel) for channel in value]
        if not all(math.isfinite(channel) and channel >= 0.0 for channel in channels):
            text = ", ".join(f"{channel:g}" for channel in channels)
            self.fault(name, f"is ({text})", "finite channels, none negative, would be right")
            return 1.0, 1.0, 1.0
        space = self.space(name)
        r, g, b = to_linear_rec709(channels, space or "raw").tolist()
        if min(r, g, b) < 0.0:
            self.note(name, f"lies outside of Rec.709 by {-min(r, g, b):.2g}, which is left out")
        return max(r, 0.0), max(g, 0.0), max(b, 0.0)

    def space(self, name: str) -> str:
        """Return the colour space of an attribute, as a name for `to_linear_rec709`; "" if none is stated."""
        stated = colorspace_of(self.prim.GetAttribute(name))
        if not stated:
            return ""
        canonical = colorspace_named(stated)
        if canonical is None:
            problem = f"is of the colour space {quote(stated)}, which is not known"
            self.fault(name, problem, "'lin_rec709' would be right")
        return canonical or ""

    def file(self, name: str) -> Path | None:
        """Return the file that an attribute names; None if it names none, and None with a fault if there is no file."""
        asset = self._value(name, (Sdf.AssetPath,), "asset")
        if asset is None or not asset.path:
            return None
        if not asset.resolvedPath:
            self.fault(name, f"there is no file {quote(asset.path)}", "paths are relative to the layer that names them")
            return None
        with self._report.collect(self.path.AppendProperty(name)):
            if Ar.IsPackageRelativePath(asset.resolvedPath):
                return unpack([asset.resolvedPath])
        return Path(asset.resolvedPath)

    def check_names(self, extra_names: Sequence[str]) -> None:
        """Add a fault for each attribute that the light's type lacks.

        `extra_names` are the names that the type has in the namespace ``lookdev:``.
        """
        defined = set(self.prim.GetPrimDefinition().GetPropertyNames())
        applied = {name: schema for schema in (SHAPING, SHADOW) for name in schema_names(schema)}
        inputs = [name.removeprefix("inputs:") for name in (*defined, *applied) if name.startswith("inputs:")]
        for attribute in self.prim.GetAuthoredAttributes():
            name = attribute.GetName()
            space, _, rest = name.partition(":")
            if name in defined:
                continue
            if space == "lookdev":
                if rest not in extra_names:
                    problem = f"a {self.prim.GetTypeName()} has no such attribute"
                    self.fault(name, problem, nearest_hint(rest, extra_names))
            elif name in applied:
                schema = applied[name]
                hint = f'prepend apiSchemas = ["{schema}"] would be right'
                self.fault(name, f"has no effect: {schema} is not applied to the light", hint)
            elif space == "inputs":
                input_groups = {input_name.partition(":")[0] for input_name in inputs}
                first, nested, _ = rest.partition(":")
                if first == "texture" and first not in input_groups:
                    problem = f"has no effect: a {self.prim.GetTypeName()} has no texture"
                    self.fault(name, problem, "a RectLight or a dome light has one")
                elif nested and not close_hint(first, sorted(input_groups)):
                    self.note(name, "is of another renderer, and has no effect")
                else:
                    problem = f"a {self.prim.GetTypeName()} has no such input"
                    self.fault(name, problem, nearest_hint(rest, sorted(inputs)))
            elif name in inputs and not self.prim.GetAttribute(f"inputs:{name}").HasAuthoredValue():
                self.fault(name, "is of UsdLux before 21.02, and has no effect", f"'inputs:{name}' would be right")

    def _value(self, name: str, types: tuple[type[V], ...], expected: str) -> V | None:
        """Return an attribute's value; None if it has none, and None with a fault if it is not one of `types`.

        `expected` is the USD name of the type, for the hint of the fault.
        """
        attribute = self.prim.GetAttribute(name)
        if not attribute:
            return None
        if attribute.HasAuthoredConnections():
            sources = attribute.GetConnections()
            self.fault(name, f"is connected to {', '.join(map(str, sources))}", "a value of its own would be right")
            return None
        if attribute.ValueMightBeTimeVarying():
            self.note(name, f"is animated, and taken at {time_label(self._time)}")
        value = attribute.Get(self._time)
        if value is None or (isinstance(value, types) and isinstance(value, bool) == (bool in types)):
            return value
        self.fault(name, f"has a value of type {type(value).__name__}", f"{expected} would be right")
        return None


def time_label(time: Usd.TimeCode) -> str:
    """Return the text of a time code for a note."""
    return "its first sample" if time.IsEarliestTime() else f"time {time.GetValue():g}"
