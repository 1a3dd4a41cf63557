"""The Designer's list of layers in headless Chromium: by buttons, by keys, by drag, and what it says of files."""

from __future__ import annotations

import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from served import Served, served
from test_design_page import NEEDS_CHROMIUM, Page, start_browser

from lookdev.material.usd import read_look

pytestmark = NEEDS_CHROMIUM

ROOT = Path(__file__).parents[2]
HELPERS = (
    "const shown = () => [...document.querySelectorAll('.layer-row')].map((row) => row.querySelector('.name span')"
    ".textContent).reverse();"
    "const key = (id, name, more) => at(id).dispatchEvent(new KeyboardEvent('keydown', {key: name, bubbles: true,"
    " cancelable: true, ...more}));"
    "const typed = (element, value, event = 'change') => { element.value = value;"
    " element.dispatchEvent(new Event(event, {bubbles: true})); };"
    "const until = async (met) => { while (!met()) await pause(20); };"
)


@pytest.fixture(scope="module")
def look(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of car paint: flakes and a muted dust over a base."""
    folder = tmp_path_factory.mktemp("looks")
    shutil.copytree(ROOT / "materials" / "textures", folder / "textures")
    return Path(shutil.copy(ROOT / "materials" / "car_paint.usda", folder))


@pytest.fixture(scope="module")
def server(look: Path) -> Iterator[Served]:
    with served("plane", "--material", str(look), verb="design") as started:
        yield started


@pytest.fixture(scope="module")
def opened(server: Served) -> Iterator[Page]:
    for browser in start_browser():
        yield Page(browser, server.url)


@pytest.fixture
def page(opened: Page) -> Iterator[Page]:
    """Return the page, whose edits are undone afterwards."""
    yield opened
    run(
        opened,
        "while (!at('undo').disabled) { at('undo').click(); await pause(150); } done();",
    )
    assert run(opened, "await until(() => shown().length === 3); done(shown());") == ["Base", "Flakes", "Dust"]


def run(page: Page, code: str, *arguments: Any) -> Any:
    return page.js(HELPERS + code, *arguments)


def test_a_preset_is_added_while_the_picture_stays(page: Page) -> None:
    found = run(
        page,
        "at('layer-add').click(); await until(() => at('adding').open && at('adding-presets').childElementCount > 60);"
        "typed(at('adding-search'), 'rust', 'input');"
        "const choice = at('adding-presets').querySelector('button'), image = choice.querySelector('img');"
        "await until(() => image.naturalWidth > 1);"
        "const before = viewport.frames, shownBefore = viewport.scene; choice.click();"
        "await until(() => shown().length === 4);"
        "await viewport.changed(); done([image.naturalWidth, shown(), shownBefore !== viewport.scene,"
        " document.querySelector('[aria-current=true]').id, at('undo').title]);",
    )
    assert found == [56, ["Base", "Flakes", "Dust", "Rust"], True, "layer-3", "Undo: add rust (Ctrl+Z)"]


def test_enter_adds_the_first_that_is_found_and_escape_none(page: Page) -> None:
    assert run(
        page,
        "at('layer-1').focus(); key('layer-1', 'a'); await until(() => at('adding').open);"
        "at('adding').close('cancel'); await pause(100); const none = shown().length;"
        "key('layer-1', 'a'); await until(() => at('adding').open && at('adding-presets').childElementCount > 1);"
        "typed(at('adding-search'), 'gold', 'input');"
        "at('adding-search').dispatchEvent(new KeyboardEvent('keydown', {key: 'Enter', cancelable: true}));"
        "await until(() => shown().length === 4); done([none, shown()[3]]);",
    ) == [3, "Gold"]


def test_a_parameter_takes_an_expression_and_is_taken_back_by_a_key(page: Page) -> None:
    found = run(
        page,
        "at('layer-0').click(); const row = () => document.querySelector('[data-parameter=sheen]');"
        "const stated = () => row().classList.contains('stated');"
        "at('p-0-sheen-more').click(); typed(at('p-0-sheen-source-kind'), 'expression');"
        "typed(at('p-0-sheen-source-expression'), 'dirt * amount', 'input');"
        "typed(document.querySelector('input[data-name=dirt]'), 'textures/dirt.png', 'input');"
        "typed(document.querySelector('input[data-name=amount]'), '.5', 'input');"
        "at('p-0-sheen-source-apply').click(); await until(() => at('undo').title.includes('sheen'));"
        "const states = [row().querySelector('.varies').textContent, at('p-0-sheen.amount').value];"
        "for (const event of ['input', 'change']) typed(at('p-0-sheen.amount'), 0.75, event);"
        "await until(() => at('undo').title.includes('sheen.amount'));"
        "const press = () => at('p-0-sheen').dispatchEvent(new KeyboardEvent('keydown', {key: 'Delete', bubbles: true,"
        " cancelable: true})); press(); await until(() => !stated()); states.push(at('undo').title);"
        "at('undo').click(); await until(stated); states.push(at('p-0-sheen.amount').value);"
        "at('p-0-sheen-unstate').click(); await until(() => !stated());"
        "at('p-0-sheen-more').click(); done(states);",
    )
    assert found == ["expression dirt * amount", "0.5", "Undo: Base sheen back to its default (Ctrl+Z)", "0.75"]


def test_the_stack_is_worked_by_keys(page: Page) -> None:
    found = run(
        page,
        "const states = []; const note = async (met) => { await until(met); states.push(shown().join(' ')); };"
        "at('layer-2').focus(); key('layer-2', 'ArrowDown', {altKey: true}); await note(() => shown()[1] === 'Dust');"
        "states.push(document.activeElement.id);"
        "key('layer-1', 'd', {ctrlKey: true}); await note(() => shown().length === 4);"
        "at('layer-2').focus(); key('layer-2', 'F2'); const input = document.querySelector('.renaming');"
        "input.value = 'Grime'; input.dispatchEvent(new KeyboardEvent('keydown', {key: 'Enter', bubbles: true}));"
        "await note(() => shown()[2] === 'Grime');"
        "key('layer-2', 'm'); await until(() => at('layer-mute-2').getAttribute('aria-pressed') === 'false');"
        "key('layer-2', 's'); await until(() => at('layer-solo-2').getAttribute('aria-pressed') === 'true');"
        "states.push(viewport.scene.looks[0].name, Object.keys(viewport.scene.looks[0].numbers).join(' '));"
        "key('layer-2', 's'); await until(() => at('layer-solo-2').getAttribute('aria-pressed') === 'false');"
        "key('layer-2', 'ArrowUp'); states.push(document.activeElement.id);"
        "key('layer-3', 'ArrowDown'); key('layer-2', 'Delete'); await note(() => shown().length === 3);"
        "states.push(document.activeElement.id); done(states);",
    )
    moved, focus, doubled, renamed, _, numbers, up, removed, last = found
    assert (moved, focus) == ("Base Dust Flakes", "layer-1")
    assert doubled == "Base Dust Dust2 Flakes"
    assert renamed == "Base Dust Grime Flakes"
    assert numbers
    assert all(name.startswith("layer0_") for name in numbers.split())
    assert (up, removed, last) == ("layer-3", "Base Dust Flakes", "layer-1")


def test_layers_are_dragged(page: Page) -> None:
    assert run(
        page,
        "const row = (k) => document.querySelector(`.layer-row[data-number='${k}']`), data = new DataTransfer();"
        "const send = (k, type) => row(k).dispatchEvent(new DragEvent(type, {bubbles: true, cancelable: true,"
        " dataTransfer: data}));"
        "send(1, 'dragstart'); send(2, 'dragover'); send(2, 'drop'); await until(() => shown()[2] === 'Flakes');"
        "send(2, 'dragstart'); const onBase = !send(0, 'dragover'); send(0, 'drop'); await pause(200);"
        "done([shown(), onBase, document.querySelector('[aria-current=true]').id]);",
    ) == [["Base", "Dust", "Flakes"], False, "layer-2"]


def test_a_mask_is_an_expression_and_says_what_is_wrong_with_it(page: Page) -> None:
    found = run(
        page,
        "at('layer-1').click(); typed(at('mask-kind'), 'expression'); typed(at('mask-expression'),"
        " 'smothstep(dirt, edge, .7)', 'input');"
        "const source = (name) => document.querySelector(`.mask input[data-name=${name}]`);"
        "typed(source('dirt'), 'textures/dirt.png', 'input'); typed(source('edge'), '0.25', 'input');"
        "at('mask-apply').click(); await until(() => document.querySelector('.problem:not([hidden])'));"
        "const wrong = document.querySelector('.problem').textContent;"
        "typed(at('mask-expression'), 'smoothstep(dirt, edge, .7)', 'input'); at('mask-apply').click();"
        "await until(() => document.querySelector('.tag')?.textContent === 'expression');"
        "const row = document.querySelector('[data-parameter=\"mask.edge\"] input');"
        "typed(row, '0.5'); await until(() => at('undo').title.includes('mask.edge'));"
        "done([wrong, document.querySelector('.tag').title]);",
    )
    assert "did you mean 'smoothstep'" in found[0]
    assert found[1] == "mask: smoothstep(dirt, edge, .7)"


def test_a_layer_is_copied_and_pasted_as_usd_text(page: Page) -> None:
    found = run(
        page,
        "let text = ''; Object.defineProperty(navigator, 'clipboard', {configurable: true, value: {"
        "writeText: async (given) => { text = given; }, readText: async () => text}});"
        "at('layer-1').click(); at('layer-1').focus(); document.dispatchEvent(new ClipboardEvent('copy',"
        " {bubbles: true, cancelable: true})); await until(() => text);"
        "const clipboardData = new DataTransfer(); clipboardData.setData('text/plain', text);"
        "document.dispatchEvent(new ClipboardEvent('paste', {bubbles: true, cancelable: true, clipboardData}));"
        "await until(() => shown().length === 4); at('layer-paste').click(); await until(() => shown().length === 5);"
        "done([text.slice(0, 9), shown()]);",
    )
    assert found == ["#usda 1.0", ["Base", "Flakes", "Dust", "Flakes2", "Flakes3"]]


def test_a_variant_is_chosen(page: Page) -> None:
    assert (
        run(
            page,
            "typed(at('variant-wear'), 'dusty'); await until(() => at('layer-mute-2').getAttribute('aria-pressed')"
            " === 'false'); done(viewport.scene.looks.length);",
        )
        == 1
    )


def test_a_parameter_that_is_still_moved_is_kept_within_two_seconds(page: Page, server: Served) -> None:
    run(
        page,
        "at('layer-0').click(); const slider = document.querySelector('[data-parameter=roughness] input');"
        "const compiled = viewport.programs.compiled, until2 = performance.now() + 2500;"
        "for (let k = 0; performance.now() < until2; k += 1) { typed(slider, 0.5 + 0.001 * k, 'input');"
        " await pause(100); } window.compiledBefore = compiled; done();",
    )
    status = server.ask("/status?whole")[1]
    assert b'"undoes":"Base roughness"' in status
    assert (
        run(
            page,
            "const slider = document.querySelector('[data-parameter=roughness] input'); typed(slider, 0.9);"
            "await until(() => !at('undo').disabled); await viewport.changed();"
            "done(viewport.programs.compiled - window.compiledBefore);",
        )
        == 0
    )


def test_snapshots_are_compared_and_gone_back_to(page: Page) -> None:
    assert run(
        page,
        "at('snapshot').click(); await until(() => at('compare').textContent.includes('(1)'));"
        "at('layer-2').focus(); key('layer-2', 'Delete'); await until(() => shown().length === 2);"
        "at('compare').click(); await until(() => at('comparing').open);"
        "const image = at('left').querySelector('img'); await until(() => image.complete && image.naturalWidth);"
        "const wide = image.naturalWidth === at('picture').width; at('left').querySelector('.show').click();"
        "await until(() => shown().length === 3); done([wide, at('undo').title]);",
    ) == [True, "Undo: go back to snapshot 1 (Ctrl+Z)"]


@pytest.mark.parametrize(("width", "height"), [(1366, 768), (390, 844)])
def test_the_page_fits(width: int, height: int, page: Page) -> None:
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
    page.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    wide, high, unnamed = run(
        page,
        "await pause(200); at('layer-1').click(); const root = document.documentElement;"
        "const outside = [...document.querySelectorAll('header *, #layers *')].filter((each) =>"
        " each.getBoundingClientRect().right > root.clientWidth + 1).length;"
        "done([root.scrollWidth - root.clientWidth + outside, root.scrollHeight - root.clientHeight,"
        " [...document.querySelectorAll('input, select, button, textarea')].filter((each) => !each.labels?.length"
        " && !each.getAttribute('aria-label') && !each.textContent).map((each) => each.outerHTML)]);",
    )
    small = {"width": 560, "height": 260, "deviceScaleFactor": 1, "mobile": False}
    page.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", small)
    assert (wide, unnamed) == (0, [])
    assert high == 0 or width < 760


def test_a_file_that_changed_on_disk_is_a_notice_and_a_question(page: Page, look: Path) -> None:
    text = look.read_text()
    run(page, "key('layer-2', 'Delete'); await until(() => shown().length === 2); done();")
    look.write_text(text.replace("inputs:specular = 0.5", "inputs:specular = 0.25"))
    found = run(
        page,
        "await until(() => at('changed')); const notice = at('changed').textContent; at('save').click();"
        "await until(() => at('conflict').open); const named = at('conflict-files').textContent;"
        "at('conflict').querySelector('[value=load]').click();"
        "await until(() => !at('changed') && shown().length === 3);"
        "done([notice, named]);",
    )
    assert "You have unsaved edits of it" in found[0]
    assert found[1] == str(look)
    run(
        page,
        "at('undo').click(); await until(() => shown().length === 2); at('save').click();"
        "await until(() => at('status').textContent.startsWith('saved')); done();",
    )
    assert len(read_look(look, variants={"wear": "dusty"}).layers) == 2
    assert "specular = 0.25" not in look.read_text()


def test_unsaved_work_is_offered_after_a_crash(look: Path, server: Served, opened: Page) -> None:
    run(opened, "key('layer-1', 'Delete'); await until(() => shown().length === 2); done();")
    server.end(signal.SIGKILL)
    said = run(
        opened,
        "await until(() => at('status').textContent.includes('does not answer')); done(at('status').textContent);",
    )
    assert "What was edited is kept" in said
    with served("plane", "--material", str(look), verb="design") as again:
        page = Page(opened.browser, again.url)
        assert "car_paint.usda" in run(page, "done(at('recovery').textContent);")
        assert run(
            page,
            "const before = shown(); at('recovery-restore').click(); await until(() => shown().includes('Dust'));"
            "done([before, shown(), at('undo').title, at('recovery')]);",
        ) == [["Base", "Flakes"], ["Base", "Dust"], "Undo: restore unsaved work (Ctrl+Z)", None]
        again.end()
        assert again.says("unsaved edits are kept: the same command offers them")
