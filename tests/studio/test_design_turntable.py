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


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, white_job: Callable[[Path, str, str], Path]) -> Path:
    folder = tmp_path_factory.mktemp("turned")
    shutil.copy(ROOT / "materials" / "frosted_plastic.usda", folder / "plastic.usda")
    white_job(folder, "suzanne", "plastic.usda")
    return folder


@pytest.fixture(scope="module")
def server(folder: Path) -> Iterator[Served]:
    with served(str(folder / "job.toml"), verb="design") as started:
        yield started


def ask(server: Served, path: str, **body: Any) -> dict[str, Any]:
    status, data, _ = server.ask(path, "POST" if body else "GET", json.dumps(body).encode() if body else None)
    assert status == 200, data
    found: dict[str, Any] = json.loads(data)
    return found


def ended(server: Served, until: Callable[[dict[str, Any]], bool] = lambda state: state["state"] != "rendering") -> Any:
    end = time.monotonic() + 120
    while not until(state := ask(server, "/turntable")):
        assert time.monotonic() < end, state
        time.sleep(0.05)
    return state


def test_it_has_unsaved_edits_and_lights_and_a_folder_of_its_own(server: Served, folder: Path) -> None:
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
    assert Path(state["output"]) == folder / "frames" / "designer" / "plastic" / "white"
    before = read_shown(Path(state["output"]) / "element.0002.exr")
    ask(server, "/lights", light=0, on=True, stops=1.0, color=[1, 1, 1], kelvin=None)
    ask(server, "/turntable", do="render")
    state = ended(server)
    after = read_shown(Path(state["output"]) / "element.0002.exr")
    assert after[0].sum() == pytest.approx(2.0 * before[0].sum(), rel=0.02)
    picture = server.ask(f"/turntable/{state['run']}/1.png")
    assert picture[0] == 200
    assert picture[1].startswith(b"\x89PNG")
    for path in (f"/turntable/{state['run']}/2.png", "/turntable/1/0.png", f"/turntable/{state['run']}/../job.toml"):
        assert server.ask(path)[0] == 404
