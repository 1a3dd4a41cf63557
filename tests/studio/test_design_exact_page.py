"""The exact picture on the page of `lookdev design`, in headless Chromium: in place, by a wipe, as a difference."""

from __future__ import annotations

import logging
import shutil
from collections.abc import Iterator

import numpy as np
import pytest
from served import Served, served
from test_design_page import NEEDS_CHROMIUM, ROOT, Page, start_browser

log = logging.getLogger(__name__)

pytestmark = [pytest.mark.mitsuba, NEEDS_CHROMIUM]

_KEY = "dispatchEvent(new KeyboardEvent('keydown', {key: given[0]})); await pause(50);"
_COLUMN = (
    "const column = (share) => { const pixels = new Uint8Array(4 * viewport.canvas.height);"
    "viewport.gl.bindFramebuffer(viewport.gl.FRAMEBUFFER, null);"
    "viewport.gl.readPixels(Math.floor(share * viewport.canvas.width), 0, 1, viewport.canvas.height, viewport.gl.RGBA,"
    " viewport.gl.UNSIGNED_BYTE, pixels); return [...pixels].join(); };"
)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    look = shutil.copy(ROOT / "materials" / "frosted_plastic.usda", tmp_path_factory.mktemp("looks"))
    with served("suzanne", "--material", str(look), verb="design") as started:
        yield started


@pytest.fixture(scope="module")
def page(server: Served) -> Iterator[Page]:
    for browser in start_browser():
        page = Page(browser, server.url)
        page.wait("exact.round || exact.problem")
        yield page


def test_the_exact_picture_follows_an_edit(page: Page) -> None:
    assert "Mitsuba" in page.js("done(at('exact-facts').textContent)")
    page.slide("roughness", 0.9)
    first = page.js("done(exact.round)")
    assert first is None or first["number"] >= 1
    page.wait("exact.round?.samples >= 2 && exact.asked?.version === viewport.version")
    facts = page.js("done(at('exact-facts').textContent)")
    assert "samples" in facts
    assert "noise" in facts


def test_turning_ends_it_at_once(page: Page) -> None:
    page.wait("exact.round")
    assert (
        page.js("at('lighting').value = 30; at('lighting').dispatchEvent(new Event('input')); done(exact.round)")
        is None
    )
    page.wait("exact.round")


def test_the_wipe_stands_where_keys_put_it(page: Page) -> None:
    page.js(_KEY + "done()", "w")
    page.wait("exact.round?.samples >= 8")
    assert page.js("done([at('wipe').hidden, document.querySelector('input[name=mode]:checked').value])") == [
        False,
        "wipe",
    ]
    # Light behind the asset is the same in both pictures: the column of the asset's middle is not.
    before = page.js(
        _COLUMN + "viewport.settings.most = 1; await pause(300); viewport.draw(viewport.last); done(column(0.47));"
    )
    put = (
        "const key = () => new KeyboardEvent('keydown', {key: 'ArrowLeft', bubbles: true});"
        "for (let k = 0; k < 5; k++) at('wipe').dispatchEvent(key());"
    )
    after = page.js(
        _COLUMN + put + "viewport.draw(viewport.last); done([column(0.47), at('wipe').getAttribute('aria-valuenow')]);"
    )
    assert after[1] == "40"
    assert after[0] != before


def test_the_difference_is_named(page: Page) -> None:
    page.js(_KEY + "done()", "d")
    shares = []
    for _ in range(2):
        page.wait("exact.round && exact.compared?.round.number >= 3 && exact.compared.samples >= 8")
        shares.append(page.js("done([exact.compared.apart, exact.compared.indirect, exact.compared.rest])"))
        named = page.js("done(at('difference').textContent)")
        assert "interreflection" in named
        # What the asset reflects adds light.
        assert shares[-1][1] > 0.0
        assert shares[-1][0] >= abs(sum(shares[-1][1:]))
        assert ("cast shadow" in named) == (len(shares) == 2)
        page.js(_KEY + "exact.compared = null; done()", "h")
    # Light from behind shines through the head where nothing shadows it; else both have the same direct light.
    assert shares[1][2] < -0.3
    assert abs(shares[0][2]) < 0.1 * abs(shares[1][2])
    page.js(_KEY + "done()", "v")
    assert page.js("await pause(400); done([exact.asked, at('difference').hidden])") == [None, True]


def test_a_light_is_turned_up_and_nothing_compiles(page: Page) -> None:
    page.js("exact.limit = () => {}; viewport.settings.most = 4; viewport.change(); done();")
    before, compiled = page.mean(), page.js("done(viewport.programs.compiled)")
    page.js(
        "at('lights').open = true; const input = at('light-list').querySelector('input[type=range]');"
        "input.value = 1; input.dispatchEvent(new Event('input')); done();"
    )
    page.wait("lights.lights[0].stops === 1 && !lights.busy")
    np.testing.assert_allclose(page.mean(), 2.0 * before, rtol=1e-5)
    page.js("const on = at('light-list').querySelector('input[type=checkbox]'); on.click(); done();")
    page.wait("!lights.lights[0].on && !lights.busy")
    assert page.mean().max() == 0.0
    page.js("at('lights-reset').click(); done();")
    page.wait("lights.lights[0].on && !lights.busy && at('lights-reset').disabled")
    np.testing.assert_allclose(page.mean(), before, rtol=1e-5)
    assert page.js("done(viewport.programs.compiled)") == compiled
    unnamed = page.js(
        "done([...document.querySelectorAll('input, select, button')].filter((each) => !each.labels?.length"
        " && !each.getAttribute('aria-label') && !each.textContent).map((each) => each.outerHTML));"
    )
    assert unnamed == []


def test_a_picture_that_takes_long_always_gets_finer(page: Page) -> None:
    scales = page.js(
        "const scales = [], seen = (event) => scales.push(event.detail.scale);"
        "viewport.addEventListener('picture', seen);"
        "viewport.settings.most = 1; Object.assign(viewport, {scale: 4, rate: 0.01}); viewport.change();"
        "while (scales.at(-1) !== 1) await pause(20);"
        "viewport.removeEventListener('picture', seen); done(scales);"
    )
    assert scales == [16, 8, 4, 2, 1]


LOOKS = ("car_paint", "brushed_metal", "frosted_plastic")
CELLS = [
    *((asset, look) for asset in ("sphere", "shaderball") for look in LOOKS),
    *(("parts", look) for look in ("own_red", "racing", "workshop")),
]


@pytest.mark.proof
@pytest.mark.parametrize(("asset", "look"), CELLS)
def test_the_difference_of_a_cell_by_name(asset: str, look: str) -> None:
    """The table of docs/designer.md: `pytest -m proof tests/studio/test_design_exact_page.py --log-cli-level=INFO`."""
    of_job = asset == "parts"
    job = ROOT / "jobs" / "parts.toml"
    arguments = [str(job)] if of_job else [asset, "--material", str(ROOT / "materials" / f"{look}.usda")]
    with served(*arguments, verb="design") as started:
        for browser in start_browser():
            page = Page(browser, started.url)
            browser.set_script_timeout(900)
            if of_job:
                page.js(
                    "at('look').value = given[0]; at('look').dispatchEvent(new Event('change'));"
                    "await pause(1000); while (!at('status').textContent.includes('sRGB')) await pause(50); done();",
                    look,
                )
            page.js("exact.choose('difference'); done();")
            page.wait(
                "exact.round?.samples >= 256 && exact.compared?.samples >= 256 && exact.compared.round.samples >= 256"
            )
            apart, indirect, rest, noise = page.js(
                "done([exact.compared.apart, exact.compared.indirect, exact.compared.rest,"
                " Math.sqrt(exact.compared.round.relmse)]);"
            )
    log.info(
        "%s %s: mean %.1f %%, interreflection %+.2f %%, rest %+.2f %%, noise of a pixel %.1f %%",
        *(asset, look, 100 * apart, 100 * indirect, 100 * rest, 100 * noise),
    )
    # A sphere does not light itself, unless it transmits.
    alone = asset == "sphere" and look != "frosted_plastic"
    assert indirect == pytest.approx(0.0, abs=1e-3) if alone else indirect > 0.0
    assert abs(rest) < 0.02
