"""Sections of the template for scenes with a shadow catcher."""

from pathlib import Path

import pytest

from lookdev.codegen.osl.catching import catching_sections
from lookdev.codegen.setting import SourceSetting
from lookdev.light import load_environment, prepare_light
from lookdev.material import Layer, Look
from lookdev.rendering.backends import BACKENDS
from lookdev.scene import Sampling


def osl(catching: str) -> str:
    light = prepare_light(load_environment(builtin="white"))
    setting = SourceSetting((light,), (8, 8), Sampling(), catching=catching, resolve=lambda image: Path())  # type: ignore[arg-type]
    return BACKENDS["exact"].generate(Look("a", (Layer("a", "disney"),)), setting).osl  # type: ignore[attr-defined]


def test_without_a_catcher_the_text_is_that_of_any_scene() -> None:
    text = osl("")
    assert "caught" not in text
    assert "holdout" not in text
    # Digests of frames depend on the text: these sections do not add a line or any other character.
    sections = catching_sections("")
    assert sections == {"catching_parameter": [], "catching": [], "trace": ["        if (trace(start, wi)) {"]}


@pytest.mark.parametrize(("catching", "held_out"), [("ground", "== 1"), ("asset", ">= 2")])
def test_ground_and_asset_leave_holes_for_each_other(catching: str, held_out: str) -> None:
    text = osl(catching)
    assert f"int held_out = int(caught[0]) {held_out};" in text
    assert ("int(caught[0]) != 3 && trace(start, wi)" in text) == (catching == "ground")
