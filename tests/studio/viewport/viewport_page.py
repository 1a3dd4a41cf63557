"""The viewport in a tab of Chromium: a plain server of its modules, of a scene's data and of its buffers."""

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from chromium import Page

from lookdev.arrays import Floats32
from lookdev.studio.viewport import SceneView

STATIC = Path(str(files("lookdev") / "studio" / "viewport" / "static"))
PAGE = """<!doctype html><meta charset="utf-8"><title>viewport</title><link rel="icon" href="data:,">
<style>body { margin: 0; background: #222 } canvas { display: block }</style><canvas></canvas>
<script type="module">
import { Viewport } from "/static/viewport.js";
import * as cameras from "/static/camera.js";
const fetchBuffer = async (name) => (await fetch(`/buffers/${name}`)).arrayBuffer();
window.cameras = cameras;
window.viewport = new Viewport(document.querySelector("canvas"), fetchBuffer);
window.show = async () => viewport.show(await (await fetch("/scene.json")).json());
window.ready = true;
</script>
"""


class ViewportPage(Page):
    """A page of the viewport alone."""

    def __init__(self, browser: Any, folder: Path, url: str) -> None:
        self._folder = folder
        (folder / "buffers").mkdir()
        (folder / "index.html").write_text(PAGE, encoding="utf-8")
        super().__init__(browser, f"{url}/index.html", (800, 600), "window.ready", timeout=900)

    def show(self, view: SceneView) -> None:
        for key, data in view.buffers.items():
            (self._folder / "buffers" / key).write_bytes(data)
        (self._folder / "scene.json").write_text(json.dumps(view.data), encoding="utf-8")
        self.js("await show(); await viewport.waitForPicture()")

    def accumulate(self, count: int) -> Floats32:
        """Return the means (H, W, 4) of this number of samples."""
        data = b""
        while not data:  # in calls that are shorter than what the driver waits for
            data = self.bytes(
                "viewport.set({maxSamples: given[0]});"
                "return await Promise.race([viewport.accumulate(given[0]), pause(30000)])",
                count,
            )
        return np.frombuffer(data, "<f4").reshape(self.js("return viewport.canvas.height"), -1, 4)
