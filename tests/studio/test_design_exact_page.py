"""The exact picture on the page of `lookdev design`, in headless Chromium: in place, by a wipe, as a difference."""

import logging
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from chromium import new_tab
from design_page import CELLS, DesignPage
from served import start_server

log = logging.getLogger(__name__)

pytestmark = pytest.mark.mitsuba

ROOT = Path(__file__).parents[2]
_KEY = "dispatchEvent(new KeyboardEvent('keydown', {key: given[0]}));"
_COLUMN = (
    "const column = (share) => { viewport.draw(viewport.shownFilm);"
    "const pixels = new Uint8Array(4 * viewport.canvas.height);"
    "viewport.gl.bindFramebuffer(viewport.gl.FRAMEBUFFER, null);"
    "viewport.gl.readPixels(Math.floor(share * viewport.canvas.width), 0, 1, viewport.canvas.height, viewport.gl.RGBA,"
    " viewport.gl.UNSIGNED_BYTE, pixels); return [...pixels].join(); };"
)


@pytest.fixture(scope="module")
def exact_page(
    tab: Any, tmp_path_factory: pytest.TempPathFactory, white_job: Callable[[Path, str, str], Path]
) -> Iterator[DesignPage]:
    look = Path(shutil.copy(ROOT / "materials" / "frosted_plastic.usda", tmp_path_factory.mktemp("looks")))
    with start_server(str(white_job(look.parent, "suzanne", look.name)), verb="design") as started:
        page = DesignPage(tab, started.url, mode="exact")
        page.js("viewport.settings.maxSamples = 16")  # else it takes the renderer's time
        yield page


@pytest.fixture
def page(exact_page: DesignPage) -> DesignPage:
    """Return the page in the mode of the exact picture, whatever mode the previous test left."""
    exact_page.js("delete exact.limit; exact.choose('exact')")
    exact_page.wait("exact.round")
    return exact_page


def test_the_exact_picture_follows_an_edit(page: DesignPage) -> None:
    page.wait("at('exact-facts').textContent.includes('Mitsuba')")
    page.slide("roughness", 0.9)
    page.wait("exact.round?.samples >= 2 && exact.request?.version === viewport.version")
    facts = page.js("return at('exact-facts').textContent")
    assert [word for word in ("samples", "noise") if word not in facts] == []


def test_turning_ends_it_at_once(page: DesignPage) -> None:
    assert page.js("typed(at('lighting'), 30, 'input'); return exact.round") is None


def test_the_wipe_stands_where_keys_put_it(page: DesignPage) -> None:
    page.js(_KEY, "w")
    page.wait("exact.round?.samples >= 8")
    mode = "document.querySelector('input[name=mode]:checked').value"
    assert page.js(f"return [at('wipe').hidden, {mode}]") == [False, "wipe"]
    # Light behind the asset is the same in both pictures: the column of the asset's middle is not.
    before = page.js(_COLUMN + "exact.limit = () => {}; viewport.settings.maxSamples = 1; return column(0.47)")
    put = (
        "const key = () => new KeyboardEvent('keydown', {key: 'ArrowLeft', bubbles: true});"
        "for (let k = 0; k < 5; k++) at('wipe').dispatchEvent(key());"
    )
    after, position = page.js(
        _COLUMN + put + "const found = [column(0.47), at('wipe').getAttribute('aria-valuenow')];"
        "delete exact.limit; exact.choose('exact'); return found;"
    )
    assert position == "40"
    assert after != before


def test_the_difference_is_named(page: DesignPage) -> None:
    page.js(_KEY, "d")
    shares = []
    for _ in range(2):
        page.wait("exact.round && exact.comparison?.round.number >= 3 && exact.comparison.samples >= 8")
        shares.append(page.js("return [exact.comparison.apart, exact.comparison.indirect, exact.comparison.rest]"))
        caption = page.js("return at('difference').textContent")
        assert "interreflection" in caption
        # What the asset reflects adds light.
        assert shares[-1][1] > 0.0
        assert shares[-1][0] >= abs(sum(shares[-1][1:]))
        assert ("cast shadow" in caption) == (len(shares) == 2)
        page.js(_KEY + "exact.comparison = null", "h")
    # Light from behind shines through the head where nothing shadows it; else both have the same direct light.
    assert shares[1][2] < -0.3
    assert abs(shares[0][2]) < 0.1 * abs(shares[1][2])
    assert page.js(_KEY + "return [exact.request, at('difference').hidden]", "v") == [None, True]


def test_a_light_is_turned_up_and_nothing_compiles(page: DesignPage) -> None:
    page.js("exact.choose('viewport'); exact.limit = () => {}; viewport.settings.maxSamples = 4; viewport.change()")
    before, compiled = page.mean(), page.js("return viewport.programs.compiled")
    page.js("at('lights').open = true; typed(at('light-list').querySelector('input[type=range]'), 1, 'input')")
    page.wait("lights.lights[0].stops === 1 && !lights.busy")
    np.testing.assert_allclose(page.mean(), 2.0 * before, rtol=1e-5)
    page.js("at('light-list').querySelector('input[type=checkbox]').click()")
    page.wait("!lights.lights[0].on && !lights.busy")
    assert page.mean().max() == 0.0
    page.js("at('lights-reset').click()")
    page.wait("lights.lights[0].on && !lights.busy && at('lights-reset').disabled")
    np.testing.assert_allclose(page.mean(), before, rtol=1e-5)
    assert page.js("return viewport.programs.compiled") == compiled
    assert page.js("delete exact.limit; return unnamed()") == []


def test_a_picture_that_takes_long_always_gets_finer(page: DesignPage) -> None:
    scales = page.js(
        "const scales = [], seen = (event) => scales.push(event.detail.scale);"
        "viewport.addEventListener('picture', seen);"
        "viewport.settings.maxSamples = 1; Object.assign(viewport, {scale: 4, rate: 0.01}); viewport.change();"
        "await until(() => scales.at(-1) === 1);"
        "viewport.removeEventListener('picture', seen); return scales;"
    )
    assert scales == [16, 8, 4, 2, 1]


@pytest.mark.proof
@pytest.mark.parametrize(("asset", "look"), CELLS)
def test_the_difference_of_a_cell_by_name(asset: str, look: str, browser: Any) -> None:
    """The table of docs/designer.md: `pytest -m proof tests/studio/test_design_exact_page.py --log-cli-level=INFO`."""
    of_job = asset == "parts"
    material = str(ROOT / "materials" / f"{look}.usda")
    arguments = (str(ROOT / "jobs" / "parts.toml"),) if of_job else (asset, "--material", material)
    with start_server(*arguments, verb="design") as started, new_tab(browser):
        page = DesignPage(browser, started.url, timeout=900)
        page.js("delete exact.limit")
        if of_job:
            page.js("typed(at('look'), given[0]); await answered()", look)
        apart, indirect, rest, noise = page.difference()
    log.info(
        "%s %s: mean %.1f %%, interreflection %+.2f %%, rest %+.2f %%, noise of a pixel %.1f %%",
        *(asset, look, 100 * apart, 100 * indirect, 100 * rest, 100 * noise),
    )
    # A sphere does not light itself, unless it transmits.
    alone = asset == "sphere" and look != "frosted_plastic"
    assert indirect == pytest.approx(0.0, abs=1e-3) if alone else indirect > 0.0
    assert abs(rest) < 0.02
