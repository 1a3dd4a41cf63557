"""Generated GLSL in headless Chromium against the models in float64, over the oracles' cases."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from webgl import NEEDS_CHROMIUM, POINTS, Floats, at_points, cell_code, start_browser

from lookdev.brdf import CONTINUOUS, sample
from lookdev.checks.evaluate import Batch, batches_of, evaluate_numpy, point_table
from lookdev.codegen.glsl.functions import PRELUDE, Functions, point_functions, table_texels
from lookdev.codegen.points import point_columns

pytestmark = NEEDS_CHROMIUM

ORACLES = [path for path in sorted((Path(__file__).parents[1] / "oracles").glob("*.jsonl")) if path.stem != "fresnel"]
SHADER = """{head}float u1 = {u1}, u2 = {u2};
{declared}
{prelude}
{functions}
void main() {{
    {cell}
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


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    yield from start_browser()


EVALUATE = "vec3 f; float pdf; look_evaluate(f, pdf); result = vec4(f / abs(wi_z), pdf);"
DRAW = "vec3 wi; look_draw(wi); result = vec4(wi, 0.0);"
U = (0.3125, 0.71875)


def run_glsl(browser: Any, batch: Batch, call: str) -> Floats:
    """Return what a call of the functions sets in the browser, (n, 4)."""
    functions, columns = point_functions(batch.layers), point_columns(batch.layers)
    fragment = SHADER.format(
        head=POINTS,
        cell=cell_code(len(columns)),
        declared="\n".join([*_samplers(functions), *(f"float {name};" for name in columns)]),
        prelude=PRELUDE,
        functions=functions.text,
        read="\n".join(f"    {name} = column({k});" for k, name in enumerate(columns)),
        call=call,
        u1=U[0],
        u2=U[1],
        two_sided=str(functions.two_sided).lower(),
        transmits=str(functions.transmits).lower(),
    )
    tables = {f"look_table{number}": table_texels(each) for number, each in enumerate(functions.tables)}
    return at_points(browser, fragment, point_table(batch), tables)


def _samplers(functions: Functions) -> list[str]:
    return [f"uniform sampler2D look_table{number};" for number in range(len(functions.tables))]


@pytest.mark.parametrize("oracle", ORACLES, ids=lambda path: path.stem)
def test_glsl_agrees_with_the_models(oracle: Path, browser: Any) -> None:
    """Relative to f, and where it is small to the thousandth part of the largest: 2e-4 in 99 % of the channels."""
    models: dict[str, list[Any]] = {}
    for line in oracle.read_text().splitlines():
        models.setdefault(json.loads(line)["model"], []).append(line)
    for model, lines in models.items():
        differences = []
        for batch in batches_of(lines):
            rounded = batch.rounded()
            f, density = evaluate_numpy(rounded)
            expected = np.concatenate([f, density[:, None]], axis=-1)
            found = run_glsl(browser, rounded, EVALUATE)
            differences.append((np.abs(found - expected) / np.maximum(np.abs(expected), 1e-3)).ravel())
        together = np.concatenate(differences)
        assert np.isfinite(together).all(), model
        assert np.quantile(together, 0.99) < 2e-4, (model, np.quantile(together, [0.5, 0.9, 0.99, 1.0]))


def test_directions_are_drawn_as_by_the_models(browser: Any) -> None:
    """For reflecting models seen from above; where float32 chooses another lobe, another direction."""
    lines = [line for path in ORACLES if path.stem in ("disney", "classic") for line in path.read_text().splitlines()]
    differences = []
    for batch in batches_of(lines):
        above = np.flatnonzero((batch.wo[:, 2] > 0.0) & (batch.wi[:, 2] > 0.0))
        rounded = batch.rounded()
        drawn = sample(rounded.bsdf(), rounded.wo, np.tile(U, (len(rounded.wo), 1)))
        differences.append(np.abs(run_glsl(browser, rounded, DRAW)[:, :3] - drawn)[above].max(axis=-1))
    together = np.concatenate(differences)
    assert len(together) > 500
    assert np.quantile(together, 0.99) < 2e-4


def test_every_continuous_model_has_cases() -> None:
    known = {json.loads(line)["model"] for path in ORACLES for line in path.read_text().splitlines()}
    assert set(CONTINUOUS) <= known
