"""Looks of a material /M put together from text, and what is wrong with them."""

from __future__ import annotations

from pathlib import Path

import pytest

from lookdev.errors import LookError
from lookdev.material.usd import read_look

SHADER = 'def Shader "{name}" {{\n uniform token info:id = "{id}"\n {body}\n}}\n'


def shader(name: str, shader_id: str, body: str = "") -> str:
    return SHADER.format(name=name, id=shader_id, body=body)


def disney(name: str = "Base", body: str = "") -> str:
    return shader(name, "LookdevDisney", body)


def pixar(name: str = "Base", body: str = "") -> str:
    return shader(name, "LookdevPixar", body)


ST = shader("St", "UsdPrimvarReader_float2", 'string inputs:varname = "st"')
BASE = "token inputs:base.connect = </M/Base.outputs:layer>\n"
LAYER1 = "token inputs:layer1.connect = </M/Coat.outputs:layer>\n"


def stack(inputs: str, *shaders: str) -> str:
    return shader("Layers", "LookdevLayers", inputs) + "".join(shaders)


STACK = "</M/Layers.outputs:surface>"


def faults_of(file: Path, **options: object) -> list[tuple[str, str, str]]:
    with pytest.raises(LookError) as caught:
        read_look(file, **options)
    assert all(fault.file == str(file) for fault in caught.value.faults)
    return [(fault.where, fault.what, fault.hint) for fault in caught.value.faults]
