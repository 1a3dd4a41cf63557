"""Faults planted in the shader that Cycles runs, each of which a check at its default depth must find."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from lookdev.batch.check import check_file

pytestmark = pytest.mark.cycles

LOOK = """#usda 1.0
(
    defaultPrim = "Paint"
)
def Material "Paint"
{
    token outputs:lookdev:surface.connect = </Paint/Layers.outputs:surface>
    def Shader "Layers"
    {
        uniform token info:id = "LookdevLayers"
        token inputs:base.connect = </Paint/Base.outputs:layer>
        token inputs:layer1.connect = </Paint/Dust.outputs:layer>
        float inputs:layer1Mask.connect = </Paint/Color.outputs:g>
        token outputs:surface
    }
    def Shader "Base"
    {
        uniform token info:id = "LookdevDisney"
        color3f inputs:baseColor.connect = </Paint/Color.outputs:rgb>
        float inputs:roughness = 0.45
        float inputs:anisotropic = 0.8
        float inputs:clearcoat = 0.5
        token outputs:layer
    }
    def Shader "Dust"
    {
        uniform token info:id = "LookdevDisney"
        color3f inputs:baseColor = (0.6, 0.5, 0.4)
        float inputs:roughness = 0.8
        token outputs:layer
    }
    def Shader "Color"
    {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @./color.png@
        token inputs:sourceColorSpace = "sRGB"
        token inputs:wrapS = "repeat"
        token inputs:wrapT = "repeat"
        float2 inputs:st.connect = </Paint/St.outputs:result>
        float3 outputs:rgb
        float outputs:g
    }
    def Shader "St"
    {
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "st"
        float2 outputs:result
    }
}
"""


def _after(mark: str, change: Callable[[str], str]) -> Callable[[str], str]:
    """Change what follows the first `mark` of the text."""

    def alter(osl: str) -> str:
        before, found, rest = osl.partition(mark)
        assert found, f"the shader has no '{mark}'"
        return before + found + change(rest)

    return alter


def _instead(pattern: str, replacement: str, count: int = 0) -> Callable[[str], str]:
    def alter(osl: str) -> str:
        changed, found = re.subn(pattern, replacement, osl, count=count)
        assert found, f"the shader has no '{pattern}'"
        return changed

    return alter


def _swapped(text: str) -> str:
    return re.sub(r"\b(w[oi])_([xy])\b", lambda name: f"{name[1]}_{'y' if name[2] == 'x' else 'x'}", text)


# The fault, and the check that is to find it. Everything after `shares` is the generated code; before, tables are read.
FAULTS: dict[str, tuple[str, Callable[[str], str]]] = {
    "a cosine too many": ("points", _instead(r"pdf /= shares;", "pdf /= shares; f *= fabs(wi_z);")),
    "pi missing": ("points", _instead(r"0\.3183098861837907", "1.0", 1)),
    "alpha_x and alpha_y swapped": ("points", _after("float shares", _swapped)),
    "a lobe's pdf scaled": ("points", _instead(r"pdf \+= share_1 \*", "pdf += 1.02 * share_1 *")),
    "a lobe's pdf scaled, by the albedo": ("albedo", _instead(r"pdf \+= share_1 \*", "pdf += 1.3 * share_1 *")),
    "the mask inverted": (
        "points",
        _instead(r"(layer1_mask = cell\[\d\];)", r"\1 layer1_mask = 1 - layer1_mask;"),
    ),
    "the light mirrored": ("image", _instead(r"x = 0\.5 - \(atan2", "x = 0.5 + (atan2")),
    "a texture not linearised": (
        "image",
        _instead(r"(color texture0 = lookdev_texture\([^;]*;)", r"\1 texture0 = pow(texture0, 1 / 2.2);"),
    ),
    "an energy loss of 3 %": ("image", _instead(r"direct \+= f", "direct += 0.97 * f")),
}


@pytest.fixture(scope="module")
def look(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("planted")
    rng = np.random.default_rng(5)
    image = oiio.ImageBuf(oiio.ImageSpec(8, 8, 3, oiio.UINT8))
    image.set_pixels(image.roi, rng.integers(20, 230, (8, 8, 3)).astype(np.uint8))
    assert image.write(str(folder / "color.png"))
    (folder / "paint.usda").write_text(LOOK)
    return folder / "paint.usda"


@pytest.mark.slow
@pytest.mark.parametrize("check", ["points", "albedo", "image"])
def test_without_a_fault_all_agrees(look: Path, check: str) -> None:
    for finding in check_file(look, only=[check], depth="default"):
        assert finding.passed, (finding.summary, *finding.details)


@pytest.mark.parametrize(
    ("check", "plant"),
    [
        pytest.param(*case, marks=() if name == "a cosine too many" else pytest.mark.slow, id=name)
        for name, case in FAULTS.items()
    ],
)
def test_a_planted_fault_is_found(look: Path, check: str, plant: Callable[[str], str]) -> None:
    findings = list(check_file(look, only=[check], depth="default", alter=plant))
    assert findings
    assert not all(finding.passed for finding in findings), [finding.summary for finding in findings]
