"""The Designer's server and its browser are killed at random moments of an edit: saved work stays, and unsaved work is
offered, or still there. `test_design_exact.py` kills the renderer.

``pytest -m chaos tests/studio/test_design_chaos.py --log-cli-level=INFO`` takes ten to twenty minutes.
"""

import logging
import os
import random
import shutil
import signal
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from http.client import HTTPException
from pathlib import Path

import numpy as np
import pytest
from chromium import start_browser
from design_page import DesignPage
from served import Served, descendants, start_server

from lookdev.job import load_job
from lookdev.material import Look
from lookdev.material.usd import read_look
from lookdev.studio.designer.open_document import open_document

pytestmark = pytest.mark.chaos

ROOT = Path(__file__).parents[2]
KILLS = 50
MOST_LOST = 2.0  # seconds of unsaved edits
STEP = 0.0005  # of roughness an edit, which numbers the states
log = logging.getLogger(__name__)


@dataclass
class Script:
    """Edits that a client sends in sequence; the roughness of the base is the number of the state."""

    server: Served
    asked: int = 0
    edited: list[float] = field(default_factory=list)  # when each edit was answered
    saved: int = 0  # the last state whose saving was answered
    asked: int = 0  # how often the job was asked for an assign more
    worn: int = 0  # how often it was answered
    kept: int = 0  # assigns of the job whose saving was answered
    counts: Counter[str] = field(default_factory=Counter)

    def run(self) -> None:
        try:
            while True:
                self.asked += 1
                self.send("/edit", look=0, layer=0, parameter="roughness", value=0.2 + STEP * self.asked)
                self.edited.append(time.monotonic())
                if self.asked % 5 == 0:
                    self.send("/stack", look=0, op="rename", layer=1, name=f"Flakes{self.asked}")
                if self.asked % 7 == 0:
                    self.send("/stack", look=0, op="duplicate", layer=1)
                    self.send("/history", redo=False)
                if self.asked % 11 == 0:
                    self.asked += 1
                    # Each pattern fits the part; the number of assigns is the state of the job.
                    prims = [f"/plane{'*' * self.asked}"]
                    self.send("/assign", part="/plane", prims=prims, material="car_paint.usda")
                    self.worn += 1
                if self.asked % 9 == 0:
                    self.send("/save", over=False)
                    self.saved, self.kept = self.asked, self.worn
        except (OSError, HTTPException):
            return

    def send(self, path: str, **body: object) -> None:
        self.server.json(path, **body)
        self.counts[path] += 1


def state_of(look: Look) -> int:
    """Return the number of a state."""
    return round((look.layers[0].inputs["roughness"] - 0.2) / STEP)  # type: ignore[operator]


def assigns_on_disk(job: Path) -> int:
    return len(load_job(job).look[0].assign) if job.exists() else 0


def test_nothing_saved_is_lost_and_at_most_two_seconds_of_the_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    job = tmp_path / "plane.toml"
    rng, lost, counts, offered, in_flight = random.Random(25), [], Counter[str](), 0, 0
    shutil.copytree(ROOT / "materials" / "textures", tmp_path / "textures")
    for number in range(KILLS):
        look = tmp_path / "car_paint.usda"
        shutil.copy(ROOT / "materials" / "car_paint.usda", look)
        job.unlink(missing_ok=True)
        with start_server("plane", "--material", str(look), verb="design", cwd=tmp_path) as server:
            script = Script(server)
            client = threading.Thread(target=script.run)
            client.start()
            time.sleep(rng.uniform(0.1, 5.0))
            killed = time.monotonic()
            server.end(signal.SIGKILL)
            client.join()
        on_disk = state_of(read_look(look)) if script.saved or look.read_text().count("0.42") == 0 else 0
        assert script.saved <= on_disk <= script.asked, number
        assert script.kept <= assigns_on_disk(job) <= script.asked, number
        document = open_document(None, "plane", look, recovers=True)
        if document.status()["recovery"] is not None:
            offered += 1
            document.recover(restore=True)
        state = state_of(document.looks[0]) if script.edited or document.is_unsaved(0) else 0
        on_disk_alone = document.status()["job"]["new"] and job.exists()
        worn = assigns_on_disk(job) if on_disk_alone else len(document.job.look[0].assign)
        assert script.worn <= worn <= script.asked, number
        answered = len(script.edited)
        assert state <= script.asked, number
        in_flight += state > answered
        lost.append(0.0 if state >= answered else killed - script.edited[state])
        assert lost[-1] <= MOST_LOST, number
        counts += script.counts
        if document.status()["recovery"] is None and document.is_unsaved(0):
            document.save()
        document.close()
    log.info("%d kills, %d offers, %s; edits lost: %d", KILLS, offered, dict(counts), sum(map(bool, lost)))
    log.info("lost at most %.2f s", max(lost))
    log.info("%d times an edit was kept whose answer did not arrive", in_flight)


@pytest.mark.browser
def test_a_browser_that_is_killed_loses_at_most_two_seconds_of_a_slider_that_is_held(tmp_path: Path) -> None:
    """The slider moves a step each tenth of a second: its value on the server gives the time of the last move."""
    rng, lost = random.Random(26), []
    shutil.copytree(ROOT / "materials" / "textures", tmp_path / "textures")
    look = Path(shutil.copy(ROOT / "materials" / "car_paint.usda", tmp_path))
    with start_server("plane", "--material", str(look), verb="design", cwd=tmp_path) as server:
        for number in range(KILLS):
            browser = start_browser()
            page = DesignPage(browser, server.url)
            page.js(
                "at('layer-0').click(); const slider = at('p-0-roughness'); let step = 0;"
                "setInterval(() => { step += 1; typed(slider, 0.005 * step, 'input'); }, 100);"
            )
            began = time.monotonic()
            time.sleep(rng.uniform(2.5, 8.0))
            below = descendants(browser.service.process.pid).items()
            os.kill(next(pid for pid, line in below if "--headless" in line and "--type=" not in line), signal.SIGKILL)
            killed = time.monotonic()
            browser.service.stop()
            time.sleep(0.3)  # what was on its way arrives
            rows = server.json("/status?whole")["stacks"][0]["layers"][0]["parameters"]
            value = next(row["value"] for row in rows if row["name"] == "roughness")
            lost.append(killed - began - 0.1 * round(value / 0.005))
            assert lost[-1] <= MOST_LOST, number
    log.info("%d kills; lost of a held slider: median %.2f s, at most %.2f s", KILLS, np.median(lost), max(lost))
