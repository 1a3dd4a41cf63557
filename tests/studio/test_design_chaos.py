"""The Designer's server is killed at random moments of a scripted edit: what is saved stays, what is not is offered.

``pytest -m chaos tests/studio/test_design_chaos.py --log-cli-level=INFO`` takes five to ten minutes.
"""

from __future__ import annotations

import json
import logging
import random
import shutil
import signal
import threading
import time
from dataclasses import dataclass, field
from http.client import HTTPException
from pathlib import Path

import pytest
from served import Served, served

from lookdev.material.usd import read_look
from lookdev.studio.designer.opening import open_document

pytestmark = pytest.mark.chaos

ROOT = Path(__file__).parents[2]
KILLS = 50
MOST_LOST = 2.0  # seconds of unsaved edits
STEP = 0.0005  # of roughness an edit, which numbers the states
log = logging.getLogger(__name__)


@dataclass
class Script:
    """Edits that a client sends one after another; each state is numbered by the roughness of the base."""

    server: Served
    asked: int = 0
    edited: list[float] = field(default_factory=list)  # when each edit was answered
    saved: int = 0  # the last state whose saving was answered
    counts: dict[str, int] = field(default_factory=dict)

    def run(self) -> None:
        try:
            while True:
                self.asked += 1
                edit = {"look": 0, "layer": 0, "parameter": "roughness", "value": 0.2 + STEP * self.asked}
                self.send("/edit", edit)
                self.edited.append(time.monotonic())
                if self.asked % 5 == 0:
                    self.send("/stack", {"look": 0, "op": "rename", "layer": 1, "name": f"Flakes{self.asked}"})
                if self.asked % 7 == 0:
                    self.send("/stack", {"look": 0, "op": "duplicate", "layer": 1})
                    self.send("/history", {"redo": False})
                if self.asked % 9 == 0:
                    self.send("/save", {"over": False})
                    self.saved = self.asked
        except (OSError, HTTPException):
            return

    def send(self, path: str, body: object) -> None:
        status, found, _ = self.server.ask(path, "POST", json.dumps(body).encode())
        assert status == 200, found
        self.counts[path] = self.counts.get(path, 0) + 1


def state_of(layers: object) -> int:
    """Return the number of a state."""
    return round((layers[0].inputs["roughness"] - 0.2) / STEP)  # type: ignore[index]


def test_nothing_saved_is_lost_and_at_most_two_seconds_of_the_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LOOKDEV_STATE", str(tmp_path / "state"))
    rng, lost, counts, offered, in_flight = random.Random(25), [], {}, 0, 0
    shutil.copytree(ROOT / "materials" / "textures", tmp_path / "textures")
    for number in range(KILLS):
        look = tmp_path / "car_paint.usda"
        shutil.copy(ROOT / "materials" / "car_paint.usda", look)
        with served("plane", "--material", str(look), verb="design") as server:
            script = Script(server)
            client = threading.Thread(target=script.run)
            client.start()
            time.sleep(rng.uniform(0.1, 5.0))
            killed = time.monotonic()
            server.end(signal.SIGKILL)
            client.join()
        on_disk = state_of(read_look(look).layers) if script.saved or look.read_text().count("0.42") == 0 else 0
        assert script.saved <= on_disk <= script.asked, number
        document = open_document(None, "plane", look, recovers=True)
        if document.status()["recovery"] is not None:
            offered += 1
            document.recover(take=True)
        found = state_of(document.looks[0].layers) if script.edited or document.unsaved(0) else 0
        answered = len(script.edited)
        assert found <= script.asked, number
        in_flight += found > answered
        lost.append(0.0 if found >= answered else killed - script.edited[found])
        assert lost[-1] <= MOST_LOST, number
        counts = {path: counts.get(path, 0) + count for path, count in script.counts.items()} | {
            path: count for path, count in counts.items() if path not in script.counts
        }
        if document.status()["recovery"] is None and document.unsaved(0):
            document.save()
        document.close()
    log.info(
        "%d kills, %d offers, %s; edits lost: %d, at most %.2f s",
        KILLS,
        offered,
        counts,
        sum(map(bool, lost)),
        max(lost),
    )
    log.info("%d times an edit was kept whose answer did not arrive", in_flight)
