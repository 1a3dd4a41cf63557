"""Node definitions for other USD tools, written from the models' own parameters.

``python -m lookdev.material.definitions`` rewrites `DEFINITIONS`.
"""

from __future__ import annotations

import json
from pathlib import Path

from lookdev.brdf import MODELS, Parameter, Value
from lookdev.cache import atomic_path

DEFINITIONS = Path(__file__).parents[1] / "shaders" / "shaderDefs.usda"
"""The file that `shader_definitions` is the text of."""

DEFINED_LAYERS = 8
"""Layers over the base that LookdevLayers declares; a look may have more."""

_USD_TYPES = {"float": "float", "color": "color3f", "normal": "normal3f", "token": "token"}
_MODE_HELP = (
    "over: covers what is beneath by the mask; Disney layers blend parameters, Pixar layers blend lobes. "
    "transmit: what the layer transmits meets the layers beneath; for Pixar layers over nothing but Pixar layers."
)


def shader_definitions() -> str:
    """Return the text of shaderDefs.usda, for `Sdr.Registry`: the models, stacks, bumps and expressions.

    Each input has its type, default, help and, for numbers, its hard and soft range.
    """
    layers = [_input("token", "base", None, {"help": "The layer beneath all others."})]
    for number in range(1, DEFINED_LAYERS + 1):
        name = f"layer{number}"
        beneath = "the base" if number == 1 else f"layer{number - 1}"
        mask = Parameter(f"{name}Mask", "float", 1.0, help=f"How much of {name} covers what is beneath.")
        layers += [
            _input("token", name, None, {"help": f"The layer over {beneath}."}),
            _parameter(mask),
            _input("bool", f"{name}Enabled", "1", {"help": f"Whether {name} is there at all."}, constant=True),
            _input("token", f"{name}Mode", '"over"', {"help": _MODE_HELP}, choices=("over", "transmit"), constant=True),
        ]
    bump = [
        _input("float", "height", None, {"help": "A channel of a UsdUVTexture: the height map."}),
        _input(
            "float", "scale", "1.0", {"help": "How many units of st a height of 1 stands above the surface."}, (), True
        ),
    ]
    expression = [
        _input(
            "string",
            "expression",
            None,
            {"help": "What is computed, for instance clamp(dirt * (1 - edge), 0, 1). Its names are further inputs."},
            (),
            True,
        )
    ]
    models = [
        _shader(model.identifier, model.text, [*map(_parameter, model.parameters.values())], "token outputs:layer")
        for model in MODELS.values()
    ]
    return "\n".join(
        [
            "#usda 1.0",
            "(",
            '    doc = "Node definitions of lookdev. Written by lookdev.material.definitions; do not edit."',
            ")",
            "",
            *models,
            _shader(
                "LookdevLayers", "A stack of layers, each over what is beneath it.", layers, "token outputs:surface"
            ),
            _shader("LookdevBump", "A normal from a height map.", bump, "normal3f outputs:normal", role="math"),
            _shader(
                "LookdevExpression",
                "A value computed from named inputs, which are float, color3f or float2.",
                expression,
                "float outputs:result",
                role="math",
            ),
        ]
    )


def _shader(name: str, doc: str, inputs: list[str], output: str, role: str = "surface") -> str:
    # Sdr drops a node without a source asset; the code is generated, so the definition names itself.
    return "\n".join(
        [
            f'def Shader "{name}" (',
            f"    doc = {json.dumps(doc)}",
            "    sdrMetadata = {",
            f'        token role = "{role}"',
            "    }",
            ")",
            "{",
            f'    uniform token info:id = "{name}"',
            '    uniform token info:implementationSource = "sourceAsset"',
            f"    uniform asset info:lookdev:sourceAsset = @./{DEFINITIONS.name}@",
            "",
            *inputs,
            f"    {output}",
            "}",
            "",
        ]
    )


def _parameter(parameter: Parameter) -> str:
    metadata = {"help": parameter.help}
    constant = parameter.kind == "token"
    if not constant:
        (hard_min, hard_max), (soft_min, soft_max) = parameter.hard, parameter.soft
        metadata |= {"hardMin": repr(hard_min), "hardMax": repr(hard_max)}
        metadata |= {"softMin": repr(soft_min), "softMax": repr(soft_max)}
    return _input(
        _USD_TYPES[parameter.kind], parameter.name, _literal(parameter.default), metadata, parameter.choices, constant
    )


def _literal(value: Value) -> str:
    return json.dumps(value) if isinstance(value, str) else repr(value)


def _input(
    usd_type: str,
    name: str,
    default: str | None,
    metadata: dict[str, str],
    choices: tuple[str, ...] = (),
    constant: bool = False,
) -> str:
    lines = [f"    {usd_type} inputs:{name}" + (f" = {default}" if default is not None else "") + " ("]
    if choices:
        lines.append(f"        allowedTokens = {json.dumps(list(choices))}")
    if constant:
        lines.append('        connectability = "interfaceOnly"')
    lines.append("        sdrMetadata = {")
    lines += [f"            string {key} = {json.dumps(text)}" for key, text in metadata.items()]
    lines += ["        }", "    )", ""]
    return "\n".join(lines)


if __name__ == "__main__":
    with atomic_path(DEFINITIONS) as temporary:
        temporary.write_text(shader_definitions(), encoding="utf-8")
