"""How long the viewport takes to show a change: ``pytest -m bench tests/studio/viewport --log-cli-level=INFO``."""

import logging
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from viewport_page import ViewportPage, open_viewport

from lookdev.asset import load_asset
from lookdev.light.dome.maps import load_dome
from lookdev.material.usd import read_look
from lookdev.scene import Scene
from lookdev.studio.viewport import view_scene

pytestmark = pytest.mark.bench

ROOT = Path(__file__).parents[3]
MOST = 0.120
"""Seconds from a slider to the first changed frame at 512 x 512, in software, on two free cores."""

log = logging.getLogger(__name__)


@pytest.fixture(scope="module")
def page(tab: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ViewportPage]:
    with open_viewport(tab, tmp_path_factory.mktemp("viewport")) as page:
        yield page


@pytest.mark.parametrize(("asset", "look"), [("shaderball", "car_paint"), ("sphere", "brushed_metal")])
def test_a_slider_shows_in_time(asset: str, look: str, page: ViewportPage) -> None:
    made = read_look(ROOT / "materials" / f"{look}.usda")
    light = load_dome(builtin="courtyard").dome
    page.show(view_scene(Scene.of_look(load_asset(builtin=asset), made, light, (512, 512))))
    times, scale = page.js(
        "const name = 'layer0_metallic', times = [];"
        "for (let k = 0; k < 40; k++) {"
        "  await pause(150);"
        "  const started = performance.now();"
        "  viewport.setNumbers(0, {[name]: [0.2 + 0.02 * k]});"
        "  await viewport.changed();"
        "  times.push((performance.now() - started) / 1000);"
        "}"
        "return [times, viewport.scale]"
    )
    # The first ones find the scale that is in time.
    median, (load, *_) = float(np.median(times[10:])), os.getloadavg()
    log.info(
        "%s %s: median %.3f s, scale %d, load %.1f on %s cores", asset, look, median, 2**scale, load, os.cpu_count()
    )
    assert median <= MOST
