"""Writes shaderDefs.usda: the definitions of our shader nodes for USD, generated from the parameters of the models.

USD's shader registry (Sdr) reads the file, and so do other USD tools. ``python -m lookdev.material.definitions``
writes it again.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from lookdev.brdf import MASK, MODELS, Parameter
from lookdev.cache import atomic_path

DEFINITIONS = Path(__file__).parents[1] / "shaders" / "shaderDefs.usda"
"""The file that contains the text of `shader_definitions`."""

DEFINED_LAYERS = 8
"""The number of layers over the base for which the definition of LookdevLayers has inputs; a look may have more."""

USD_TYPES = {"float": "float", "color": "color3f", "normal": "normal3f", "token": "token"}
"""The type of an input in USD, by the `Parameter.kind` of its parameter."""

_HEAD = """#usda 1.0
(
    doc = "Node definitions of lookdev. Written by lookdev.material.definitions; do not edit."
)

"""
# Sdr drops a node that names no file of source code. Our code is generated, so a definition names its own file.
_SHADER = """def Shader "{name}" (
    doc = {doc}
    sdrMetadata = {{
        token role = "{role}"
    }}
)
{{
    uniform token info:id = "{name}"
    uniform token info:implementationSource = "sourceAsset"
    uniform asset info:lookdev:sourceAsset = @./{file}@

{inputs}
    {output}
}}
"""


def shader_definitions() -> str:
    """Return the text of shaderDefs.usda, for `Sdr.Registry`.

    It defines one node for each model, and nodes for layer stacks, bump maps, displacements and expressions. An input
    has its type, default and help. Numbers, colours and normals of models also have their hard and soft ranges.
    """
    models = []
    for model in MODELS.values():
        inputs = [*map(_parameter_text, model.parameters.values())]
        models.append(_shader_text(model.identifier, model.text, inputs, "token outputs:layer"))
    layers = [_input_text("token", "base", "The layer beneath all others.")]
    for number in range(1, DEFINED_LAYERS + 1):
        layers += _layer_input_texts(f"layer{number}", "the base" if number == 1 else f"layer{number - 1}")
    stack_doc = "A stack of layers, each over what is beneath it."
    bump_help = "How many units of st a height of 1 stands above the surface."
    bump = [
        _input_text("float", "height", "A channel of a UsdUVTexture: the height map."),
        _input_text("float", "scale", bump_help, "1.0", constant=True),
    ]
    expression_help = "What is computed, for instance clamp(dirt * (1 - edge), 0, 1). Its names are further inputs."
    expression = [_input_text("string", "expression", expression_help, constant=True)]
    expression_doc = (
        "A value computed from named inputs, which are float, color3f or float2, and from view, the cosine between the "
        "shading normal and the direction to the viewer."
    )
    height_help = "A texture's channel, a primvar, an expression or a constant: how far points move along the normal."
    midlevel_help = "The height at which a point stays where it is."
    units_help = "object: the units of the asset's file, in the object's own space. world: metres."
    displacement = [
        _input_text("float", "height", height_help, "0.0"),
        _input_text("float", "scale", "The factor from heights to units.", "1.0", constant=True),
        _input_text("float", "midlevel", midlevel_help, "0.0", constant=True),
        _input_text("token", "units", units_help, '"object"', ("object", "world"), constant=True),
    ]
    displacement_doc = "The surface is moved along its normal by (height - midlevel) scale."
    others = [
        _shader_text("LookdevLayers", stack_doc, layers, "token outputs:surface"),
        _shader_text("LookdevBump", "A normal from a height map.", bump, "normal3f outputs:normal", "math"),
        _shader_text(
            "LookdevDisplacement", displacement_doc, displacement, "token outputs:displacement", "displacement"
        ),
        _shader_text("LookdevExpression", expression_doc, expression, "float outputs:result", "math"),
    ]
    return _HEAD + "\n".join([*models, *others])


def _layer_input_texts(name: str, beneath: str) -> list[str]:
    """Return the definitions of the four inputs of LookdevLayers for one layer: its shader, mask, switch and mode.

    `name` is the name of the first input, such as ``layer2``. `beneath` names the layer below.
    """
    combined = _layers_phrase([model.title for model in MODELS.values() if model.combine])
    transmitting = _layers_phrase([model.title for model in MODELS.values() if "transmit" in model.modes])
    mode = (
        f"over: the layer covers the layers beneath by its mask. {combined} blend their lobes, layers of other "
        "models their parameters. transmit: light that the layer transmits reaches the layers beneath. Only "
        f"{transmitting} have this mode, over layers of the same kind."
    )
    return [
        _input_text("token", name, f"The layer over {beneath}."),
        _parameter_text(replace(MASK, name=f"{name}Mask", help=f"How much of {name} covers what is beneath.")),
        _input_text("bool", f"{name}Enabled", f"Whether {name} is there at all.", "1", constant=True),
        _input_text("token", f"{name}Mode", mode, '"over"', ("over", "transmit"), constant=True),
    ]


def _layers_phrase(titles: list[str]) -> str:
    """Return a phrase for the layers of some models, such as ``"Matte and Metal layers"``."""
    return f"{' and '.join(titles)} layers"


def _shader_text(name: str, doc: str, inputs: list[str], output: str, role: str = "surface") -> str:
    """Return the definition of a node; `inputs` are texts of `_input_text`, `output` is a type and name in USD.

    `role` is Sdr's word for the use of a node.
    """
    text, file = "\n".join(inputs), DEFINITIONS.name
    return _SHADER.format(name=name, doc=_quote(doc), role=role, file=file, inputs=text, output=output)


def _parameter_text(parameter: Parameter) -> str:
    """Return the definition of the input for a parameter of a model."""
    kind, name, text = USD_TYPES[parameter.kind], parameter.name, parameter.help
    if parameter.file:
        return _input_text("asset", name, text, "@@", constant=True)
    if parameter.kind == "token":
        return _input_text(kind, name, text, json.dumps(parameter.default), parameter.choices, constant=True)
    return _input_text(kind, name, text, repr(parameter.default), ranges=parameter.hard + parameter.soft)


def _input_text(
    usd_type: str,
    name: str,
    text: str,
    default: str = "",
    choices: Sequence[str] = (),
    constant: bool = False,
    ranges: Sequence[float] = (),
) -> str:
    """Return the definition of an input of a node.

    `text` is the help. `default` is written in USD's text format. A `constant` input cannot be connected to a node.
    `ranges` are hardMin, hardMax, softMin and softMax, or empty.
    """
    lines = [f"    {usd_type} inputs:{name}" + (f" = {default}" if default else "") + " ("]
    if choices:
        lines.append(f"        allowedTokens = {json.dumps(list(choices))}")
    if constant:
        lines.append('        connectability = "interfaceOnly"')
    bounds = zip(("hardMin", "hardMax", "softMin", "softMax"), map(repr, ranges), strict=False)
    metadata = [f"            string {key} = {_quote(value)}" for key, value in [("help", text), *bounds]]
    return "\n".join([*lines, "        sdrMetadata = {", *metadata, "        }", "    )", ""])


def _quote(text: str) -> str:
    """Return a text in quotation marks, as a string of USD."""
    # USD reads UTF-8, but not JSON's escapes (\u00e9) of characters beyond ASCII.
    return json.dumps(text, ensure_ascii=False)


if __name__ == "__main__":
    with atomic_path(DEFINITIONS) as temporary:
        temporary.write_text(shader_definitions(), encoding="utf-8")
