"""Generated GLSL in headless Chromium against the models in float64, over the oracles' cases."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from webgl import POINTS, Picture, draw_pictures, read_columns

from lookdev.arrays import Floats32
from lookdev.brdf import CONTINUOUS_MODELS, sample
from lookdev.brdf.mixture import Mixture
from lookdev.brdf.table import NumberTable
from lookdev.checks.evaluate import Batch, evaluate_numpy, parse_batches, point_table
from lookdev.codegen.glsl.functions import PRELUDE, TABLE_WIDTH, function_lines
from lookdev.codegen.points import PointLayer, point_bsdf, point_columns
from lookdev.codegen.program.writer import ProgramWriter
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.lobes import WI, WO, assume_positive, present_lobes
from lookdev.codegen.trace.symbolic import elements_of, symbol, symbols

ORACLES = [path for path in sorted((Path(__file__).parents[1] / "oracles").glob("*.jsonl")) if path.stem != "fresnel"]
U = (0.3125, 0.71875)
SHADER = """{head}float u1 = {u1}, u2 = {u2};
{declared}
{prelude}
{functions}
void main() {{
    {read}
    if ({two_sided} && wo_z < 0.0) {{
        wo_x = -wo_x; wo_y = -wo_y; wo_z = -wo_z;
        wi_x = -wi_x; wi_y = -wi_y; wi_z = -wi_z;
    }}
    result = vec4(0.0);
    if (wo_z > 0.0 && ({transmits} ? wi_z != 0.0 : wi_z > 0.0)) {{
        {call}
    }}
}}
"""
EVALUATE = "vec3 f; float pdf; look_evaluate(f, pdf); result = vec4(f / abs(wi_z), pdf);"
DRAW = "vec3 wi; look_draw(wi); result = vec4(wi, 0.0);"


@dataclass(frozen=True)
class Functions:
    """The text of functions, the symbols that it reads as variables of the same names, and its tables.

    ``void look_evaluate(out vec3 f, out float pdf)`` sets the BSDF times the cosine, and the density, for light along
    ``wi_x wi_y wi_z``. ``void look_draw(out vec3 wi)`` draws a direction by ``u1 u2``. Both read ``wo_x wo_y wo_z``,
    above the horizon. Table `k` is a ``sampler2D look_table<k>`` with rows of `TABLE_WIDTH` numbers.
    """

    text: str
    symbols: frozenset[str]
    tables: tuple[NumberTable, ...]
    two_sided: bool
    transmits: bool


def point_functions(layers: Sequence[PointLayer]) -> Functions:
    """Return the functions of a stack of layers, whose inputs are symbols named by `point_columns`.

    Raises
    ------
    CodegenError
        The stack scatters along single directions.
    """
    graph = Graph()
    bsdf = point_bsdf(graph, layers)
    lobes = present_lobes(graph, bsdf)
    mixture, writer = Mixture(lobes, symbols(graph, WO)), ProgramWriter()
    assume_positive(graph, mixture.wo[..., 2])
    value, pdf = mixture.response(symbols(graph, WI))
    direction = mixture.draw(symbol(graph, "u1"), symbol(graph, "u2"))
    for name, result in {"f": value, "pdf": pdf, "wi": direction}.items():
        writer.add(name, elements_of(result))
    evaluate = function_lines(writer, "look_evaluate(out vec3 f, out float pdf)")
    draw = function_lines(writer, "look_draw(out vec3 wi)")
    transmits = any(lobe.transmits or lobe.crosses_surface for lobe in lobes)
    text = "\n".join([*evaluate, *draw]) + "\n"
    return Functions(text, frozenset(writer.symbols), tuple(writer.tables), bsdf.two_sided, transmits)


def table_texels(table: NumberTable) -> Floats32:
    """Return the texture of a table, (rows, `TABLE_WIDTH`)."""
    numbers = np.asarray(table.values, np.float32).ravel()
    texels = np.zeros((-(-len(numbers) // TABLE_WIDTH), TABLE_WIDTH), np.float32)
    texels.ravel()[: len(numbers)] = numbers
    return texels


def quick(batches: Sequence[Batch]) -> list[Batch]:
    """Return up to four batches of each model, over all its tokens, and a frequent stack of two and of three layers.

    A batch is a program; those of other tokens consist of the same operations.
    """
    stacks = [batch for batch in batches if 1 < len(batch.layers) < 4 and len(batch.wo) > 20]
    selected = list({len(batch.layers): batch for batch in reversed(stacks)}.values())
    for model in {batch.layers[0].model for batch in batches}:
        single = [batch for batch in batches if len(batch.layers) == 1 and batch.layers[0].model == model]
        selected += single[:: max(1, len(single) // 3)]
    return selected


def picture(batch: Batch, call: str) -> Picture:
    """Return the picture whose pixels have the results of a call of the functions, at the points of a batch."""
    functions, columns = point_functions(batch.layers), point_columns(batch.layers)
    tables = {f"look_table{number}": table_texels(table) for number, table in enumerate(functions.tables)}
    fragment = SHADER.format(
        head=POINTS,
        declared="\n".join([*(f"uniform sampler2D {name};" for name in tables), *(f"float {n};" for n in columns)]),
        prelude=PRELUDE,
        functions=functions.text,
        read=read_columns({name: k for k, name in enumerate(columns)}, len(columns)),
        call=call,
        u1=U[0],
        u2=U[1],
        two_sided=str(functions.two_sided).lower(),
        transmits=str(functions.transmits).lower(),
    )
    return Picture(fragment, point_table(batch), tables)


@pytest.mark.parametrize(
    ("name", "whole"),
    [
        # In the default tier the Explorer compares measured data, in test_the_browser_computes_what_python_does.
        *(pytest.param(path.stem, False, marks=[pytest.mark.proof] * (path.stem == "measured")) for path in ORACLES),
        *(pytest.param(name, True, marks=pytest.mark.proof) for name in ("classic", "pixar_stacks")),
    ],
)
def test_glsl_agrees_with_the_models(name: str, whole: bool, tab: Any) -> None:
    """The error is below 2e-4 in 99 % of the channels, relative to f, or to 1e-3 where f is smaller."""
    oracle = next(path for path in ORACLES if path.stem == name)
    batches = [batch.round_to_float32() for batch in parse_batches(oracle.read_text().splitlines())]
    batches = batches if whole else quick(batches)
    assert batches
    differences: dict[str, list[Any]] = {}
    for batch, result in zip(batches, draw_pictures(tab, [picture(batch, EVALUATE) for batch in batches]), strict=True):
        f, density = evaluate_numpy(batch)
        expected = np.concatenate([f, density[:, None]], axis=-1)
        name = batch.layers[0].model if len(batch.layers) == 1 else "stack"
        differences.setdefault(name, []).append(np.abs(result - expected) / np.maximum(np.abs(expected), 1e-3))
    for model, values in differences.items():
        together = np.concatenate(values).ravel()
        assert np.isfinite(together).all(), model
        assert np.quantile(together, 0.99) < 2e-4, (model, np.quantile(together, [0.5, 0.9, 0.99, 1.0]))


def test_directions_are_drawn_as_by_the_models(tab: Any) -> None:
    """This holds for reflecting models and views from above, except where float32 selects another lobe.

    The normalisation of Torrance and Sparrow's models does not change directions.
    """
    oracles = [path.read_text() for path in ORACLES if path.stem in ("disney", "classic")]
    lines = [line for text in oracles for line in text.splitlines() if '"normalisation": "pi"' not in line]
    batches = quick([batch.round_to_float32() for batch in parse_batches(lines)])
    differences = []
    for batch, result in zip(batches, draw_pictures(tab, [picture(batch, DRAW) for batch in batches]), strict=True):
        above = np.flatnonzero((batch.wo[:, 2] > 0.0) & (batch.wi[:, 2] > 0.0))
        expected = sample(batch.bsdf(), batch.wo, np.tile(U, (len(batch.wo), 1)))
        differences.append(np.abs(result[:, :3] - expected)[above].max(axis=-1))
    together = np.concatenate(differences)
    assert len(together) > 500
    assert np.quantile(together, 0.99) < 2e-4


def test_every_continuous_model_has_cases() -> None:
    models = {json.loads(line)["model"] for path in ORACLES for line in path.read_text().splitlines()}
    assert set(CONTINUOUS_MODELS) <= models
