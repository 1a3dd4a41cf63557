"""Looks as GLSL in headless Chromium, with images, masks and expressions, against their BSDF in float64."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from webgl import NEEDS_CHROMIUM, POINTS, Floats, at_points, cell_code, start_browser

from lookdev.brdf import MODELS, evaluate_cosine, pdf
from lookdev.codegen.glsl.functions import PRELUDE, TABLE_WIDTH
from lookdev.codegen.glsl.look import LOOK_UPS, LookFunctions, look_functions
from lookdev.codegen.program.look import live_name
from lookdev.material import Layer, Look, Primvar
from lookdev.material.points import ImagePoints
from lookdev.material.textures import image_file
from lookdev.material.usd import read_look
from lookdev.material.values import look_bsdf

pytestmark = NEEDS_CHROMIUM

MATERIALS = Path(__file__).parents[2] / "materials"
LOOKS = [
    *sorted(MATERIALS.glob("*.usda")),
    MATERIALS / "classic/ward.usda",
    MATERIALS / "classic/lafortune.usda",
]
COUNT = 300
COLUMNS = ("uv_st[0]", "uv_st[1]", "handed", "wo_x", "wo_y", "wo_z", "wi_x", "wi_y", "wi_z")
MAIN = """{head}{prelude}{look_ups}{look}
void main() {{
    {cell}
{read}
    hand = {hand};
    look_read();
    vec3 value; float pdf;
    look_evaluate(value, pdf);
    result = vec4(value, pdf);
}}
"""


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


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    yield from start_browser()


def scattered(seed: int) -> Floats:
    """Return points, views and lights above the horizon by `COLUMNS`, rounded to float32."""
    rng = np.random.default_rng(seed)
    uv = rng.uniform(-1.3, 1.6, (COUNT, 2))
    hand = np.where(rng.random((COUNT, 1)) < 0.3, -1.0, 1.0)
    directions = rng.normal(size=(2, COUNT, 3))
    directions[..., 2] = np.abs(directions[..., 2]) + 0.05
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return np.concatenate([uv, hand, *directions], axis=-1).astype(np.float32).astype(float)


def in_float64(look: Look, table: Floats) -> Floats:
    uv, hand, wo, wi = table[:, :2], table[:, 2], table[:, 3:6], table[:, 6:9]
    bsdf = look_bsdf(look, Points(uv, hand, wo[:, 2]))
    return np.concatenate([evaluate_cosine(bsdf, wo, wi), pdf(bsdf, wo, wi)[:, None]], axis=-1)


def in_browser(browser: Any, functions: LookFunctions, table: Floats, numbers: Mapping[str, Any]) -> Floats:
    known = {each.parameter for each in functions.attributes} | {name for name in COLUMNS if name.startswith("w")}
    read = [f"    {name} = column({k});" for k, name in enumerate(COLUMNS) if name.partition("[")[0] in known]
    fragment = MAIN.format(
        head=POINTS,
        prelude=PRELUDE,
        look_ups=LOOK_UPS,
        look=functions.text,
        cell=cell_code(len(COLUMNS)),
        read="\n".join(read),
        hand="handed" if "handed" in known else "1.0",
    )
    textures = {f"look_table{k}": _rows(np.load(each.path)) for k, each in enumerate(functions.tables)}
    for each in functions.look_ups:
        for tile, file in each.files.items():
            textures[f"look_{each.name}_{tile}" if tile else f"look_{each.name}"] = _rgba(file.path)
    return at_points(browser, fragment, table, textures, numbers)


def _rows(values: Any) -> Any:
    texels = np.zeros((-(-values.size // TABLE_WIDTH), TABLE_WIDTH), np.float32)
    texels.ravel()[: values.size] = values.ravel()
    return texels


def _rgba(path: Path) -> Any:
    return np.asarray(oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT), np.float32)


def agrees(found: Floats, expected: Floats) -> None:
    """Relative to each value, or to the thousandth part of the median of the largest: 2e-4 in 99 % of the channels."""
    assert np.isfinite(found).all()
    floor = np.maximum(np.abs(expected), 1e-3 * max(1.0, float(np.median(expected))))
    together = (np.abs(found - expected) / floor).ravel()
    assert np.quantile(together, 0.99) < 2e-4, np.quantile(together, [0.5, 0.9, 0.99, 1.0])


@pytest.mark.parametrize("file", LOOKS, ids=lambda file: file.stem)
def test_a_look_agrees_with_its_bsdf(file: Path, browser: Any) -> None:
    look, table = read_look(file), scattered(5)
    functions = look_functions(look, image_file, lambda layer, name: False)
    assert not functions.numbers
    agrees(in_browser(browser, functions, table, {}), in_float64(look, table))


DELTA = """{head}{prelude}{look_ups}{look}
void main() {{
    {cell}
{read}
    inside = column(9); hand = 1.0;
    vec3 direction, factor;
    look_delta{number}(direction, factor);
    result = vec4({part}, 0.0);
}}
"""


@pytest.mark.parametrize(
    "given", [{"tint": (0.9, 0.6, 0.3)}, {"eta": (0.2, 0.9, 1.4), "k": (3.9, 2.4, 1.6)}, {"eta": 1.7}]
)
def test_what_scatters_along_single_directions(given: Mapping[str, Any], browser: Any) -> None:
    """Directions and factors of mirrors and glass, from outside and from inside: 2e-4 in 99 % of the channels."""
    names = ["mirror"] if isinstance(given.get("eta"), tuple) else ["glass"] if "eta" in given else ["mirror", "glass"]
    for name in names:
        look = Look("smooth", (Layer("Base", name, dict(given)),))
        functions = look_functions(look, image_file, lambda layer, key: key in given)
        table = np.concatenate([scattered(7), np.arange(COUNT)[:, None] % 2.0], axis=-1)
        model = MODELS[name]
        deltas = model.bsdf(model.complete(given)).deltas(table[:, 3:6], table[:, 9] > 0.0)
        assert functions.deltas == len(deltas)
        read = [f"    {column} = column({k});" for k, column in enumerate(COLUMNS) if column.startswith("w")]
        for number, delta in enumerate(deltas):
            for part, expected in (("direction", delta.direction), ("factor", delta.value)):
                fragment = DELTA.format(
                    head=POINTS, prelude=PRELUDE, look_ups=LOOK_UPS, look=functions.text, number=number, part=part,
                    cell=cell_code(10), read="\n".join(read),
                )  # fmt: skip
                found = at_points(browser, fragment, table, {}, functions.numbers)[:, :3]
                agrees(found, np.broadcast_to(expected, found.shape))


@pytest.mark.parametrize("name", ["car_paint", "lacquer_wood"])
def test_a_slider_changes_a_uniform_alone(name: str, browser: Any) -> None:
    """Of the numbers of a look, other values give what the look with these values gives."""
    look, table = read_look(MATERIALS / f"{name}.usda"), scattered(6)
    changed = {"roughness": 0.35, "clearcoat": 0.4, "sheen": 0.5, "specular": 0.2, "metallic": 0.3}
    known = MODELS[look.layers[-1].model].parameters
    of_top = {key: each for key, each in changed.items() if isinstance(look.layers[-1].inputs.get(key, 0.0), float)}
    of_top = {key: each for key, each in of_top.items() if key in known}
    top = replace(look.layers[-1], inputs={**look.layers[-1].inputs, **of_top})
    other, last = replace(look, layers=(*look.layers[:-1], top)), len(look.layers) - 1
    functions = look_functions(look, image_file, lambda layer, name: layer == last and name in changed)
    assert set(functions.numbers) == {live_name(last, key) for key in of_top}
    numbers = {live_name(last, key): (each,) for key, each in of_top.items()}
    text = look_functions(other, image_file, lambda layer, name: layer == last and name in changed).text
    assert text == functions.text
    found = in_browser(browser, functions, table, numbers)
    agrees(found, in_float64(other, table))
    assert np.abs(found - in_browser(browser, functions, table, functions.numbers)).max() > 0.01
