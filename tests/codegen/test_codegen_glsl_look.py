"""Looks as GLSL in headless Chromium, with images, masks and expressions, against their BSDF in float64."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from webgl import POINTS, Floats, Picture, draw_pictures, read_columns

from lookdev.brdf import MODELS, evaluate_cosine, pdf
from lookdev.codegen.glsl.functions import PRELUDE, TABLE_WIDTH
from lookdev.codegen.glsl.look import TEXTURE_FUNCTIONS, LookFunctions, look_functions
from lookdev.codegen.program.look import live_name
from lookdev.material import Layer, Look, Primvar
from lookdev.material.points import ImagePoints
from lookdev.material.textures import image_file
from lookdev.material.usd import read_look
from lookdev.material.values import look_bsdf

MATERIALS = Path(__file__).parents[2] / "materials"
# Masks, a transmitting model, bumps of images over layers, and other models; images of the others take a second each.
QUICK = [MATERIALS / f"{name}.usda" for name in ("car_paint", "frosted_plastic", "leaf")]
QUICK += [MATERIALS / f"classic/{name}.usda" for name in ("ward", "lafortune")]
OTHERS = sorted(set(MATERIALS.glob("*.usda")) - set(QUICK))
COUNT = 300
COLUMNS = ("uv_st[0]", "uv_st[1]", "handed", "wo_x", "wo_y", "wo_z", "wi_x", "wi_y", "wi_z")
MAIN = """{head}{prelude}{look_ups}{look}
void main() {{
    {read}
    {main}
}}
"""
EVALUATE = "look_read(); vec3 value; float pdf; look_evaluate(value, pdf); result = vec4(value, pdf);"
DELTA = """inside = column(9); vec3 direction, factor; look_delta{number}(direction, factor);
    result.rgb = column(10) > 0.0 ? factor : direction;"""


@dataclass(frozen=True)
class Points(ImagePoints):
    """Points of a surface without primvars."""

    st: Floats
    hand: Floats
    cosine: Floats

    def uv(self, name: str) -> Floats:
        return self.st

    def primvar(self, primvar: Primvar) -> Floats:
        return np.broadcast_to(np.asarray(primvar.fallback, float), (len(self.st), *np.shape(primvar.fallback)))

    def handedness(self) -> Floats:
        return self.hand

    def view(self) -> Floats:
        return self.cosine


def random_points(seed: int) -> Floats:
    """Return points, views and lights above the horizon by `COLUMNS`, rounded to float32."""
    rng = np.random.default_rng(seed)
    uv = rng.uniform(-1.3, 1.6, (COUNT, 2))
    hand = np.where(rng.random((COUNT, 1)) < 0.3, -1.0, 1.0)
    directions = rng.normal(size=(2, COUNT, 3))
    directions[..., 2] = np.abs(directions[..., 2]) + 0.05
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return np.concatenate([uv, hand, *directions], axis=-1).astype(np.float32).astype(float)


def reference_values(look: Look, table: Floats) -> Floats:
    uv, hand, wo, wi = table[:, :2], table[:, 2], table[:, 3:6], table[:, 6:9]
    bsdf = look_bsdf(look, Points(uv, hand, wo[:, 2]))
    return np.concatenate([evaluate_cosine(bsdf, wo, wi), pdf(bsdf, wo, wi)[:, None]], axis=-1)


def picture(functions: LookFunctions, table: Floats, numbers: Mapping[str, Any], main: str = EVALUATE) -> Picture:
    """Return the picture of a look at points, whose first columns are `COLUMNS`."""
    parameters = {binding.parameter for binding in functions.program.attributes}
    columns = {
        name: k for k, name in enumerate(COLUMNS) if name.partition("[")[0] in parameters or name.startswith("w")
    }
    textures = {f"look_table{k}": _rows(np.load(binding.path)) for k, binding in enumerate(functions.program.tables)}
    for look_up in functions.program.look_ups:
        for tile, file in look_up.files.items():
            textures[f"look_{look_up.name}_{tile}" if tile else f"look_{look_up.name}"] = _rgba(file.path)
    fragment = MAIN.format(
        head=POINTS, prelude=PRELUDE, look_ups=TEXTURE_FUNCTIONS, look=functions.text,
        read=read_columns(columns, table.shape[1]), main=f"hand = {'handed' if 'handed' in columns else '1.0'}; {main}",
    )  # fmt: skip
    return Picture(fragment, table, textures, numbers)


def _rows(values: Any) -> Any:
    texels = np.zeros((-(-values.size // TABLE_WIDTH), TABLE_WIDTH), np.float32)
    texels.ravel()[: values.size] = values.ravel()
    return texels


def _rgba(path: Path) -> Any:
    return np.asarray(oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT), np.float32)


def assert_agrees(name: str, values: Floats, expected: Floats) -> None:
    """The error is below 2e-4 in 99 % of the channels, relative to the value or to a thousandth of the median.

    A median below 1 counts as 1.
    """
    assert np.isfinite(values).all(), name
    floor = np.maximum(np.abs(expected), 1e-3 * max(1.0, float(np.median(expected))))
    together = (np.abs(values - expected) / floor).ravel()
    assert np.quantile(together, 0.99) < 2e-4, (name, np.quantile(together, [0.5, 0.9, 0.99, 1.0]))


@pytest.mark.parametrize("files", [QUICK, pytest.param(OTHERS, marks=pytest.mark.proof)], ids=["quick", "others"])
def test_looks_agree_with_their_bsdfs(files: list[Path], tab: Any) -> None:
    looks, table = [read_look(file) for file in files], random_points(5)
    functions = [look_functions(look, image_file, lambda layer, name: False) for look in looks]
    assert not any(look_code.numbers for look_code in functions)
    pictures = draw_pictures(tab, [picture(look_code, table, {}) for look_code in functions])
    for look, result in zip(looks, pictures, strict=True):
        assert_agrees(look.name, result, reference_values(look, table))


CONDUCTOR = {"eta": (0.2, 0.9, 1.4), "k": (3.9, 2.4, 1.6)}


def test_what_scatters_along_single_directions(tab: Any) -> None:
    """Directions and factors of mirrors and glass, from outside and from inside: 2e-4 in 99 % of the channels."""
    sides = np.concatenate([random_points(7), np.arange(COUNT)[:, None] % 2.0], axis=-1)
    table = np.concatenate([np.column_stack([sides, np.full(COUNT, part)]) for part in (0.0, 1.0)])
    pictures, expected = [], []
    tint = {"tint": (0.9, 0.6, 0.3)}
    for name, inputs in (("mirror", tint), ("glass", tint), ("mirror", CONDUCTOR), ("glass", {"eta": 1.7})):
        look, model = Look("smooth", (Layer("Base", name, dict(inputs)),)), MODELS[name]
        functions = look_functions(look, image_file, lambda layer, key, inputs=inputs: key in inputs)
        deltas = model.bsdf(model.complete(inputs)).deltas(sides[:, 3:6], sides[:, 9] > 0.0)
        assert functions.program.deltas == len(deltas) > 0
        for number, delta in enumerate(deltas):
            pictures.append(picture(functions, table, functions.numbers, DELTA.format(number=number)))
            expected += [(name, np.broadcast_to(part, (COUNT, 3))) for part in (delta.direction, delta.value)]
    results = [half for values in draw_pictures(tab, pictures) for half in np.split(values[:, :3], 2)]
    for (name, values), half in zip(expected, results, strict=True):
        assert_agrees(name, half, values)


@pytest.mark.parametrize("name", ["car_paint", pytest.param("lacquer_wood", marks=pytest.mark.proof)])
def test_a_slider_changes_a_uniform_alone(name: str, tab: Any) -> None:
    """Other values of a look's uniforms give the results of a look that has these values."""
    look, table = read_look(MATERIALS / f"{name}.usda"), random_points(6)
    last, top = len(look.layers) - 1, look.layers[-1]
    changes = {
        key: value
        for key, value in {"roughness": 0.35, "clearcoat": 0.4, "sheen": 0.5, "specular": 0.2, "metallic": 0.3}.items()
        if key in MODELS[top.model].parameters and isinstance(top.inputs.get(key, 0.0), float)
    }
    other = replace(look, layers=(*look.layers[:-1], replace(top, inputs={**top.inputs, **changes})))
    functions, other_functions = (
        look_functions(variant, image_file, lambda layer, name: layer == last and name in changes)
        for variant in (look, other)
    )
    assert other_functions.text == functions.text
    numbers = {live_name(last, key): (value,) for key, value in changes.items()}
    assert set(functions.numbers) == set(numbers)
    changed_picture, before = draw_pictures(
        tab, [picture(functions, table, variant) for variant in (numbers, functions.numbers)]
    )
    assert_agrees(name, changed_picture, reference_values(other, table))
    assert np.abs(changed_picture - before).max() > 0.01
