"""The viewport in headless Chromium: a plain server of its modules, of a scene's data and of its buffers."""

from __future__ import annotations

import base64
import json
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.append(str(Path(__file__).parents[2] / "codegen"))  # for webgl.py, the tests' browser
from webgl import NEEDS_CHROMIUM, start_browser

from lookdev.studio.viewport import SceneView

__all__ = ["NEEDS_CHROMIUM", "Page", "served", "start_browser"]

STATIC = Path(str(files("lookdev") / "studio" / "viewport" / "static"))
PAGE = """<!doctype html><meta charset="utf-8"><title>viewport</title>
<style>body { margin: 0; background: #222 } canvas { display: block }</style><canvas></canvas>
<script type="module">
import { Viewport } from "/static/viewport.js";
import * as cameras from "/static/camera.js";
const fetched = async (name) => (await fetch(`/buffers/${name}`)).arrayBuffer();
window.cameras = cameras;
window.viewport = new Viewport(document.querySelector("canvas"), fetched);
window.show = async (name) => viewport.show(await (await fetch(`/${name}.json`)).json());
window.ready = true;
</script>
"""


class _Handler(SimpleHTTPRequestHandler):
    extensions_map = {**SimpleHTTPRequestHandler.extensions_map, ".js": "text/javascript"}  # noqa: RUF012

    def translate_path(self, path: str) -> str:
        if path.startswith("/static/"):
            return str(STATIC / path.removeprefix("/static/"))
        return super().translate_path(path)

    def log_message(self, format: str, *args: Any) -> None:
        pass


class Page:
    """The page in a browser; scenes are shown by name."""

    def __init__(self, browser: Any, folder: Path, url: str) -> None:
        self.browser, self._folder = browser, folder
        browser.set_script_timeout(900)
        browser.get(f"{url}/index.html")
        self.js("const wait = () => window.ready ? done() : setTimeout(wait, 20); wait();")

    def js(self, code: str, *arguments: Any) -> Any:
        """Run code that calls ``done``, or an error's."""
        wrapped = (
            "const done = arguments[arguments.length - 1], given = arguments;"
            f"(async () => {{ {code} }})().catch((error) => done({{error: String(error)}}));"
        )
        found = self.browser.execute_async_script(wrapped, *arguments)
        assert not (isinstance(found, dict) and "error" in found), found["error"]
        return found

    def write(self, view: SceneView, name: str = "scene") -> None:
        (self._folder / "buffers").mkdir(exist_ok=True)
        for key, data in view.buffers.items():
            (self._folder / "buffers" / key).write_bytes(data)
        (self._folder / f"{name}.json").write_text(json.dumps(view.data), encoding="utf-8")

    def show(self, view: SceneView, name: str = "scene") -> None:
        self.write(view, name)
        self.js("await show(given[0]); await viewport.changed(); done();", name)

    def accumulated(self, count: int) -> NDArray[np.float32]:
        """Return the means (H, W, 4) of this number of samples."""
        found = None
        while found is None:  # in calls that are shorter than what the driver waits for
            found = self.js(
                "viewport.set({most: given[0]});"
                "const waited = new Promise((resolve) => setTimeout(resolve, 30000, null));"
                "const means = await Promise.race([viewport.accumulated(given[0]), waited]);"
                "if (means === null) { done(null); return; }"
                "const bytes = new Uint8Array(means.buffer); let text = '';"
                "for (let k = 0; k < bytes.length; k += 8192)"
                "  text += String.fromCharCode(...bytes.subarray(k, k + 8192));"
                "done([btoa(text), viewport.canvas.height]);",
                count,
            )
        text, height = found
        return np.frombuffer(base64.b64decode(text), np.float32).reshape(height, -1, 4)


@contextmanager
def served(browser: Any, folder: Path) -> Iterator[Page]:
    """Serve a folder with the page, on loopback, and open it."""
    (folder / "index.html").write_text(PAGE, encoding="utf-8")
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Handler, directory=str(folder)))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield Page(browser, folder, f"http://127.0.0.1:{server.server_address[1]}")
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
