"""Damaged networks end in looks or in errors, never in anything else."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from bound_files import asset, materialx, preview
from look_files import ST, shader, write_gray

from lookdev.errors import LookError
from lookdev.material.usd.bound import GREY, read_bound
from lookdev.stage import Composition, compose

USD = preview(
    """color3f inputs:diffuseColor.connect = </M/Tex.outputs:rgb>
    float inputs:roughness.connect = </M/P.outputs:result>
    normal3f inputs:normal.connect = </M/Tex.outputs:rgb>
    int inputs:useSpecularWorkflow = 1""",
    shader(
        "Tex",
        "UsdUVTexture",
        """asset inputs:file = @./rgb.png@
        float2 inputs:st.connect = </M/T.outputs:result>
        float4 inputs:scale = (2, 2, 2, 1)
        float4 inputs:bias = (-1, -1, -1, 0)
        token inputs:sourceColorSpace = "raw" """,
    ),
    shader("T", "UsdTransform2d", "float2 inputs:in.connect = </M/St.outputs:result>\nfloat2 inputs:scale = (2, 2)"),
    shader("P", "UsdPrimvarReader_float", 'string inputs:varname = "w"\nfloat inputs:fallback = 0.5'),
    ST,
)
MATERIALX = materialx(
    """color3f inputs:diffuseColor.connect = </M/Mix.outputs:out>
    float3 inputs:normal.connect = </M/N.outputs:out>""",
    shader("Mix", "ND_mix_color3", "color3f inputs:fg.connect = </M/I.outputs:out>\nfloat inputs:mix = 0.5"),
    shader(
        "I", "ND_image_color3", "asset inputs:file = @./rgb.png@\nfloat2 inputs:texcoord.connect = </M/U.outputs:out>"
    ),
    shader("U", "ND_place2d_vector2", "float inputs:rotate = 30\nfloat2 inputs:scale = (2, 2)"),
    shader("N", "ND_normalmap", "float3 inputs:in.connect = </M/V.outputs:out>\nfloat inputs:scale = 2"),
    shader("V", "ND_image_vector3", "asset inputs:file = @./rgb.png@"),
)
JUNK = '<>/"=()[]{},.SM0-9\u00e4@ '
WORDS = (
    "nan",
    "inf",
    "1e39",
    "-1",
    "(1, 2)",
    "None",
    "ND_",
    "color3f",
    "float3[]",
    "</M>",
    "</M/S.outputs:surface>",
    "1e-40",
)


@pytest.mark.parametrize("body", [USD, MATERIALX], ids=["usd", "materialx"])
def test_damaged_networks(tmp_path: Path, body: str) -> None:
    rng = random.Random(7)
    write_gray(tmp_path / "rgb.png", 3)
    results = []
    for _ in range(150):
        start, length = rng.randrange(len(body)), rng.randrange(1, 10)
        junk = rng.choice(["", body[start:][:length] * 2, "".join(rng.choices(JUNK, k=length)), rng.choice(WORDS)])
        end = start + (length if rng.random() < 0.7 else 0)
        file = asset(tmp_path, body[:start] + junk + body[end:])
        try:
            results.append(read_bound(compose(Composition(file, missing="warn")), ["/M"])["/M"])
        except LookError:
            continue
    assert any(found.lost for found in results)
    assert any(found.look.layers == (GREY,) for found in results)
    assert any(found.look.layers != (GREY,) for found in results)
