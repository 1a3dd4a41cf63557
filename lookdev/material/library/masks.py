"""Parses masks as users type them on the command line or in the Designer, and writes them as USD nodes.

A mask is a number, an image, a primvar, or an expression whose inputs are such sources. The same texts set parameters
of layers that are numbers or colours.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias

from pxr import Sdf, Usd, UsdShade

from lookdev.errors import LookError, nearest_hint
from lookdev.material import VIEW
from lookdev.material.expression import Expression, ExpressionError, ExpressionKind, parse
from lookdev.material.library.nodes import clear_input, free_path, relative_asset

IMAGE_SUFFIXES = (".bmp", ".dpx", ".exr", ".hdr", ".jpeg", ".jpg", ".png", ".tga", ".tif", ".tiff", ".tx", ".webp")
"""The suffixes by which the text of a mask is recognised as an image file."""

_IMAGE = re.compile(
    rf"(?P<file>.+({'|'.join(re.escape(suffix) for suffix in IMAGE_SUFFIXES)}))(:(?P<channel>\w*))?", re.I
)
_TYPES = Sdf.ValueTypeNames
_FORMS = f"a number from 0 to 1, an image ({' '.join(IMAGE_SUFFIXES)}), primvar:NAME, or an expression"


@dataclass(frozen=True)
class MaskImage:
    """An image file as a source.

    `file` is an absolute path. `channel` is one of ``"r" "g" "b" "a"``, or ``"rgb"`` for a colour.
    """

    file: Path
    channel: str = "r"


@dataclass(frozen=True)
class PrimvarName:
    """A primvar of the geometry as a source; 0 where the mesh has none.

    The primvar is a colour if the input that reads it is a colour, else a float.
    """

    name: str


@dataclass(frozen=True)
class UvName:
    """The coordinates of a UV set as a source of an expression: a colour (s, t, 0)."""

    name: str


MaskInput: TypeAlias = float | MaskImage | PrimvarName | UvName
"""A source that is not an expression. A float is a constant."""


@dataclass(frozen=True)
class MaskExpression:
    """An expression as a source, and the sources of its inputs by name."""

    expression: Expression
    inputs: Mapping[str, MaskInput] = field(default_factory=dict)


MaskSource: TypeAlias = MaskInput | MaskExpression
"""The source of a mask, or of a parameter that is a number or a colour."""


def parse_mask(
    text: str, inputs: Iterable[str] = (), folder: Path = Path(), name: str = "mask", kind: ExpressionKind = "float"
) -> MaskSource:
    """Parse the source of a mask, or of a parameter that is a float or a colour.

    Parameters
    ----------
    text
        ``"0.5"``, ``"dirt.png"`` or ``"dirt.png:g"``, ``"primvar:wear"``, or an expression.
    inputs
        Texts NAME=SOURCE for inputs of an expression: ``"dirt=dirt.png:g"``, ``"tint=wood.png:rgb"`` for a colour,
        ``"p=uv:st"`` for texture coordinates.
    folder
        The folder to which paths of images are relative.
    name
        ``"mask"``, or the name of the parameter.
    kind
        Whether the parameter is a float or a colour. For a colour, an image is read with the channels ``rgb``.

    Raises
    ------
    LookError
        `text` has none of these forms, or one of `inputs` is not in the expression.
    """
    source = _parse_source(text, name, ("r", "g", "b", "a") if kind == "float" else ("rgb",), folder)
    if source is not None:
        if extra := list(inputs):
            raise LookError.at("--input", extra[0], "only an expression has inputs")
        return source
    try:
        expression = parse(text)
    except ExpressionError as error:
        raise LookError.at(name, "", f"is not {_FORMS}: {error}") from error
    return MaskExpression(expression, dict(_parse_inputs(inputs, expression, folder)))


def _parse_inputs(inputs: Iterable[str], expression: Expression, folder: Path) -> Iterator[tuple[str, MaskInput]]:
    """Yield the name and the source of each text NAME=SOURCE; LookError for a wrong text or an unknown name."""
    for text in inputs:
        name, _, value = text.partition("=")
        if name not in expression.names:
            hint = nearest_hint(name, expression.names) if expression.names else "it has none"
            raise LookError.at("--input", text, f"'{name}' is not a name in the expression", hint)
        source = _parse_source(value, f"--input {name}", ("r", "g", "b", "a", "rgb"), folder)
        if source is None:
            hint = "give NAME=VALUE, NAME=IMAGE[:CHANNEL], NAME=primvar:PRIMVAR or NAME=uv:UVSET"
            raise LookError.at("--input", text, f"'{value}' is not a number, an image, a primvar or a UV set", hint)
        yield name, source


def _parse_source(text: str, subject: str, channels: tuple[str, ...], folder: Path) -> MaskInput | None:
    """Parse a source that is not an expression; return None where the text is something else.

    `subject` is ``"mask"``, a parameter's name or ``"--input NAME"``, for messages. Only ``"--input NAME"`` can be a UV
    set. `channels` are those allowed for an image, the default first. Raises LookError for a faulty source.
    """
    if re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", text, re.I):
        value = float(text)
        if subject == "mask" and not 0.0 <= value <= 1.0:
            raise LookError.at(subject, "", f"{text} is out of range", "it must be within [0, 1]")
        return value
    kind, _, name = text.partition(":")
    if kind == "primvar" or (kind == "uv" and subject.startswith("--input")):
        if not Sdf.Path.IsValidNamespacedIdentifier(name):
            raise LookError.at(subject, "", f"'{name}' cannot be the name of a primvar", "for instance primvar:wear")
        return PrimvarName(name) if kind == "primvar" else UvName(name)
    if match := _IMAGE.fullmatch(text):
        channel = match["channel"] if match["channel"] is not None else channels[0]
        if channel not in channels:
            raise LookError.at(subject, "", f"unknown channel '{channel}'", nearest_hint(channel, channels))
        file = (folder / match["file"]).absolute()
        if "<UDIM>" not in file.name and not file.is_file():
            raise LookError.at(subject, "", f"no such image file: {match['file']}", f"from {folder.absolute()}")
        return MaskImage(file, channel)
    return None


@dataclass(frozen=True)
class InputState:
    """What a file states for an input of a node: its type in USD, and its connections or else its value."""

    type_name: Sdf.ValueTypeName
    connections: tuple[Sdf.Path, ...]
    value: object


class MaskWriter:
    """Writes the nodes for the source of a mask or a parameter, as children of the prim `scope`.

    `states` has the states of the inputs, by name, of the expression that is replaced. If no source is given for an
    input of the new expression, the input gets the state of the old input of the same name. `kind` is the type of the
    mask or parameter.
    """

    def __init__(
        self, stage: Usd.Stage, scope: Sdf.Path, states: Mapping[str, InputState], kind: ExpressionKind = "float"
    ) -> None:
        self._stage, self._scope, self._states, self._kind = stage, scope, states, kind

    def write(self, attribute: Usd.Attribute, name: str, mask: MaskSource) -> None:
        """Make `mask` the source of an input. The node is named `name`, with a number where the name is in use.

        Raises
        ------
        LookError
            A name of the expression has no source.
        ExpressionError
            The expression has a colour as its result where a float is needed.
        """
        clear_input(attribute)
        match mask:
            case MaskImage():
                attribute.SetConnections([self._write_image(name, mask)])
            case PrimvarName():
                color = attribute.GetTypeName() == _TYPES.Color3f
                attribute.SetConnections([self._write_reader(name, "float3" if color else "float", mask.name)])
            case UvName():
                attribute.SetConnections([self._write_coordinates(mask.name)])
            case MaskExpression():
                attribute.SetConnections([self._write_expression(name, mask)])
            case _:
                attribute.Set(mask)

    def _write_image(self, name: str, image: MaskImage) -> Sdf.Path:
        """Write the node of an image. Like all ``_write`` methods, return the path of the node's output."""
        node = self._define_node(name, "UsdUVTexture")
        node.CreateInput("file", _TYPES.Asset).Set(Sdf.AssetPath(relative_asset(image.file, self._stage)))
        color = image.channel == "rgb"
        if not color:  # a single channel is data, not a colour
            node.CreateInput("sourceColorSpace", _TYPES.Token).Set("raw")
        for wrap in ("wrapS", "wrapT"):
            node.CreateInput(wrap, _TYPES.Token).Set("repeat")
        node.CreateInput("st", _TYPES.Float2).GetAttr().SetConnections([self._write_coordinates("st")])
        return _create_output(node, image.channel, _TYPES.Float3 if color else _TYPES.Float)

    def _write_coordinates(self, name: str) -> Sdf.Path:
        """Return the output of the node that reads a UV set: one that exists in the scope, or else a new one."""
        for prim in self._stage.GetPrimAtPath(self._scope).GetChildren():
            shader = UsdShade.Shader(prim)
            if shader and shader.GetShaderId() == "UsdPrimvarReader_float2":
                varname = prim.GetAttribute("inputs:varname")
                if varname and varname.Get() == name and not varname.HasAuthoredConnections():
                    return prim.GetPath().AppendProperty("outputs:result")
        return self._write_reader(name[:1].upper() + name[1:].replace(":", "_"), "float2", name)

    def _write_reader(self, name: str, kind: Literal["float", "float2", "float3"], primvar: str) -> Sdf.Path:
        """Write the node `name` that reads a primvar of the type `kind`."""
        node = self._define_node(name, f"UsdPrimvarReader_{kind}")
        node.CreateInput("varname", _TYPES.String).Set(primvar)
        return _create_output(node, "result", {"float": _TYPES.Float, "float2": _TYPES.Float2}.get(kind, _TYPES.Float3))

    def _write_expression(self, name: str, mask: MaskExpression) -> Sdf.Path:
        """Write the node of an expression and the nodes of its inputs; raises as `write`."""
        node = self._define_node(name, "LookdevExpression")
        node.CreateInput("expression", _TYPES.String).Set(mask.expression.text)
        kinds: dict[str, ExpressionKind] = {}
        for input_name in mask.expression.names:
            source, state = mask.inputs.get(input_name), self._states.get(input_name)
            if source is None and state is None and input_name == VIEW:
                kinds[input_name] = "float"
                continue
            if source is None and state is None:
                message = f"'{input_name}' in the expression has no source"
                hint = f"add --input {input_name}=IMAGE, --input {input_name}=primvar:{input_name} or a value"
                raise LookError.at("mask", "", message, hint)
            type_name = _input_type(source) if state is None or source is not None else state.type_name
            kinds[input_name] = "float" if type_name == _TYPES.Float else "color"
            attribute = node.CreateInput(input_name, type_name).GetAttr()
            if source is not None:
                self.write(attribute, f"{name}_{input_name}", source)
            elif state is not None and state.connections:
                attribute.SetConnections(state.connections)
            elif state is not None:
                attribute.Set(state.value)
        result = mask.expression.check(kinds)
        if result == "color" and self._kind == "float":
            hint = "a float is needed: use luminance()"
            raise ExpressionError(mask.expression.text, 0, "the result is a color", hint)
        return _create_output(node, "result", _TYPES.Float if result == "float" else _TYPES.Color3f)

    def _define_node(self, name: str, shader_id: str) -> UsdShade.Shader:
        """Define a shader in the scope; a number follows the name where the name is in use."""
        shader = UsdShade.Shader.Define(self._stage, free_path(self._stage, self._scope, name))
        shader.CreateIdAttr(shader_id)
        return shader


def _create_output(node: UsdShade.Shader, name: str, type_name: Sdf.ValueTypeName) -> Sdf.Path:
    """Create an output of a node and return its path."""
    return node.CreateOutput(name, type_name).GetAttr().GetPath()


def _input_type(source: MaskInput | None) -> Sdf.ValueTypeName:
    """Return the type in USD of an expression's input with this source."""
    if isinstance(source, UvName):
        return _TYPES.Float2
    return _TYPES.Color3f if isinstance(source, MaskImage) and source.channel == "rgb" else _TYPES.Float
