"""The explorer in headless Chromium, served by a process of its own."""

from __future__ import annotations

import base64
import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest
from served import Served, served

from lookdev.plot import Options, read_subject
from lookdev.plot.curves import cartesian_values
from lookdev.plot.maps import slice_values

pytest.importorskip("selenium", reason="selenium is not installed: pip install -e '.[test]'")

from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
pytestmark = [
    pytest.mark.skipif(
        not (CHROMIUM and DRIVER), reason="no Chromium with its driver: apt-get install chromium chromium-driver"
    ),
]


@pytest.fixture(scope="module")
def browser() -> Iterator[webdriver.Chrome]:
    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    # Without a GPU, WebGL is SwiftShader's.
    flags = ("headless=new", "no-sandbox", "disable-dev-shm-usage", "use-angle=swiftshader", "js-flags=--expose-gc")
    for flag in (*flags, "enable-unsafe-swiftshader", "enable-precise-memory-info"):
        options.add_argument(f"--{flag}")
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(str(DRIVER)))
    driver.set_script_timeout(600)
    driver.implicitly_wait(0)
    yield driver
    driver.quit()


SLIDER = "const slider = (name) => document.querySelector(`.parameter:has(#p-${name}) [type=range]`);"
HELD = "s.dispatchEvent(new Event('input', {bubbles: true}));"
RELEASED = "s.dispatchEvent(new Event('change', {bubbles: true}));"


class Page:
    """The explorer in a tab."""

    def __init__(self, browser: webdriver.Chrome, server: Served, state: str = "", size: tuple[int, int] = (1440, 900)):
        self.driver = browser
        metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": size[0] < 600}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        browser.get("about:blank")
        browser.get_log("browser")
        browser.get(f"{server.url}/{state}")
        self.until(lambda: self.js("return document.body.dataset.ready === 'true'"))

    def js(self, code: str, *arguments: Any) -> Any:
        return self.driver.execute_script(code, *arguments)

    def until(self, holds: Callable[[], Any], seconds: float = 60.0) -> Any:
        return WebDriverWait(self.driver, seconds, 0.05).until(lambda _: holds())

    def find(self, selector: str) -> Any:
        return self.driver.find_element(By.CSS_SELECTOR, selector)

    def numbers(self, surface: int = 0, words: str | None = None) -> np.ndarray:
        """Return f of a surface that the page has drawn, with these words, (n, 3)."""
        code = (
            "const s = explorer.state.surfaces[arguments[0]], kept = explorer.plots.cache.get(s.id);"
            "if (!kept || (arguments[1] && JSON.parse(kept.key).surface !== arguments[1])) return null;"
            "return Array.from(kept.data.arrays.f)"
        )
        return np.array(self.until(lambda: self.js(code, surface, words))).reshape(-1, 3)

    def slide(self, name: str, place: float) -> None:
        """Move the slider of a parameter, as a hand does."""
        self.js(f"{SLIDER} const s = slider(arguments[0]); s.value = arguments[1]; {HELD} {RELEASED}", name, place)

    def quiet(self) -> None:
        """Assert that the console has no error."""
        errors = [each["message"] for each in self.driver.get_log("browser") if each["level"] == "SEVERE"]
        assert not errors, errors


def test_a_slider_changes_the_numbers_to_those_of_python(browser: webdriver.Chrome, server: Served) -> None:
    page = Page(browser, server, "#s=disney&kind=cartesian")
    compiled = page.js("return explorer.shaders.compiled")
    page.slide("roughness", 0.2)
    found = page.numbers(words="disney:roughness=0.2")
    expected = cartesian_values(read_subject("disney:roughness=0.2"), Options())["f"]
    assert found == pytest.approx(expected, rel=2e-7)
    page.until(lambda: page.js("return explorer.shaders.compiled > 0"))
    page.slide("metallic", 0.7)
    assert "disney:roughness=0.2,metallic=0.7" in page.until(
        lambda: (
            "metallic" in browser.current_url
            and browser.current_url.replace("%3A", ":").replace("%3D", "=").replace("%2C", ",")
        )
    )
    assert page.js("return explorer.shaders.compiled") <= max(compiled, 1)
    page.quiet()


def test_the_state_is_in_the_url(browser: webdriver.Chrome, server: Served) -> None:
    words = "mine=disney:roughness=0.3,baseColor=0.1/0.2/0.3"
    state = f"#s=lambert&s={quote(words)}&kind=slice&phi=60&on=1&hide=0&exposure=1"
    page = Page(browser, server, state)
    found = page.numbers(1)
    expected = slice_values(read_subject(words), Options(phi=60.0))["f"]
    assert found == pytest.approx(expected.reshape(-1, 3), rel=2e-7)
    assert page.find("#name").text == "mine"
    assert [each.text for each in browser.find_elements(By.CSS_SELECTOR, "#legend li")] == ["mine"]
    assert page.find("#p-roughness").get_attribute("value") == "0.3"
    page.quiet()


def test_the_browser_computes_what_python_does(browser: webdriver.Chrome, server: Served) -> None:
    """On the page's own request, with numbers away from the defaults: continuous models, glass, and measured data."""
    words = ("disney:roughness=.35,clearcoat=1", "pixar:clear=.4", "glass:eta=1.6", "measured:file=builtin:plastic")
    page = Page(browser, server, "?verify#kind=fresnel&" + "&".join(f"s={quote(each)}" for each in words))
    rows = json.loads(page.until(lambda: page.js("return document.body.dataset.verified"), 120.0))
    assert len(rows) == len(words)
    assert all(each["agrees"] for each in rows), rows
    assert all(each["count"] > 4000 for each in rows)
    page.quiet()


@pytest.mark.parametrize("width", [1440, 800, 390])
def test_each_view_draws_and_nothing_overflows(width: int, browser: webdriver.Chrome, server: Served) -> None:
    page = Page(browser, server, "#s=disney&s=lambert&kind=retro&size=24", (width, 900))
    ink = (
        "const c = document.getElementById('plot'), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;"
        "let n = 0; for (let i = 3; i < d.length; i += 4) n += d[i] > 0; return n"
    )
    for kind in page.js("return Object.keys(explorer.state.offered.kinds)"):
        before = page.js("return explorer.plots.drawn")
        page.js("document.getElementById(`kind-${arguments[0]}`).click()", kind)
        page.until(lambda before=before: page.js("return explorer.plots.drawn") > before and page.js(ink) > 500)
        assert not page.js("return document.getElementById('notice').textContent"), kind
    assert page.js("return document.documentElement.scrollWidth") <= width
    page.quiet()


def test_a_difference_waits_for_both_surfaces(browser: webdriver.Chrome, server: Served) -> None:
    page = Page(browser, server, "#s=disney&s=lambert&kind=difference&size=24")
    page.until(lambda: page.js("return explorer.plots.cache.size") == 2)
    notice = "await explorer.plots.paint(); return document.getElementById('notice').textContent"
    assert not page.js(f"explorer.plots.cache.delete(explorer.state.surfaces[1].id); {notice}")
    assert "two surfaces" in page.js(f"explorer.state.surfaces.pop(); {notice}")
    page.quiet()


def test_everything_has_a_name_and_the_keyboard_reaches_it(browser: webdriver.Chrome, server: Served) -> None:
    page = Page(browser, server, "#s=disney&kind=polar")
    nameless = page.js(
        "return [...document.querySelectorAll('button, input, select, canvas')].filter(e => e.offsetParent && !("
        "e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.length || e.getAttribute('aria-labelledby')"
        ")).map(e => e.outerHTML)"
    )
    assert nameless == []
    page.find("#kind-polar").send_keys(Keys.ARROW_RIGHT)
    assert page.js("return document.activeElement.id") == "kind-lobe3d"
    page.find("body").send_keys("1")
    assert page.find("#kind-slice").get_attribute("aria-selected") == "true"
    page.find("body").send_keys("d")
    page.until(lambda: page.js("return explorer.state.surfaces.length") == 2)
    page.find("body").send_keys(Keys.DELETE)
    assert page.js("return explorer.state.surfaces.length") == 1
    page.find("#plot").send_keys(Keys.ARROW_LEFT)
    page.until(lambda: "θh" in page.find("#readout").text)
    page.quiet()


def test_measured_data_are_taken_and_nonsense_is_refused(
    browser: webdriver.Chrome, server: Served, roots: Path, tmp_path: Path
) -> None:
    page = Page(browser, server, "#s=lambert&kind=retro")
    page.js("document.getElementById('file').hidden = false")
    (tmp_path / "notes.txt").write_text("no data")
    page.find("#file").send_keys(str(tmp_path / "notes.txt"))
    page.until(lambda: "notes.txt" in page.find("#status").text)
    page.find("#file").send_keys(str(roots / "satin.dat"))
    page.until(lambda: page.js("return explorer.state.surfaces.length") == 2)
    assert page.find("#name").text == "satin.dat"
    expected = read_subject(str(roots / "satin.dat"))
    found = page.numbers(1)
    assert len(found) > 100
    assert expected.model == "measured"


def test_a_dropped_file_is_taken(browser: webdriver.Chrome, server: Served, roots: Path) -> None:
    page = Page(browser, server, "#s=lambert&kind=retro")
    drop = """const bytes = Uint8Array.from(atob(arguments[0]), (c) => c.charCodeAt(0)), data = new DataTransfer();
    data.items.add(new File([bytes], 'dropped.dat'));
    for (const type of ['dragenter', 'dragover', 'drop']) {
      const event = new DragEvent(type, {dataTransfer: data, bubbles: true, cancelable: true});
      document.getElementById('plot').dispatchEvent(event);
      if (type !== 'dragenter' && !event.defaultPrevented) throw new Error(`${type} is left to the browser`);
    }"""
    page.js(drop, base64.b64encode((roots / "satin.dat").read_bytes()).decode())
    page.until(lambda: page.js("return explorer.state.surfaces.length") == 2)
    assert page.find("#name").text == "dropped.dat"
    assert len(page.numbers(1)) > 100
    page.quiet()


def test_pages_keep_separate_states(browser: webdriver.Chrome, server: Served) -> None:
    first = Page(browser, server, "#s=disney&kind=cartesian")
    tab = browser.current_window_handle
    browser.switch_to.new_window("tab")
    try:
        second = Page(browser, server, "#s=disney&kind=cartesian")
        second.slide("roughness", 0.9)
        second.numbers(words="disney:roughness=0.9")
    finally:
        browser.close()
        browser.switch_to.window(tab)
    assert first.js("return explorer.wordsOf(explorer.state.surfaces[0])") == "disney"
    first.slide("roughness", 0.1)
    first.numbers(words="disney:roughness=0.1")


def test_a_look_is_copied_as_usd_and_a_wrong_word_is_told(browser: webdriver.Chrome, server: Served) -> None:
    page = Page(browser, server, "#s=disney:metal%3Dgold&s=disny&kind=retro")
    assert "did you mean" in page.find("#status").text
    # A metal's name stands for its index; what is moved becomes the surface's own.
    page.slide("roughness", 0.4)
    assert page.js("return explorer.state.surfaces[0].given.eta.length") == 3
    assert not page.js("return 'metal' in explorer.state.surfaces[0].given")
    page.js("navigator.clipboard.writeText = async (text) => { document.body.dataset.copied = text; }")
    page.find("#copy-usd").click()
    text = page.until(lambda: page.js("return document.body.dataset.copied"))
    assert 'info:id = "LookdevDisney"' in text
    assert "inputs:roughness = 0.4" in text


def test_a_frame_can_be_cancelled_fail_and_be_ended(browser: webdriver.Chrome, tmp_path: Path) -> None:
    with served(temporary=tmp_path) as server:
        page = Page(browser, server, "#s=disney:roughness%3D0.05&kind=polar&light=point")

        def begun() -> int:
            page.find("#render").click()
            page.until(lambda: "samples" in page.find("#facts").text, 120.0)
            (worker,) = workers(server.process.pid)
            return worker

        worker = begun()
        os.kill(worker, signal.SIGKILL)
        page.until(lambda: page.find("#facts").text.startswith("the render worker died of SIGKILL"))
        assert page.find("#facts").get_attribute("class") == "bad"

        worker = begun()
        page.find("#cancel").click()
        # Half a second at rest; tests run beside each other.
        page.until(lambda: not workers(server.process.pid), 5.0)
        page.until(lambda: page.find("#facts").text == "cancelled", 5.0)
        assert page.find("#render").is_displayed()
        assert not page.find("#cancel").is_displayed()

        worker = begun()
        assert server.end(signal.SIGINT) == 0
        assert not Path(f"/proc/{worker}").exists()
        assert not list(tmp_path.iterdir())
        assert "Traceback" not in server.log


def workers(above: int) -> list[int]:
    """Return the render workers among the descendants of a process."""
    listed = subprocess.run(["ps", "-eo", "pid=,ppid=,args="], capture_output=True, text=True, check=True).stdout
    rows = [line.split(None, 2) for line in listed.splitlines()]
    family = {above}
    for pid, parent, _ in sorted(rows, key=lambda row: int(row[0])):
        if int(parent) in family:
            family.add(int(pid))
    return [int(pid) for pid, _, words in rows if int(pid) in family and "lookdev.cycles" in words]


@pytest.mark.proof
def test_ten_thousand_moves_take_no_memory(browser: webdriver.Chrome, server: Served) -> None:
    """Heap of the page and memory of the server, after 2000 and after 12,000 moves."""
    Page(browser, server, "#s=disney&s=pixar&kind=slice&light=point")
    move = f"""{SLIDER}
    const [count, done] = arguments;
    (async () => {{
      const names = ['roughness', 'metallic', 'specular'];
      for (let i = 0; i < count; i++) {{
        const s = slider(names[i % 3]);
        s.value = (i % 97) / 97;
        {HELD}
        await new Promise(r => setTimeout(r, 4));
      }}
      await new Promise(r => setTimeout(r, 2000));
      gc(); gc();
      done(performance.memory.usedJSHeapSize);
    }})()"""

    def memory() -> int:
        children = Path(f"/proc/{server.process.pid}/task/{server.process.pid}/children").read_text().split()
        return int(Path(f"/proc/{children[0]}/statm").read_text().split()[1]) * 4096

    heap = browser.execute_async_script(move, 2000)
    server_before = memory()
    for _ in range(10):
        last = browser.execute_async_script(move, 1000)
    found = f"heap {heap / 1e6:.1f} -> {last / 1e6:.1f} MB, server {server_before / 1e6:.0f} -> {memory() / 1e6:.0f} MB"
    print(found)  # noqa: T201  what the test is for
    assert last < heap + 5e6
    assert memory() < server_before + 30e6


@pytest.mark.bench
@pytest.mark.parametrize(("kind", "limit"), [("slice", 60.0), ("cartesian", 30.0), ("polar", 30.0), ("retro", 30.0)])
@pytest.mark.parametrize("model", ["disney", "pixar", "torrance-sparrow"])
def test_a_plot_follows_the_hand(
    kind: str, limit: float, model: str, browser: webdriver.Chrome, server: Served
) -> None:
    """From the slider's event to the drawn plot: 95 % of moves, on a machine that does nothing else.

    When the browser shows what is drawn is told as well: in a window without a GPU it composes on the same cores.
    """
    began = time.perf_counter()
    page = Page(browser, server, f"#s={model}&kind={kind}&light=point")
    page.numbers()
    interactive = time.perf_counter() - began
    move = f"""{SLIDER}
    const [count, done] = arguments;
    (async () => {{
      const s = slider('roughness');
      await new Promise(r => setTimeout(r, 2000));
      explorer.latencies.length = explorer.shown.length = 0;
      for (let i = 0; i < count; i++) {{
        s.value = 0.15 + 0.7 * (i % 97) / 97;
        {HELD}
        await new Promise(r => setTimeout(r, 40));
      }}
      await new Promise(r => setTimeout(r, 500));
      done([explorer.latencies.slice(), explorer.shown.slice()]);
    }})()"""
    taken, shown = map(np.array, browser.execute_async_script(move, 200))
    load = Path("/proc/loadavg").read_text().split()[0]
    found = f"median {np.median(taken):.1f} ms, 95 % {np.quantile(taken, 0.95):.1f} ms of {len(taken)} moves"
    found += f"; in a frame {np.median(shown):.1f}, {np.quantile(shown, 0.95):.1f} ms"
    print(f"{kind} {model}: {found}; interactive after {interactive:.2f} s; load {load}")  # noqa: T201
    assert np.quantile(taken, 0.95) < limit
