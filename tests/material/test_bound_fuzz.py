"""Damaged networks end in looks or in errors, never in anything else."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from look_files import ST, asset, materialx, preview, shader, write_gray

from lookdev.errors import LookError
from lookdev.material.usd.bound import GREY, read_bound
from lookdev.stage import Composition, compose

USD = preview(
    """color3f diffuseColor <- Tex.rgb
    float roughness <- P.result
    normal3f normal <- Tex.rgb
    int useSpecularWorkflow = 1""",
    shader(
        "Tex",
        "UsdUVTexture",
        """asset file = @./rgb.png@
        float2 st <- T.result
        float4 scale = (2, 2, 2, 1)
        float4 bias = (-1, -1, -1, 0)
        token sourceColorSpace = "raw" """,
    ),
    shader("T", "UsdTransform2d", "float2 in <- St.result\nfloat2 scale = (2, 2)"),
    shader("P", "UsdPrimvarReader_float", 'string varname = "w"\nfloat fallback = 0.5'),
    ST,
)
MATERIALX = materialx(
    """color3f diffuseColor <- Mix.out
    float3 normal <- N.out""",
    shader("Mix", "ND_mix_color3", "color3f fg <- I.out\nfloat mix = 0.5"),
    shader("I", "ND_image_color3", "asset file = @./rgb.png@\nfloat2 texcoord <- U.out"),
    shader("U", "ND_place2d_vector2", "float rotate = 30\nfloat2 scale = (2, 2)"),
    shader("N", "ND_normalmap", "float3 in <- V.out\nfloat scale = 2"),
    shader("V", "ND_image_vector3", "asset file = @./rgb.png@"),
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
