"""Parameters of looks found in pictures of them: those that Cycles rendered come back, and what is wrong is said first."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lookdev.batch.fit_picture import PictureFit, Wish, fit_picture
from lookdev.batch.run import render_job
from lookdev.errors import LookdevError
from lookdev.fit.picture import Settings
from lookdev.fit.picture.search import Point
from lookdev.material.change import constant_of
from lookdev.material.library.constants import write_changed
from lookdev.material.usd import read_look

pytestmark = pytest.mark.mitsuba

MATERIALS = Path(__file__).parents[2] / "materials"
DISNEY = """#usda 1.0
(
    defaultPrim = "Paint"
)
def Material "Paint"
{
    token outputs:lookdev:surface.connect = </Paint/Base.outputs:layer>
    def Shader "Base"
    {
        uniform token info:id = "Lookdev@MODEL@"
        @INPUTS@
        token outputs:layer
    }
}
"""
JOB = """
output = "{look}_out"
asset = {{ builtin = "{asset}" }}
[[look]]
name = "paint"
material = "{look}.usda"
[[{kind}]]
name = "light"
builtin = "{light}"
exposure = 0.3
rotation = 20.0
[[turntable]]
kind = "element"
frames = 2
start = 15.0
[camera]
elevation = 15.0
[render]
resolution = [{size}, {size}]
samples = {samples}
bounces = 2
"""


@dataclass(frozen=True)
class Case:
    """A scene, its look before, and the values of the picture, which are to come back."""

    asset: str
    light: str
    look: str
    truth: dict[str, tuple[float, ...]]
    kind: str = "ibl"


def shader(model: str, **inputs: float | tuple[float, float, float]) -> str:
    lines = [
        f"color3f inputs:{name} = {value}" if isinstance(value, tuple) else f"float inputs:{name} = {value}"
        for name, value in inputs.items()
    ]
    return DISNEY.replace("@MODEL@", model).replace("@INPUTS@", "\n        ".join(lines))


CASES = {
    "disney": Case(
        "shaderball", "city", shader("Disney", baseColor=(0.4, 0.4, 0.4), metallic=0.6, roughness=0.6),
        {"baseColor": (0.7, 0.35, 0.12), "metallic": (0.3,), "roughness": (0.35,)},
    ),
    "pixar": Case(
        "suzanne", "three_point", shader("Pixar", surfaceColor=(0.5, 0.5, 0.5), metallic=0.2, roughness=0.3),
        {"surfaceColor": (0.3, 0.5, 0.65), "metallic": (0.7,), "roughness": (0.45,)}, "rig",
    ),
    "ward": Case(
        "sphere", "studio", shader("Ward", diffuse=(0.2, 0.2, 0.2), alphaX=0.3, alphaY=0.3),
        {"diffuse": (0.45, 0.2, 0.3), "alphaX": (0.12,), "alphaY": (0.22,)},
    ),
    "robot_paint": Case(
        "shaderball", "forest", "robot_paint",
        {"Paint.surfaceColor": (0.1, 0.35, 0.5), "Paint.roughness": (0.5,), "Metal.roughness": (0.4,)},
    ),
    "coat": Case(
        "suzanne", "courtyard", shader("Disney", baseColor=(0.3, 0.3, 0.3), roughness=0.8, clearcoat=0.3, sheen=0.2),
        {"baseColor": (0.55, 0.08, 0.06), "roughness": (0.5,), "clearcoat": (0.85,)},
    ),
}  # fmt: skip


def scene(folder: Path, case: Case, size: int, samples: int) -> tuple[Path, Path]:
    """Write the job, and render its second frame with the true values by Cycles; return the job and the picture."""
    before = folder / "before.usda"
    if case.look in ("robot_paint",):
        before = MATERIALS / f"{case.look}.usda"
        write_changed(before, folder / "before.usda", [])
    else:
        before.write_text(case.look)
    look = read_look(before)
    changed = [replace(constant_of(look, name), value=value) for name, value in case.truth.items()]
    write_changed(before, folder / "truth.usda", changed)
    for name in ("before", "truth"):
        text = JOB.format(look=name, asset=case.asset, kind=case.kind, light=case.light, size=size, samples=samples)
        (folder / f"{name}.toml").write_text(text)
    assert render_job(folder / "truth.toml", only=["paint/light/element.0002"]).exit_code == 0
    return folder / "before.toml", folder / "truth_out" / "paint" / "light" / "element.0002.exr"


def errors_of(made: PictureFit, truth: dict[str, tuple[float, ...]]) -> dict[str, float]:
    """Return the largest relative error of each parameter."""
    found = {
        name.rpartition(".")[2] if name.count(".") == 1 else name: each for name, each in made.found.values.items()
    }
    found |= made.found.values
    return {n: float(np.abs(np.array(found[n]) / np.array(value) - 1.0).max()) for n, value in truth.items()}


@pytest.mark.slow
@pytest.mark.cycles
@pytest.mark.parametrize("name", CASES)
def test_parameters_of_pictures_by_cycles_come_back(name: str, llvm: str, tmp_path: Path) -> None:
    case = CASES[name]
    job, picture = scene(tmp_path, case, 128, 64)
    made = fit_picture(
        Wish(
            picture, job, tuple(case.truth), "paint/light/element.0002", tmp_path / "found.usda", tmp_path / "page.html"
        )
    )
    print(made.text())
    assert max(errors_of(made, case.truth).values()) < 0.02, made.text()
    again = read_look(tmp_path / "found.usda")
    for each, value in made.found.values.items():
        assert constant_of(again, each).value == pytest.approx(value, rel=1e-6)
    assert not made.found.undetermined
