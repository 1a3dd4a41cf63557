"""The UsdPreviewSurface of a look: mapped, blended, connected through, and the same when written again."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from look_files import BASE, LAYER1, STACK, disney, pixar, rough, shader, stack, texture
from pxr import Sdf, Sdr, Usd

from lookdev.brdf.conductor import metal_reflectance
from lookdev.errors import LookError
from lookdev.material import Coordinates, Formula, Layer, Primvar, ViewCosine
from lookdev.material.expression import parse
from lookdev.material.library.edit import write_preview
from lookdev.material.library.preview import preview_values
from lookdev.material.usd import read_look

LOOKS = sorted((Path(__file__).parents[2] / "materials").glob("*.usda"))

WRAPS = 'token sourceColorSpace = "raw"\ntoken wrapS = "repeat"\ntoken wrapT = "repeat"'
GRAY = texture(WRAPS, name="Gray")
MEAN = 128 / 255  # of that texture: 0.5 in eight bits
RED, GREEN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


def preview_of(file: Path) -> dict[str, Any]:
    """Write a preview; return each of its inputs, as a value or as the path of its source."""
    assert write_preview(file) == "/M/Preview"
    composed = Usd.Stage.Open(str(file))
    inputs = [
        attribute
        for attribute in composed.GetPrimAtPath("/M/Preview").GetAttributes()
        if "inputs:" in attribute.GetName()
    ]
    return {
        attribute.GetBaseName(): str(paths[0])
        if (paths := attribute.GetConnections())
        else pytest.approx(attribute.Get(), abs=1e-6)
        for attribute in inputs
    }


def formula(text: str, **inputs: Any) -> Formula:
    kinds = {name: "color" if isinstance(source, Coordinates) else "float" for name, source in inputs.items()}
    return Formula(parse(text), inputs, kinds)  # type: ignore[arg-type]


def base(model: str = "disney", **inputs: Any) -> list[Layer]:
    return [Layer("Base", model, inputs)]


ST, WEAR, SILVER, GRAYISH = Coordinates("st"), Primvar("wear", 0.25), metal_reflectance("silver"), (0.1, 0.2, 0.3)
CUT_OUT = Layer("Top", "pixar", {"surfaceColor": GREEN, "presence": 0.25}, 0.5)
COAT = Layer("Coat", "pixar", {"surfaceColor": (1.0, 0.5, 0.0), "clear": 1.0, "roughness": 0.1}, 0.5, "transmit")
PREVIEWS = {
    "Disney's": (
        base(baseColor=RED, metallic=0.25, roughness=0.3, specular=0.5, clearcoat=1.0, clearcoatGloss=0.0),
        # The root of .1; F0 = .04.
        {"diffuseColor": RED, "metallic": 0.25, "roughness": 0.3, "clearcoat": 0.25, "clearcoatRoughness": 0.316228}
        | {"ior": 1.5, "opacity": 1.0},
    ),
    "Pixar's": (
        base("pixar", surfaceColor=RED, normalScale=0.8, presence=0.5, clear=0.25),
        {"diffuseColor": RED, "ior": 1.5, "opacity": 0.375, "clearcoat": 0.0},  # F0 = .05 * .8
    ),
    **{
        f"silver of {model}'s, {metallic}": (
            base(model, metal="silver", metallic=metallic, **{color: GRAYISH}),
            {"diffuseColor": tuple(metallic * SILVER + (1.0 - metallic) * np.array(GRAYISH))},
        )
        for model, color in (("disney", "baseColor"), ("pixar", "surfaceColor"))
        for metallic in (1.0, 0.5)
    },
    "a float expression of a colour is grey": (base(baseColor=formula("st[0]", st=ST)), {"diffuseColor": (0.5,) * 3}),
    # Over the disc that a sphere shows, the cosine is 2/3 and its square 1/2, at every place of st.
    "what depends on the view is averaged over a sphere": (
        base(
            roughness=formula("view", view=ViewCosine()),
            metallic=formula("view * view", view=ViewCosine()),
            baseColor=formula("(view * st[0])", view=ViewCosine(), st=ST),
        ),
        {"roughness": 2.0 / 3.0, "metallic": 0.5, "diffuseColor": (1.0 / 3.0,) * 3},
    ),
    "presence is a mask": (
        [*base("pixar", surfaceColor=RED), CUT_OUT],
        {"diffuseColor": (0.875, 0.125, 0), "opacity": 1},
    ),
    "a layer that transmits is a tinted coat": (
        [*base("pixar", surfaceColor=(0.5, 0.5, 0.5), roughness=0.7), COAT],
        {"diffuseColor": (0.5, 0.375, 0.25), "roughness": 0.7, "clearcoat": 0.5, "opacity": 1.0},
    ),
}


@pytest.mark.parametrize(("name", "layers", "expected"), [(name, *case) for name, case in PREVIEWS.items()])
def test_values(name: str, layers: list[Layer], expected: dict[str, Any]) -> None:
    # Values that depend on the view are means over some points of a sphere; an exact metal's colour is approximate.
    rounding = 1e-3 if "sphere" in name or "silver" in name else 1e-6
    values = preview_values(layers)
    for key, value in expected.items():
        assert values[key] == pytest.approx(value, abs=rounding), key


@pytest.mark.parametrize("specular", [0.0, 1.0, 12.5])
def test_an_index_of_refraction_stays_finite(specular: float) -> None:
    assert 1.0 <= preview_values(base(specular=specular))["ior"] < 100.0


@pytest.mark.parametrize(
    ("mask", "amount"),
    [
        (0.0, 0.0),
        (0.25, 0.25),
        (1.0, 1.0),
        (WEAR, 0.25),
        (formula("wear * 2", wear=WEAR), 0.5),
        (formula("st[0] * 2 - st[1] * 0", st=ST), 0.75),  # clipped at 1 where s > 1/2
        (formula("st[0]", st=Coordinates("st", (0.5, 0.0, 0.25, 0.0, 1.0, 0.0))), 0.5),
    ],
)
def test_layers_are_blended_by_their_masks(mask: Any, amount: float) -> None:
    top = Layer("Top", "pixar", {"surfaceColor": GREEN, "roughness": 0.0}, mask)
    values = preview_values([*base(baseColor=RED), top])
    assert values["diffuseColor"] == pytest.approx([1.0 - amount, amount, 0.0])
    assert values["roughness"] == pytest.approx(0.5 * (1.0 - amount))


def test_a_texture_of_the_base_is_connected_through(write: Callable[..., Path]) -> None:
    preview = preview_of(write(rough("Gray.r") + GRAY))
    assert preview["roughness"] == "/M/Gray.outputs:r"
    assert preview["metallic"] == 0.0


@pytest.mark.parametrize(
    ("mask", "expected"),
    [
        ("float layer1Mask = 0.4", "/M/Gray.outputs:r"),
        ("float layer1Mask = 0.6", pytest.approx(0.4 * MEAN + 0.6 * 0.25, abs=1e-6)),
        ("float layer1Mask <- Gray.r", pytest.approx((1.0 - MEAN) * MEAN + MEAN * 0.25, abs=1e-6)),
        ("bool layer1Enabled = 0", "/M/Gray.outputs:r"),
    ],
)
def test_the_layer_with_most_weight_is_connected(write: Callable[..., Path], mask: str, expected: object) -> None:
    coat = disney("Coat", "float roughness = 0.25")
    assert preview_of(write(stack(BASE + LAYER1 + mask, rough("Gray.r"), coat, GRAY), STACK))["roughness"] == expected


def test_an_interface_input_is_followed_and_a_cut_out_too(write: Callable[..., Path]) -> None:
    body = "color3f surfaceColor <- .tint\nfloat clear = 0.5\nfloat presence <- Gray.r"
    preview = preview_of(write("color3f tint = (1, 0, 0)\n" + pixar(body=body) + GRAY))
    assert preview["diffuseColor"] == "/M.inputs:tint"
    assert preview["opacity"] == "/M/Gray.outputs:r"


@pytest.mark.parametrize("look", LOOKS, ids=lambda look: look.stem)
def test_written_again_it_is_the_same(look: Path, shipped: Callable[[str], Path]) -> None:
    file = shipped(look.stem)
    before = read_look(file)
    write_preview(file)
    once = file.read_bytes()
    write_preview(file)
    assert file.read_bytes() == once
    assert read_look(file).layers == before.layers


def test_it_is_a_preview_surface_as_usd_defines_it(write: Callable[..., Path]) -> None:
    file = write(disney())
    path = write_preview(file)
    stage = Usd.Stage.Open(str(file))
    definition = Sdr.Registry().GetShaderNodeByIdentifier("UsdPreviewSurface")
    for attribute in stage.GetPrimAtPath(path).GetAttributes():
        if attribute.GetNamespace() == "inputs":
            definition_input = definition.GetShaderInput(attribute.GetBaseName())
            assert definition_input.GetTypeAsSdfType().GetSdfType() == attribute.GetTypeName(), attribute
    sources = stage.GetPrimAtPath("/M").GetAttribute("outputs:surface").GetConnections()
    assert sources == [Sdf.Path(f"{path}.outputs:surface")]


def test_what_the_models_do_not_have_is_kept(write: Callable[..., Path]) -> None:
    mine = shader("Mine", "UsdPreviewSurface", "float displacement = 0.5\nfloat roughness = 0.9")
    file = write("token outputs:surface.connect = </M/Mine.outputs:surface>\n" + disney() + mine)
    assert write_preview(file) == "/M/Mine"
    stage = Usd.Stage.Open(str(file))
    prim = stage.GetPrimAtPath("/M/Mine")
    assert prim.GetAttribute("inputs:displacement").Get() == 0.5
    assert prim.GetAttribute("inputs:roughness").Get() == 0.5


def test_another_surface_is_not_overwritten(write: Callable[..., Path]) -> None:
    other = shader("Mine", "ND_standard_surface_surfaceshader")
    file = write("token outputs:surface.connect = </M/Mine.outputs:out>\n" + disney() + other)
    before = file.read_bytes()
    with pytest.raises(LookError, match=r"look.usda: /M.outputs:surface: is connected to <.*ND_standard_surface"):
        write_preview(file)
    assert file.read_bytes() == before
