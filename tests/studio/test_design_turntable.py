"""The turntable of `lookdev design`: a run in the background, with what is not saved, that can be cancelled."""

import json
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from served import Served, served

from lookdev.output.exr import read_shown

pytestmark = pytest.mark.mitsuba

ROOT = Path(__file__).parents[2]


def ask(server: Served, path: str, **body: Any) -> Any:
    status, data, _ = server.ask(path, "POST" if body else "GET", json.dumps(body).encode() if body else None)
    assert status == 200, data
    return json.loads(data)


def ended(server: Served) -> Any:
    end = time.monotonic() + 120
    while (state := ask(server, "/turntable"))["state"] == "rendering":
        assert time.monotonic() < end, state
        time.sleep(0.05)
    return state


@pytest.fixture
def server(tmp_path: Path, white_job: Callable[[Path, str, str], Path]) -> Iterator[Served]:
    shutil.copy(ROOT / "materials" / "frosted_plastic.usda", tmp_path)
    with served(str(white_job(tmp_path, "suzanne", "frosted_plastic.usda")), verb="design") as started:
        yield started


def test_it_has_unsaved_edits_and_lights_and_a_folder_of_its_own(server: Served, tmp_path: Path) -> None:
    """The first run is cancelled; the second goes on, and the third has a light that is turned up."""
    assert ask(server, "/turntable")["state"] == "none"
    ask(server, "/edit", look=0, layer=0, parameter="roughness", value=0.77)
    ask(server, "/turntable", do="render")
    status, data, _ = server.ask("/turntable", "POST", b'{"do": "render"}')
    assert status == 200 or "cancel it first" in json.loads(data)["error"]
    ask(server, "/turntable", do="cancel")
    assert ended(server)["state"] == "cancelled"
    ask(server, "/turntable", do="render")
    state = ended(server)
    assert (state["state"], state["done"], state["pictures"]) == ("done", 2, [0, 1])
    assert Path(state["output"]) == tmp_path / "out" / "designer" / "plastic" / "white"
    before = read_shown(Path(state["output"]) / "element.0002.exr")
    ask(server, "/lights", light=0, on=True, stops=1.0, color=[1, 1, 1], kelvin=None)
    ask(server, "/turntable", do="render")
    state = ended(server)
    after = read_shown(Path(state["output"]) / "element.0002.exr")
    assert after[0].sum() == pytest.approx(2.0 * before[0].sum(), rel=0.02)
    status, picture, _ = server.ask(f"/turntable/{state['run']}/1.png")
    assert (status, picture[:4]) == (200, b"\x89PNG")
    for path in (f"/turntable/{state['run']}/2.png", "/turntable/1/0.png", f"/turntable/{state['run']}/../job.toml"):
        assert server.ask(path)[0] == 404
