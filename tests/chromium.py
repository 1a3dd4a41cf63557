"""One headless Chromium for the whole test run, and classes and functions for tests of pages in its tabs.

A test that uses the fixture `browser` or `tab` gets the marker ``browser``. It is skipped if Chromium is not installed.
"""

import base64
import shutil
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

# WebGL runs in software, by SwiftShader, because there is no GPU. The last two flags make `gc()` and the exact size of
# the heap available, for tests of memory.
FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--autoplay-policy=no-user-gesture-required", "--js-flags=--expose-gc",
    "--enable-precise-memory-info",
)  # fmt: skip
TIMEOUT = 300  # seconds that a script in a page may take; the limit is long because the machine may be busy

# The JavaScript that `Page.js` runs; LIMIT, HELPERS and CODE are replaced. It calls `done` with an array that has the
# result of CODE, or with an object that has the error.
_WRAPPER = """
const given = arguments, done = arguments[arguments.length - 1];
const at = (id) => document.getElementById(id), pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
const until = async (met) => {
  for (const end = performance.now() + LIMIT; !met(); await pause(10))
    if (performance.now() > end) throw new Error(`not within LIMIT ms: ${met}`);
};
HELPERS
(async () => { CODE })().then((value) => done([value ?? null]), (error) => done({error: String(error)}));
"""


def pytest_itemcollected(item: pytest.Item) -> None:
    """Mark a test that uses the browser."""
    if "browser" in getattr(item, "fixturenames", ()):
        item.add_marker(pytest.mark.browser)


def start_browser() -> Any:
    """Start Chromium and its driver, and return the driver's client.

    Both end with this process, however it ends (see `lifeline.py`), and leave no files behind.
    """
    webdriver = pytest.importorskip("selenium.webdriver", reason="no selenium: pip install -e '.[test]'")
    binary, driver = shutil.which("chromium") or shutil.which("google-chrome"), shutil.which("chromedriver")
    if not (binary and driver):
        pytest.skip("no Chromium with its driver: apt-get install chromium chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = binary
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    for flag in FLAGS:
        options.add_argument(flag)
    service = webdriver.ChromeService(sys.executable, popen_kw={"start_new_session": True})
    lifeline = [str(Path(__file__).with_name("lifeline.py")), driver, f"--port={service.port}"]
    service.command_line_args = lambda: lifeline
    started = webdriver.Chrome(options=options, service=service)
    started.set_script_timeout(TIMEOUT)
    started.command_executor.client_config.timeout = 1000  # seconds, longer than any script takes
    return started


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium for the whole run. A test that ends its browser starts one of its own by `start_browser`."""
    started = start_browser()
    yield started
    started.quit()


@contextmanager
def new_tab(browser: Any) -> Iterator[Any]:
    """Open a tab in a browser; afterwards, close the tab and delete the data that pages have stored."""
    before = browser.current_window_handle
    browser.switch_to.new_window("tab")
    own = browser.current_window_handle
    try:
        yield browser
    finally:
        browser.set_script_timeout(TIMEOUT)
        if own in browser.window_handles:
            browser.switch_to.window(own)
            browser.execute_cdp_cmd("Storage.clearDataForOrigin", {"origin": "*", "storageTypes": "all"})
            browser.close()
        browser.switch_to.window(before)
        browser.get_log("browser")


@pytest.fixture(scope="module")
def tab(browser: Any) -> Iterator[Any]:
    """The browser with a new tab, which the tests of a file share."""
    with new_tab(browser):
        yield browser


class Page:
    """A page in the current tab of a browser. Tests control it by scripts, which may call functions in `helpers`.

    The page is ready when the expression `ready` is true.
    """

    helpers = ""

    def __init__(self, browser: Any, url: str, size: tuple[int, int], ready: str, timeout: int = TIMEOUT) -> None:
        self.browser, self.timeout = browser, timeout
        browser.set_script_timeout(timeout)
        self.resize(*size)
        browser.get("about:blank")  # a URL that differs only after its # would not load the page anew
        browser.get_log("browser")
        browser.get(url)
        self.wait(ready)

    def resize(self, width: int, height: int) -> None:
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
        self.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)

    def js(self, code: str, *arguments: Any) -> Any:
        """Run `code`, the body of an async function, in the page, and return its result.

        In the code, `given` are the arguments, ``until(f)`` waits until f() is true, ``pause(ms)`` waits, and
        ``at(id)`` is the element with an id.
        """
        wrapper = _WRAPPER.replace("LIMIT", str(1000 * (self.timeout - 10))).replace("HELPERS", self.helpers)
        result = self.browser.execute_async_script(wrapper.replace("CODE", code), *arguments)
        assert isinstance(result, list), f"{result['error']}\n{code}"
        return result[0]

    def bytes(self, code: str, *arguments: Any) -> bytes:
        """Return the bytes of a typed array that `code` returns, by base64: numbers as JSON would take long."""
        encoded = self.js(
            f"const array = await (async () => {{ {code} }})(); if (!array) return null;"
            "const bytes = new Uint8Array(array.buffer, array.byteOffset, array.byteLength), parts = [];"
            "for (let k = 0; k < bytes.length; k += 8192)"
            "  parts.push(String.fromCharCode(...bytes.subarray(k, k + 8192)));"
            "return btoa(parts.join(''))",
            *arguments,
        )
        return base64.b64decode(encoded or "")

    def wait(self, condition: str) -> None:
        """Wait until a JavaScript expression is true."""
        self.js(f"await until(() => {condition})")


class _Files(SimpleHTTPRequestHandler):
    """Serves files of a folder, and those of the folder `static` below ``/static/``."""

    extensions_map = {**SimpleHTTPRequestHandler.extensions_map, ".js": "text/javascript"}  # noqa: RUF012

    def __init__(self, *arguments: Any, static: Path | None, **named: Any) -> None:
        self.static = static
        super().__init__(*arguments, **named)

    def translate_path(self, path: str) -> str:
        if self.static and path.startswith("/static/"):
            return str(self.static / path.removeprefix("/static/"))
        return super().translate_path(path)

    def log_message(self, format: str, *args: Any) -> None:
        pass


@contextmanager
def serve_files(folder: Path, static: Path | None = None) -> Iterator[str]:
    """Serve a folder on 127.0.0.1, and the folder `static` as ``/static/``; yield the URL without a final slash."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Files, directory=str(folder), static=static))
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
