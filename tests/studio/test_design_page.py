"""`lookdev design` in headless Chromium: picture, layers, notices about files; and its server's answers."""

import json
import re
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from chromium import new_tab
from design_page import DesignPage
from served import Served, start_server

from lookdev.material.usd import read_look


@pytest.fixture(scope="module")
def write_look(
    car_paint: Callable[[Path], Path], white_job: Callable[[Path, str, str], Path]
) -> Callable[[Path], Path]:
    """Return a function that writes car paint, with matt flakes and dust, and a job of it beside it."""

    def write(folder: Path) -> Path:
        look = car_paint(folder)
        disney = r'("(?:Flakes|Dust)"\s+{\s+uniform token info:id = "Lookdev)Disney".*?(?=\n +token)'
        matt = r'\1Lambert"\n        color3f inputs:reflectance = (0.3, 0.2, 0.1)'
        text, count = re.subn(disney, matt, look.read_text(), flags=re.DOTALL)
        assert count == 2
        look.write_text(text)
        white_job(folder, "plane", look.name)
        return look

    return write


@pytest.fixture(scope="module")
def look(tmp_path_factory: pytest.TempPathFactory, write_look: Callable[[Path], Path]) -> Path:
    return write_look(tmp_path_factory.mktemp("looks"))


@pytest.fixture(scope="module")
def server(look: Path) -> Iterator[Served]:
    with start_server(str(look.with_name("job.toml")), verb="design") as started:
        yield started


@pytest.fixture(scope="module")
def open_page(tab: Any, server: Served) -> DesignPage:
    return DesignPage(tab, server.url)


@pytest.fixture
def page(open_page: DesignPage, look: Path) -> Iterator[DesignPage]:
    """Return the page; what a test edits is undone afterwards, and its size and the file are as they were."""
    text = look.read_text()
    yield open_page
    open_page.resize(560, 260)
    assert open_page.js(
        "await frames(2);"
        "while (!at('undo').disabled) { at('undo').click(); await pause(0); await designer.settle(); }"
        "await answered();"
        "if (!at('save').disabled) await saved(); return layers();"
    ) == ["Base", "Flakes", "Dust"]
    assert look.read_text() == text


@pytest.mark.both_pythons
def test_a_slider_shows_at_once_and_compiles_nothing(page: DesignPage) -> None:
    before = page.mean()
    assert page.slide("roughness", 0.9) == 0
    assert np.abs(page.mean() - before).max() > 1e-3
    page.js("at('undo').click(); await answered()")
    np.testing.assert_allclose(page.mean(), before, atol=1e-6)


def test_a_parameter_that_was_not_stated_compiles_while_the_picture_stays(page: DesignPage) -> None:
    assert page.slide("sheen", 0.75) > 0
    assert page.slide("sheen", 0.25) == 0


def test_the_hand_orbits_turns_the_light_and_picks(page: DesignPage) -> None:
    azimuth, lighting, picked = page.js(
        "const canvas = at('picture'), box = canvas.getBoundingClientRect();"
        "const send = (type, x, more) => canvas.dispatchEvent(new PointerEvent(type, {pointerId: 1, bubbles: true,"
        " clientX: box.x + x, clientY: box.y + 50, ...more}));"
        "canvas.setPointerCapture = () => {};"
        "const drag = (more) => {"
        " send('pointerdown', 50, more); send('pointermove', 80, more); send('pointerup', 80, {}); };"
        "drag(); const azimuth = viewport.camera.azimuth - viewport.scene.data.camera.azimuth;"
        "viewport.setCamera(viewport.scene.data.camera);"
        "drag({shiftKey: true}); const lighting = [viewport.settings.lighting, at('lighting').value];"
        "typed(at('lighting'), 0, 'input'); await viewport.waitForPicture();"
        "const { path } = viewport.pick(viewport.canvas.width / 2, viewport.canvas.height / 2);"
        "return [azimuth, lighting, path];"
    )
    assert (azimuth, lighting, picked) == (pytest.approx(-12.0), [12, "12"], "/plane")


def test_the_page_names_what_the_picture_leaves_out(page: DesignPage) -> None:
    # A plane casts no shadow on itself.
    left_out, disabled, title = page.js(
        "return [at('left-out').textContent, at('shadows').disabled, at('shadows').parentElement.title]"
    )
    assert ("interreflection" in left_out, disabled, "convex" in title) == (True, True, True)


def test_a_preset_is_added_while_the_picture_stays(page: DesignPage) -> None:
    assert page.js(
        "at('layer-add').click(); await until(() => at('adding').open && at('adding-presets').childElementCount > 60);"
        "typed(at('adding-search'), 'rust', 'input');"
        "const choice = at('adding-presets').querySelector('button'), image = choice.querySelector('img');"
        "await until(() => image.naturalWidth > 1);"
        "const before = viewport.scene; choice.click(); await until(() => layers().length === 4);"
        "return [image.naturalWidth, layers(), before !== viewport.scene,"
        " document.querySelector('[aria-current=true]').id, at('undo').title];"
    ) == [56, ["Base", "Flakes", "Dust", "Rust"], True, "layer-3", "Undo: add rust (Ctrl+Z)"]


def test_enter_adds_the_first_that_is_found_and_escape_none(page: DesignPage) -> None:
    assert page.js(
        "at('layer-1').focus(); key('layer-1', 'a'); await until(() => at('adding').open);"
        "const closed = new Promise((done) => at('adding').addEventListener('close', done, {once: true}));"
        "at('adding').close('cancel'); await closed; await answered(); const none = layers().length;"
        "key('layer-1', 'a'); await until(() => at('adding').open && at('adding-presets').childElementCount > 1);"
        "typed(at('adding-search'), 'gold', 'input'); key('adding-search', 'Enter');"
        "await until(() => layers().length === 4); return [none, layers()[3]];"
    ) == [3, "Gold"]


def test_a_parameter_takes_an_expression_and_is_taken_back_by_a_key(page: DesignPage) -> None:
    assert page.js(
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
        "key('p-0-sheen', 'Delete'); await until(() => !stated()); states.push(at('undo').title);"
        "at('undo').click(); await until(stated); states.push(at('p-0-sheen.amount').value);"
        "at('p-0-sheen-unstate').click(); await until(() => !stated());"
        "at('p-0-sheen-more').click(); return states;"
    ) == ["expression dirt * amount", "0.5", "Undo: Base sheen back to its default (Ctrl+Z)", "0.75"]


def test_the_stack_is_worked_by_keys(page: DesignPage) -> None:
    moved, focus, doubled, renamed, numbers, up, removed, last = page.js(
        "const states = []; const note = async (met) => { await until(met); states.push(layers().join(' ')); };"
        "const pressed = (id) => at(id).getAttribute('aria-pressed');"
        "at('layer-2').focus(); key('layer-2', 'ArrowDown', {altKey: true}); await note(() => layers()[1] === 'Dust');"
        "await answered(); states.push(document.activeElement.id);"
        "key('layer-1', 'd', {ctrlKey: true}); await note(() => layers().length === 4); await answered();"
        "at('layer-2').focus(); key('layer-2', 'F2'); const input = document.querySelector('.renaming');"
        "input.value = 'Grime'; input.dispatchEvent(new KeyboardEvent('keydown', {key: 'Enter', bubbles: true}));"
        "await note(() => layers()[2] === 'Grime');"
        "key('layer-2', 'm'); await until(() => pressed('layer-mute-2') === 'false');"
        "key('layer-2', 's'); await until(() => pressed('layer-solo-2') === 'true');"
        "states.push(Object.keys(viewport.scene.looks[0].numbers).join(' '));"
        "key('layer-2', 's'); await until(() => pressed('layer-solo-2') === 'false');"
        "key('layer-2', 'ArrowUp'); states.push(document.activeElement.id);"
        "key('layer-3', 'ArrowDown'); key('layer-2', 'Delete'); await note(() => layers().length === 3);"
        "await answered(); states.push(document.activeElement.id); return states;"
    )
    assert (moved, focus) == ("Base Dust Flakes", "layer-1")
    assert (doubled, renamed) == ("Base Dust Dust2 Flakes", "Base Dust Grime Flakes")
    assert {name.partition("_")[0] for name in numbers.split()} == {"layer0"}
    assert (up, removed, last) == ("layer-3", "Base Dust Flakes", "layer-1")


def test_layers_are_dragged(page: DesignPage) -> None:
    assert page.js(
        "const row = (k) => document.querySelector(`.layer-row[data-number='${k}']`), data = new DataTransfer();"
        "const send = (k, type) => row(k).dispatchEvent(new DragEvent(type, {bubbles: true, cancelable: true,"
        " dataTransfer: data}));"
        "send(1, 'dragstart'); send(2, 'dragover'); send(2, 'drop'); await until(() => layers()[2] === 'Flakes');"
        "await answered();"
        "send(2, 'dragstart'); const onBase = !send(0, 'dragover'); send(0, 'drop'); await answered();"
        "return [layers(), onBase, document.querySelector('[aria-current=true]').id];"
    ) == [["Base", "Dust", "Flakes"], False, "layer-2"]


def test_a_mask_is_an_expression_and_says_what_is_wrong_with_it(page: DesignPage) -> None:
    wrong, title = page.js(
        "at('layer-1').click(); typed(at('mask-kind'), 'expression'); typed(at('mask-expression'),"
        " 'smothstep(dirt, edge, .7)', 'input');"
        "const source = (name) => document.querySelector(`.mask input[data-name=${name}]`);"
        "typed(source('dirt'), 'textures/dirt.png', 'input'); typed(source('edge'), '0.25', 'input');"
        # The list is drawn anew while the server answers: neither typed text nor an error message is lost.
        "at('mask-apply').click(); at('layer-0').click(); at('layer-1').click();"
        "await until(() => document.querySelector('.problem:not([hidden])'));"
        "const wrong = document.querySelector('.problem').textContent;"
        "typed(at('mask-expression'), 'smoothstep(dirt, edge, .7)', 'input'); at('mask-apply').click();"
        "await until(() => document.querySelector('.tag')?.textContent === 'expression');"
        "typed(document.querySelector('[data-parameter=\"mask.edge\"] input'), '0.5');"
        "await until(() => at('undo').title.includes('mask.edge'));"
        "return [wrong, document.querySelector('.tag').title];"
    )
    assert "did you mean 'smoothstep'" in wrong
    assert title == "mask: smoothstep(dirt, edge, .7)"


def test_a_layer_is_copied_and_pasted_as_usd_text(page: DesignPage) -> None:
    assert page.js(
        "let text = ''; Object.defineProperty(navigator, 'clipboard', {configurable: true, value: {"
        "writeText: async (given) => { text = given; }, readText: async () => text}});"
        "at('layer-1').click(); at('layer-1').focus(); document.dispatchEvent(new ClipboardEvent('copy',"
        " {bubbles: true, cancelable: true})); await until(() => text);"
        "const clipboardData = new DataTransfer(); clipboardData.setData('text/plain', text);"
        "document.dispatchEvent(new ClipboardEvent('paste', {bubbles: true, cancelable: true, clipboardData}));"
        "await until(() => layers().length === 4); at('layer-paste').click(); await until(() => layers().length === 5);"
        "return [text.slice(0, 9), layers()];"
    ) == ["#usda 1.0", ["Base", "Flakes", "Dust", "Flakes2", "Flakes3"]]


def test_a_variant_is_chosen(page: DesignPage) -> None:
    page.js("typed(at('variant-wear'), 'dusty');")
    page.wait("at('layer-mute-2').getAttribute('aria-pressed') === 'false'")
    assert page.js("return viewport.scene.looks.length") == 1


def test_a_parameter_that_is_still_moved_is_kept_within_two_seconds(page: DesignPage) -> None:
    in_time, undoes, compiled = page.js(
        "at('layer-0').click(); const slider = document.querySelector('[data-parameter=roughness] input');"
        "const compiled = viewport.programs.compiled, fetched = window.fetch; let sent = false, late = false;"
        "window.fetch = (...asked) => { sent ||= asked[0] === 'edit'; return fetched(...asked); };"
        "setTimeout(() => { late = true; }, 2000);"  # a timer like the page's own, late by as much where others work
        "for (let k = 0; !sent && !late; k += 1) { typed(slider, 0.5 + 0.001 * k, 'input'); await pause(50); }"
        "const inTime = sent; window.fetch = fetched; await designer.settle();"
        "const { undoes } = await (await fetch('status?whole')).json();"
        "typed(slider, 0.9); await until(() => !at('undo').disabled); await answered();"
        "return [inTime, undoes, viewport.programs.compiled - compiled];"
    )
    assert (in_time, undoes, compiled) == (True, "Base roughness", 0)


def test_snapshots_are_compared_and_gone_back_to(page: DesignPage) -> None:
    assert page.js(
        "const before = at('compare').textContent; at('snapshot').click();"
        "await until(() => at('compare').textContent !== before);"
        "at('layer-2').focus(); key('layer-2', 'Delete'); await until(() => layers().length === 2);"
        "at('compare').click(); await until(() => at('comparing').open);"
        "const image = at('left').querySelector('img'); await until(() => image.complete && image.naturalWidth);"
        "const wide = image.naturalWidth === at('picture').width; at('left').querySelector('.show').click();"
        "await until(() => layers().length === 3); return [wide, at('undo').title.replace(/\\d+/, 'N')];"
    ) == [True, "Undo: go back to snapshot N (Ctrl+Z)"]


@pytest.mark.parametrize(("width", "height"), [(1366, 768), (390, 844)])
def test_the_page_fits(width: int, height: int, page: DesignPage) -> None:
    page.resize(width, height)
    wide, high, unnamed = page.js(
        "await frames(2); at('layer-1').click(); const root = document.documentElement;"
        "const outside = [...document.querySelectorAll('header *, #layers *')].filter((each) =>"
        " each.getBoundingClientRect().right > root.clientWidth + 1).length;"
        "return [root.scrollWidth - root.clientWidth + outside, root.scrollHeight - root.clientHeight, unnamed()];"
    )
    assert (wide, unnamed) == (0, [])
    assert high == 0 or width < 760


def test_a_file_that_changed_on_disk_is_a_notice_and_a_question(page: DesignPage, look: Path) -> None:
    text = look.read_text()
    page.js("key('layer-2', 'Delete'); await until(() => layers().length === 2)")
    look.write_text(text.replace("inputs:specular = 0.5", "inputs:specular = 0.25"))
    notice, conflict_text = page.js(
        "await until(() => at('changed')); const notice = at('changed').textContent; at('save').click();"
        "await until(() => at('conflict').open); const named = at('conflict-files').textContent;"
        "at('conflict').querySelector('[value=load]').click();"
        "await until(() => !at('changed') && layers().length === 3); return [notice, named];"
    )
    assert "You have unsaved edits of it" in notice
    assert conflict_text == str(look)
    page.js("at('undo').click(); await until(() => layers().length === 2); await saved()")
    assert len(read_look(look, variants={"wear": "dusty"}).layers) == 2
    assert "specular = 0.25" not in look.read_text()


def test_unsaved_work_is_offered_after_a_crash(
    browser: Any, tmp_path: Path, write_look: Callable[[Path], Path]
) -> None:
    look = write_look(tmp_path)
    with new_tab(browser):
        with start_server(str(look.with_name("job.toml")), verb="design") as server:
            page = DesignPage(browser, server.url)
            page.js("key('layer-1', 'Delete'); await until(() => layers().length === 2)")
            server.end(signal.SIGKILL)
            page.wait("at('status').textContent.includes('does not answer')")
            assert "What was edited is kept" in page.js("return at('status').textContent")
        with start_server(str(look.with_name("job.toml")), verb="design") as again:
            page = DesignPage(browser, again.url)
            assert "car_paint.usda" in page.js("return at('recovery').textContent")
            assert page.js(
                "const before = layers(); at('recovery-restore').click(); await until(() => layers().length === 2);"
                "await answered(); return [before, layers(), at('undo').title, at('recovery')];"
            ) == [["Base", "Flakes", "Dust"], ["Base", "Dust"], "Undo: restore unsaved work (Ctrl+Z)", None]
            again.end()
            again.wait_for("unsaved edits are kept: the same command offers them")


def test_a_request_of_another_site_or_of_no_sense_is_refused(server: Served) -> None:
    for path in ("/edit", "/stack", "/history", "/disk", "/snapshots", "/picture", "/save", "/choose"):
        assert server.ask(path, "POST", b"{}", Origin="http://elsewhere.example")[0] == 403
        assert server.ask(path, "POST", b"{}", Host="elsewhere.example")[0] == 403
        assert server.ask(path, "POST", b"nonsense")[0] == 422
    for path in ("/scene", "/status", "/presets", "/presets/dust", "/images?look=0", "/snapshots/1"):
        assert server.ask(path, Host="elsewhere.example")[0] == 403
    for path, body, message in (
        ("/edit", {"look": 0, "layer": 0, "parameter": "roughness", "value": 9}, "roughness"),
        ("/choose", {"look": "plastic", "rig": "wihte"}, "'white'"),
    ):
        status, answer, _ = server.ask(path, "POST", json.dumps(body).encode())
        assert (status, message in json.loads(answer)["error"]) == (422, True)
    outside = ("/viewport/../../document.py", "/viewport/%2e%2e/view.py", "/../document.py")
    for path in (*outside, "/presets/..%2f..%2fpyproject.toml"):
        assert server.ask(path)[0] == 404
    for path in ("/buffers/none", "/presets/none", "/snapshots/99", "/snapshots/x"):
        assert server.ask(path)[0] == 404


def test_a_picture_has_a_limit_of_its_own_and_nothing_else_has(server: Served) -> None:
    png, before = b"\x89PNG\r\n\x1a\n", len(server.json("/status?whole")["snapshots"])
    status, body, _ = server.ask("/picture", "POST", png + bytes(1 << 20))
    assert (status, len(json.loads(body)["snapshots"])) == (200, before + 1)
    status, body, _ = server.ask("/picture", "POST", png + bytes(5 << 20))
    assert (status, "at most 4 MiB" in json.loads(body)["error"]) == (422, True)
    assert server.ask("/stack", "POST", b"[" * 60000)[0] == 422
    assert server.ask("/save", "POST", b" " * (1 << 20) + b'{"over": true}')[0] == 422
