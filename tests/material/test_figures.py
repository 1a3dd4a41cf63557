"""The figures that ship: what changes from one look to the next is what the paper's figure changes, and no more."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdShade

from lookdev.brdf import MODELS
from lookdev.job import Job, load_job
from lookdev.material.look import Layer
from lookdev.material.usd import expand_variants, read_look

ROOT = Path(__file__).parents[2]
STEPS = np.linspace(0.0, 1.0, 11)


def rows(name: str) -> tuple[Job, dict[str, list[tuple[Layer, ...]]]]:
    """Return the job of a figure, and for each of its looks the layers of each variant."""
    job = load_job(ROOT / "jobs" / f"{name}.toml")
    return job, {
        look.name: [
            read_look(look.material, look.prim, chosen).layers
            for chosen in expand_variants(look.material, look.prim, look.variants)
        ]
        for look in job.look
    }


def preset_inputs(name: str) -> dict[str, float | tuple[float, ...]]:
    stage = Usd.Stage.Open(str(ROOT / "materials" / "presets" / f"{name}.usda"))
    inputs = {each.GetBaseName(): each.Get() for each in UsdShade.Shader(stage.GetDefaultPrim()).GetInputs()}
    return {name: value if isinstance(value, float) else tuple(value) for name, value in inputs.items()}


def test_figure_16_varies_one_parameter_a_row_from_0_to_1() -> None:
    job, figure = rows("figure_16")
    parameters = MODELS["disney"].parameters
    published = {name: each for name, each in parameters.items() if name != "presence" and not each.optional}
    scalars = [name for name, each in published.items() if each.kind == "float"]
    assert list(figure) == scalars  # every one, in the order of the paper's list
    for parameter, looks in figure.items():
        layers = [layer for (layer,) in looks]
        assert [layer.inputs[parameter] for layer in layers] == pytest.approx(STEPS)
        others = [{name: value for name, value in layer.inputs.items() if name != parameter} for layer in layers]
        assert others == others[:1] * len(STEPS)
    assert job.outputs.overview_columns == len(STEPS)


def test_figure_19_turns_one_preset_to_another_in_even_steps() -> None:
    job, figure = rows("figure_19")
    presets = [preset_inputs(name) for name in ("gold", "blue_rubber")]
    (looks,) = figure.values()
    assert [rubber.mask for _, rubber in looks] == pytest.approx(STEPS)
    for look in looks:
        assert [layer.inputs for layer in look] == presets
    assert job.outputs.overview_columns == len(STEPS)
