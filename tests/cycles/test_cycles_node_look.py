"""Looks as closures in Cycles: as bright as by the exact backend, and none too big for Cycles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from frames import RenderScene
from looks import LOOKS

from lookdev.material import Layer
from lookdev.material.usd import read_look
from lookdev.render.results import Rendered

pytestmark = pytest.mark.cycles

SHEEN = (Layer("sheen", "disney", {"baseColor": (0.0, 0.0, 0.0), "sheen": 1.0, "specular": 0.0}),)
MATERIALS = Path(__file__).parents[2] / "materials"


def mean(frame: Rendered) -> Any:
    picture = (frame.a.astype(np.float64) + frame.b) / 2.0
    return picture[frame.alpha > 0.5].mean(axis=0)


@pytest.mark.parametrize("name", ["coated", "lacquered", "brushed", "sheen"])
def test_white_light_is_reflected_as_by_the_exact_lobes(name: str, render: RenderScene, light_of) -> None:
    layers, options = SHEEN if name == "sheen" else LOOKS[name], {"samples": 64, "size": 32, "bounces": 1}
    exact, nodes = (
        mean(render("sphere", layers, light_of("white"), backend=each, **options)) for each in ("exact", "nodes")
    )
    # The albedo over all views: documented to 1 % for each view. The noise of some 600 pixels is a tenth of that.
    np.testing.assert_allclose(nodes, exact, rtol=0.01)


def test_an_example_of_many_nodes_fits_into_cycles(render: RenderScene, light_of) -> None:
    layers = read_look(MATERIALS / "leaf.usda", None, {}).layers
    frame = render("sphere", layers, light_of("white"), backend="nodes", samples=4, size=16, bounces=1)
    assert mean(frame).min() > 0.01
