"""`lookdev design` in headless Chromium, and its server's answers."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from served import Served, served

sys.path.append(str(Path(__file__).parents[1] / "codegen"))  # for webgl.py, the tests' browser
from webgl import NEEDS_CHROMIUM, start_browser

from lookdev.material.usd import read_look

pytestmark = NEEDS_CHROMIUM

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def look(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("looks")
    return Path(shutil.copy(ROOT / "materials" / "frosted_plastic.usda", folder))


@pytest.fixture(scope="module")
def server(look: Path) -> Iterator[Served]:
    with served("plane", "--material", str(look), verb="design") as started:
        yield started


class Page:
    """The page, whose canvas is small."""

    def __init__(self, browser: Any, url: str) -> None:
        self.browser = browser
        metrics = {"width": 560, "height": 260, "deviceScaleFactor": 1, "mobile": False}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        browser.set_script_timeout(120)
        browser.get(url)
        self.js(
            "const wait = () => viewport?.last && !document.getElementById('undo').title.startsWith('?')"
            " && document.getElementById('layers').childElementCount ? done() : setTimeout(wait, 50);"
            "const soon = () => window.viewport ? wait() : setTimeout(soon, 50); soon();"
        )

    def js(self, code: str, *arguments: Any) -> Any:
        wrapped = (
            "const done = arguments[arguments.length - 1], given = arguments, pause = (ms) => new Promise((r) => "
            "setTimeout(r, ms)), at = (id) => document.getElementById(id);"
            f"(async () => {{ {code} }})().catch((error) => done({{error: String(error)}}));"
        )
        found = self.browser.execute_async_script(wrapped, *arguments)
        assert not (isinstance(found, dict) and "error" in found), found["error"]
        return found

    def mean(self) -> Any:
        """Return the mean colour of some samples."""
        return np.array(
            self.js(
                "const film = await viewport.accumulated(4), sum = [0, 0, 0];"
                "for (let k = 0; k < film.length; k += 1) if (k % 4 < 3) sum[k % 4] += film[k];"
                "done(sum.map((x) => x / (film.length / 4)));"
            )
        )

    def slide(self, parameter: str, value: float) -> tuple[int, int]:
        """Move a slider of the base; return how many programs were compiled before, and once that is shown."""
        before, after = self.js(
            "const compiled = viewport.programs.compiled;"
            "const slider = document.querySelector(`details[data-layer='0'] [data-parameter='${given[0]}'] input`);"
            "slider.value = given[1];"
            "for (const name of ['input', 'change']) slider.dispatchEvent(new Event(name));"
            "const name = `layer0_${given[0]}`;"
            "while (viewport.scene.looks[0].numbers[name]?.[0] !== given[1]) await pause(20);"
            "await viewport.changed(); done([compiled, viewport.programs.compiled]);",
            parameter,
            value,
        )
        return before, after

    def wait(self, condition: str) -> None:
        self.js(f"while (!({condition})) await pause(20); done();")


@pytest.fixture(scope="module")
def page(server: Served) -> Iterator[Page]:
    for browser in start_browser():
        yield Page(browser, server.url)


def test_a_slider_shows_at_once_and_compiles_nothing(page: Page) -> None:
    before = page.mean()
    compiled, now = page.slide("roughness", 0.9)
    assert now == compiled
    assert np.abs(page.mean() - before).max() > 1e-3
    page.js("at('undo').click(); done();")
    page.wait("viewport.scene.looks[0].numbers.layer0_roughness[0] !== 0.9")
    np.testing.assert_allclose(page.mean(), before, atol=1e-6)


def test_a_parameter_that_was_not_stated_compiles_while_the_picture_stays(page: Page) -> None:
    compiled, now = page.slide("metallic", 0.75)
    assert now > compiled
    assert page.slide("metallic", 0.25) == (now, now)


def test_the_hand_orbits_turns_the_light_and_picks(page: Page) -> None:
    drag = (
        "const canvas = at('picture'), box = canvas.getBoundingClientRect();"
        "const send = (type, x, y, more) => canvas.dispatchEvent(new PointerEvent(type, {pointerId: 1, bubbles: true,"
        " clientX: box.x + x, clientY: box.y + y, ...more}));"
        "canvas.setPointerCapture = () => {};"
    )
    azimuth = page.js(
        drag + "send('pointerdown', 50, 50); send('pointermove', 80, 50); send('pointerup', 80, 50);"
        "done(viewport.camera.azimuth - viewport.scene.data.camera.azimuth);"
    )
    assert azimuth == pytest.approx(-12.0)
    lighting = page.js(
        drag + "send('pointerdown', 50, 50, {shiftKey: true}); send('pointermove', 80, 50, {shiftKey: true});"
        "send('pointerup', 80, 50); done([viewport.settings.lighting, at('lighting').value]);"
    )
    assert lighting == [12, "12"]
    picked = page.js(
        "await viewport.changed(); done(viewport.pick(viewport.canvas.width / 2, viewport.canvas.height / 2));"
    )
    assert picked["path"] == "/plane"


def test_what_is_saved_is_what_was_shown(page: Page, look: Path) -> None:
    page.slide("roughness", 0.5)
    page.wait("!at('save').disabled")
    page.js("at('save').click(); done();")
    page.wait("at('status').textContent.startsWith('saved')")
    assert read_look(look).layers[0].inputs["roughness"] == pytest.approx(0.5)
    assert page.js("done(at('save').disabled)")


def test_the_page_names_what_the_picture_leaves_out(page: Page) -> None:
    assert "interreflection" in page.js("done(at('left-out').textContent)")
    # A plane casts no shadow on itself.
    assert page.js("done([at('shadows').disabled, at('shadows').parentElement.title.includes('convex')])") == [True] * 2
    unnamed = page.js(
        "done([...document.querySelectorAll('input, select, button')].filter((each) => !each.labels?.length"
        " && !each.getAttribute('aria-label') && !each.textContent).map((each) => each.outerHTML));"
    )
    assert unnamed == []


def test_a_request_of_another_site_or_of_no_sense_is_refused(server: Served) -> None:
    edit = json.dumps({"look": 0, "layer": 0, "parameter": "roughness", "value": 9}).encode()
    assert server.ask("/edit", "POST", edit, Origin="http://elsewhere.example")[0] == 403
    assert server.ask("/scene", Host="elsewhere.example")[0] == 403
    status, body, _ = server.ask("/edit", "POST", edit)
    assert (status, "roughness" in json.loads(body)["error"]) == (422, True)
    assert server.ask("/edit", "POST", b"{")[0] == 422
    for path in ("/stack", "/history", "/disk", "/snapshots", "/picture", "/save", "/choose"):
        assert server.ask(path, "POST", b"{}", Origin="http://elsewhere.example")[0] == 403
        assert server.ask(path, "POST", b"{}", Host="elsewhere.example")[0] == 403
        assert server.ask(path, "POST", b"nonsense")[0] == 422
    for path in ("/status", "/presets", "/presets/dust", "/images?look=0", "/snapshots/1"):
        assert server.ask(path, Host="elsewhere.example")[0] == 403
    choice = json.dumps({"look": "own", "rig": "stduio"}).encode()
    assert "'studio'" in json.loads(server.ask("/choose", "POST", choice)[1])["error"]
    for path in ("/buffers/none", "/viewport/../../document.py", "/viewport/%2e%2e/view.py", "/../document.py"):
        assert server.ask(path)[0] == 404
    for path in ("/presets/..%2f..%2fpyproject.toml", "/presets/none", "/snapshots/9", "/snapshots/x"):
        assert server.ask(path)[0] == 404


def test_a_picture_has_a_limit_of_its_own_and_nothing_else_has(server: Served) -> None:
    png = b"\x89PNG\r\n\x1a\n"
    status, body, _ = server.ask("/picture", "POST", png + bytes(1 << 20))
    assert (status, len(json.loads(body)["snapshots"])) == (200, 1)
    status, body, _ = server.ask("/picture", "POST", png + bytes(5 << 20))
    assert (status, "at most 4 MiB" in json.loads(body)["error"]) == (422, True)
    assert server.ask("/stack", "POST", b"[" * 60000)[0] == 422
    assert server.ask("/save", "POST", b" " * (1 << 20) + b'{"over": true}')[0] == 422
