"""Node definitions for other USD tools, written from the models' own parameters.

``python -m lookdev.material.definitions`` rewrites `DEFINITIONS`.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from lookdev.brdf import MASK, MODELS, Parameter
from lookdev.cache import atomic_path

DEFINITIONS = Path(__file__).parents[1] / "shaders" / "shaderDefs.usda"
"""The file that contains `shader_definitions`."""

DEFINED_LAYERS = 8
"""Layers over the base that LookdevLayers declares; a look may have more."""

USD_TYPES = {"float": "float", "color": "color3f", "normal": "normal3f", "token": "token"}
"""The type of an input by the kind of its parameter."""

_HEAD = """#usda 1.0
(
    doc = "Node definitions of lookdev. Written by lookdev.material.definitions; do not edit."
)

"""
# Sdr drops a node without a source asset; the code is generated, so the definition names itself.
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
    """Return the text of shaderDefs.usda, for `Sdr.Registry`: the models, stacks, bumps, displacements and expressions.

    Each input has its type, default, help and, for numbers, its hard and soft range.
    """
    models = [
        _shader(model.identifier, model.text, [*map(_parameter, model.parameters.values())], "token outputs:layer")
        for model in MODELS.values()
    ]
    layers = [_input("token", "base", "The layer beneath all others.")]
    for number in range(1, DEFINED_LAYERS + 1):
        layers += _layer_inputs(f"layer{number}", "the base" if number == 1 else f"layer{number - 1}")
    stack_doc = "A stack of layers, each over what is beneath it."
    bump = [
        _input("float", "height", "A channel of a UsdUVTexture: the height map."),
        _input("float", "scale", "How many units of st a height of 1 stands above the surface.", "1.0", constant=True),
    ]
    expression_help = "What is computed, for instance clamp(dirt * (1 - edge), 0, 1). Its names are further inputs."
    expression = [_input("string", "expression", expression_help, constant=True)]
    expression_doc = (
        "A value computed from named inputs, which are float, color3f or float2, and from view, the cosine between the "
        "shading normal and the direction to the viewer."
    )
    height_help = "A texture's channel, a primvar, an expression or a constant: how far points move along the normal."
    midlevel_help = "The height at which a point stays where it is."
    units_help = "object: the units of the asset's file, in the object's own space. world: metres."
    displacement = [
        _input("float", "height", height_help, "0.0"),
        _input("float", "scale", "The factor from heights to units.", "1.0", constant=True),
        _input("float", "midlevel", midlevel_help, "0.0", constant=True),
        _input("token", "units", units_help, '"object"', ("object", "world"), constant=True),
    ]
    displacement_doc = "The surface is moved along its normal by (height - midlevel) scale."
    others = [
        _shader("LookdevLayers", stack_doc, layers, "token outputs:surface"),
        _shader("LookdevBump", "A normal from a height map.", bump, "normal3f outputs:normal", "math"),
        _shader("LookdevDisplacement", displacement_doc, displacement, "token outputs:displacement", "displacement"),
        _shader("LookdevExpression", expression_doc, expression, "float outputs:result", "math"),
    ]
    return _HEAD + "\n".join([*models, *others])


def _layer_inputs(name: str, beneath: str) -> list[str]:
    combined = [model.title for model in MODELS.values() if model.combine]
    takers = [model.title for model in MODELS.values() if "transmit" in model.modes]
    mode = (
        f"over: covers what is beneath by the mask; {_layers(combined)} blend lobes, those of other models parameters. "
        f"transmit: what the layer transmits meets the layers beneath; for {_layers(takers)} over nothing but "
        f"{_layers(takers)}."
    )
    return [
        _input("token", name, f"The layer over {beneath}."),
        _parameter(replace(MASK, name=f"{name}Mask", help=f"How much of {name} covers what is beneath.")),
        _input("bool", f"{name}Enabled", f"Whether {name} is there at all.", "1", constant=True),
        _input("token", f"{name}Mode", mode, '"over"', ("over", "transmit"), constant=True),
    ]


def _layers(titles: list[str]) -> str:
    return f"{' and '.join(titles)} layers"


def _shader(name: str, doc: str, inputs: list[str], output: str, role: str = "surface") -> str:
    return _SHADER.format(
        name=name, doc=_quoted(doc), role=role, file=DEFINITIONS.name, inputs="\n".join(inputs), output=output
    )


def _parameter(parameter: Parameter) -> str:
    kind, name, text = USD_TYPES[parameter.kind], parameter.name, parameter.help
    if parameter.file:
        return _input("asset", name, text, "@@", constant=True)
    if parameter.kind == "token":
        return _input(kind, name, text, json.dumps(parameter.default), parameter.choices, constant=True)
    return _input(kind, name, text, repr(parameter.default), ranges=parameter.hard + parameter.soft)


def _input(
    usd_type: str,
    name: str,
    text: str,
    default: str = "",
    choices: Sequence[str] = (),
    constant: bool = False,
    ranges: Sequence[float] = (),
) -> str:
    lines = [f"    {usd_type} inputs:{name}" + (f" = {default}" if default else "") + " ("]
    if choices:
        lines.append(f"        allowedTokens = {json.dumps(list(choices))}")
    if constant:
        lines.append('        connectability = "interfaceOnly"')
    bounds = zip(("hardMin", "hardMax", "softMin", "softMax"), map(repr, ranges), strict=False)
    metadata = [f"            string {key} = {_quoted(value)}" for key, value in [("help", text), *bounds]]
    return "\n".join([*lines, "        sdrMetadata = {", *metadata, "        }", "    )", ""])


def _quoted(text: str) -> str:
    # USD reads UTF-8, and no escapes of JSON beyond ASCII.
    return json.dumps(text, ensure_ascii=False)


if __name__ == "__main__":
    with atomic_path(DEFINITIONS) as temporary:
        temporary.write_text(shader_definitions(), encoding="utf-8")
