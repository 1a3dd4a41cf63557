"""The page of `lookdev design` in a tab of Chromium."""

from typing import Any

import numpy as np
from chromium import TIMEOUT, Page

# The page checks files ten times a second instead of every three seconds, and starts in a given mode: in the mode of
# the viewport, the server starts no renderer. The page has no scene yet when the mode is chosen.
_FIRST = """
const every = window.setInterval;
window.setInterval = (run, ms) => every(run, Math.min(ms, 100));
document.addEventListener("DOMContentLoaded", () => {
  document.querySelector("input[name=mode][value=MODE]").click();
}, {once: true});
"""
_HELPERS = """
const {exact, lights} = window.designer?.panels ?? {};
const layers = () => [...document.querySelectorAll(".layer-row .name span")].map((name) => name.textContent).reverse();
const key = (id, name, more) => at(id).dispatchEvent(
  new KeyboardEvent("keydown", {key: name, bubbles: true, cancelable: true, ...more}));
const typed = (element, value, ...events) => {
  element.value = value;
  for (const event of events.length ? events : ["change"]) element.dispatchEvent(new Event(event, {bubbles: true}));
};
const answered = async () => { await pause(0); await designer.settle(); await viewport.waitForPicture(); };
const frames = async (count) => { for (let k = 0; k < count; k += 1) await new Promise(requestAnimationFrame); };
const saved = async () => {
  at("status").textContent = "";
  at("save").click();
  await until(() => at("status").textContent.startsWith("saved"));
  return at("status").textContent;
};
const unnamed = () => [...document.querySelectorAll("input, select, button, textarea")].filter((input) =>
  !input.labels?.length && !input.getAttribute("aria-label") && !input.textContent).map((input) => input.outerHTML);
"""

# Assets and looks whose pictures docs/designer.md compares.
CELLS = [
    *(
        (asset, look)
        for asset in ("sphere", "shaderball")
        for look in ("car_paint", "brushed_metal", "frosted_plastic")
    ),
    *(("parts", look) for look in ("own_red", "racing", "workshop")),
]

ASSIGN = (
    "const assign = async (part, prims, look) => { typed(at('part'), part); await until(() => at('assign-look'));"
    " at('assign-look').click(); await until(() => at('assigning').open);"
    " const options = [...at('assigning-prims').options];"
    " typed(at('assigning-prims'), options.find((option) => option.text.startsWith(prims)).value, 'input');"
    " typed(at('assigning-search'), look, 'input'); at('assigning-looks').querySelector('button').click();"
    " await until(() => !at('assigning').open); };"
    "const hubs = () => [...at('part').options].filter((option) => option.text.endsWith('Hub')).length;"
    "const partLook = () => at('assignment').querySelector('.assigned-look').textContent;"
)
"""Functions of a script that assigns looks to parts by the page's dialog."""


class DesignPage(Page):
    """The page with a small canvas; `answered` in its scripts waits until the server has answered all requests."""

    helpers = _HELPERS

    def __init__(self, browser: Any, url: str, mode: str = "viewport", timeout: int = TIMEOUT) -> None:
        script = browser.execute_cdp_cmd(
            "Page.addScriptToEvaluateOnNewDocument", {"source": _FIRST.replace("MODE", mode)}
        )
        ready = "window.viewport?.shownFilm && !at('undo').title.startsWith('?') && at('layers').childElementCount"
        super().__init__(browser, url, (560, 260), ready, timeout)
        browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", script)
        if mode == "viewport":  # else it adds up samples, on all cores, as long as it is open
            self.js("exact.limit = () => {}; viewport.settings.maxSamples = 1")

    def mean(self) -> Any:
        """Return the mean colour of some samples."""
        code = (
            "const film = await viewport.accumulate(4), sum = [0, 0, 0];"
            "for (let k = 0; k < film.length; k += 1) if (k % 4 < 3) sum[k % 4] += film[k];"
            "return sum.map((x) => x / (film.length / 4));"
        )
        return np.array(self.js(code))

    def difference(self) -> tuple[float, float, float, float]:
        """Show the difference of 256 samples, and return its mean, interreflection, the rest, and a pixel's noise."""
        self.js("exact.choose('difference')")
        self.wait(
            "exact.round?.samples >= 256 && exact.comparison?.samples >= 256 && exact.comparison.round.samples >= 256"
        )
        code = "const {apart, indirect, rest, round} = exact.comparison; return [apart, indirect, rest, round.relmse]"
        *shares, relmse = self.js(code)
        return (*shares, relmse**0.5)

    def slide(self, parameter: str, value: float) -> int:
        """Move a slider of the base, and return how many programs are compiled until it is shown."""
        compiled: int = self.js(
            "const compiled = viewport.programs.compiled;"
            "at('layer-0').click(); typed(at(`p-0-${given[0]}`), given[1], 'input', 'change');"
            "await until(() => viewport.scene.looks[0].numbers[`layer0_${given[0]}`]?.[0] === given[1]);"
            "await answered(); return viewport.programs.compiled - compiled;",
            parameter,
            value,
        )
        return compiled
