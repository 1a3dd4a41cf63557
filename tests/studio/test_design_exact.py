"""The exact pictures of `lookdev design`: rounds over a websocket, by a renderer that stays, or is started anew.

And its turntable: a run in the background, with what is not saved, that can be cancelled.
"""

import json
import logging
import os
import random
import re
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from batch_case import wait_until
from served import Served, start_server
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect

from lookdev.output.exr import read_rec709

pytestmark = pytest.mark.mitsuba

log = logging.getLogger(__name__)
ROOT = Path(__file__).parents[2]
MOST = 0.2
"""Largest median time until a cancelled picture ends, in seconds, on two free cores."""


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory, white_job: Callable[[Path, str, str], Path]) -> Path:
    look = Path(shutil.copy(ROOT / "materials" / "frosted_plastic.usda", tmp_path_factory.mktemp("job")))
    return white_job(look.parent, "suzanne", look.name)


@pytest.fixture(scope="module")
def server(job: Path) -> Iterator[Served]:
    with start_server(str(job), verb="design") as started:
        yield started


class ExactSocket:
    """A page's websocket of exact pictures, and the camera of its view."""

    def __init__(self, server: Served, socket: ClientConnection) -> None:
        self.server, self.socket, self.id = server, socket, 0
        self.camera = server.json("/scene")["camera"]

    def render(self, size: tuple[int, int] = (64, 48), **view: Any) -> None:
        self.id += 1
        body = {"camera": self.camera, "element": 0, "lighting": 0, "size": size, **view}
        self.socket.send(json.dumps({"do": "render", "id": self.id, **body}))

    def next(self) -> dict[str, Any]:
        """Return the next message about the newest picture."""
        while True:
            data = self.socket.recv(timeout=60)
            message = unpack(data) if isinstance(data, bytes) else json.loads(data)
            if message.get("id", self.id) == self.id:
                return message

    def round(self, least: int = 0) -> dict[str, Any]:
        """Return the next round with `least` samples or more."""
        while "samples" not in (round_of_picture := self.next()) or round_of_picture["samples"] < least:
            assert "error" not in round_of_picture, round_of_picture["error"]
        return round_of_picture

    def edit(self, value: float) -> None:
        self.server.json("/edit", look=0, layer=0, parameter="roughness", value=value)

    def roughness(self) -> float:
        """Return the roughness that the server has."""
        base = self.server.json("/scene")["stacks"][0]["layers"][0]
        return next(float(row["value"]) for row in base["parameters"] if row["name"] == "roughness")


def unpack(data: bytes) -> dict[str, Any]:
    length = int.from_bytes(data[:4], "little")
    header, offset = json.loads(data[4 : 4 + length]), 4 + length
    for name, shape in header.pop("arrays"):
        count = int(np.prod(shape))
        header[name] = np.frombuffer(data, "<f4", count, offset).reshape(shape)
        offset += 4 * count
    return header


@pytest.fixture
def talk(server: Served) -> Iterator[ExactSocket]:
    with connect(f"ws://127.0.0.1:{server.port}/exact", max_size=None) as socket:
        yield ExactSocket(server, socket)


def test_rounds_have_more_samples_and_less_error(talk: ExactSocket) -> None:
    talk.render()
    first, later = talk.round(), talk.round(least=32)
    assert first["beauty"].shape == (24, 32, 3)
    assert later["beauty"].shape == (48, 64, 3)
    assert later["relmse"] < first["relmse"] / 4
    assert later["backend"].startswith("Mitsuba")
    # The rest is light that other parts of the asset reflect.
    assert (later["beauty"] >= later["direct"] - 1e-6).all()
    assert later["beauty"].sum() > 1.001 * later["direct"].sum()
    # The halves are independent: the error of their mean agrees with the estimate, within the spread of the estimate.
    truth = talk.round(least=256)["beauty"]
    error = np.mean((later["beauty"] - truth)[later["alpha"] > 0.0] ** 2 / (truth[later["alpha"] > 0.0] ** 2 + 0.01))
    assert 0.4 < error / later["relmse"] < 2.5


@pytest.mark.both_pythons
def test_an_edit_that_is_not_saved_is_seen_by_the_same_renderer(talk: ExactSocket) -> None:
    talk.edit(0.2)
    talk.render()
    before = talk.round(least=8)
    talk.edit(0.9)
    talk.render()
    after = talk.round(least=8)
    assert after["worker"] == before["worker"]
    assert np.abs(after["beauty"] - before["beauty"]).mean() > 3.0 * np.sqrt(after["relmse"]) * 0.01


def test_turns_and_the_camera_are_those_of_the_page(talk: ExactSocket) -> None:
    def alpha(**view: Any) -> Any:
        talk.render(**view)
        return talk.round(least=8)["alpha"]

    front, side = alpha(), alpha(element=90)
    far = alpha(camera={**talk.camera, "distance": 2 * talk.camera["distance"]})
    assert np.abs(side - front).mean() > 0.01
    assert 0.2 < far.sum() / front.sum() < 0.3


def cancel_pictures(talk: ExactSocket, count: int) -> list[float]:
    """Cancel pictures while they are rendered; return the seconds until each had ended."""
    talk.render((640, 480))
    worker, took = talk.round()["worker"], []
    for _ in range(count):
        time.sleep(0.3)
        began = time.perf_counter()
        talk.socket.send('{"do": "cancel"}')
        while "cancelled" not in talk.next():
            pass
        took.append(time.perf_counter() - began)
        talk.render((640, 480))
        assert talk.round()["worker"] == worker
    return took


def test_a_picture_is_cancelled_and_the_renderer_stays(talk: ExactSocket) -> None:
    assert len(cancel_pictures(talk, 1)) == 1


@pytest.mark.bench
def test_a_picture_is_cancelled_in_time(talk: ExactSocket) -> None:
    took = sorted(cancel_pictures(talk, 20))
    log.info("cancelled after %.3f s, the longest %.3f s; load %.1f", took[10], took[-1], os.getloadavg()[0])
    assert took[10] <= MOST


@pytest.mark.bench
def test_an_edit_is_seen_exactly_in_time(talk: ExactSocket) -> None:
    talk.render((640, 480))
    talk.round(least=4)
    took = []
    for k in range(20):
        began = time.perf_counter()
        talk.edit(0.3 + 0.02 * k)
        talk.render((640, 480))
        talk.round()
        took.append(time.perf_counter() - began)
    took.sort()
    log.info("first round after %.3f s, the longest %.3f s; load %.1f", took[10], took[-1], os.getloadavg()[0])
    assert took[10] <= 1.5


@pytest.mark.parametrize(
    "count",
    [pytest.param(2, marks=pytest.mark.proof), pytest.param(50, marks=pytest.mark.chaos)],
    ids=lambda count: f"{count} kills",
)
def test_a_renderer_that_is_killed_at_any_moment_is_started_anew(talk: ExactSocket, count: int) -> None:
    rng = random.Random(5)
    for _ in range(count):
        value = round(0.1 + 0.8 * rng.random(), 3)
        talk.edit(value)
        talk.render()
        worker = talk.round()["worker"]
        time.sleep(0.5 * rng.random())
        if rng.random() < 0.3:
            talk.edit(round(value + 0.05, 3))
            talk.render()
        os.kill(worker, signal.SIGKILL)
        talk.edit(value)
        talk.render()
        assert talk.round()["worker"] != worker
        assert talk.roughness() == pytest.approx(value, rel=1e-6)


def test_the_page_is_told_that_the_renderer_died_and_no_edit_is_lost(talk: ExactSocket) -> None:
    talk.edit(0.35)
    talk.render((640, 480))
    worker = talk.round()["worker"]
    os.kill(worker, signal.SIGKILL)
    while "state" not in (message := talk.next()):
        pass
    assert [word for word in ("SIGKILL", "anew") if word not in message["state"]] == []
    assert talk.round()["worker"] != worker
    assert talk.roughness() == pytest.approx(0.35, rel=1e-6)  # as the file has it, in float32


def test_what_is_no_request_is_refused_and_other_sites_are(talk: ExactSocket, server: Served) -> None:
    for view, message in (
        ({"camera": None}, "a view has a camera"),
        ({"element": "0"}, "finite numbers"),
        ({"size": [64]}, "2 numbers"),
        ({"size": [64, 0]}, "from 1 to 8192 pixels"),
    ):
        talk.render(**view)
        assert message in talk.next()["error"]
    for text in ("{", "[]", '{"do": "render"}', '{"do": "save", "id": 1}', b"\x00"):
        talk.socket.send(text)
        assert "error" in talk.next()
    url = f"ws://127.0.0.1:{server.port}/exact"
    with pytest.raises(InvalidStatus), connect(url, origin="http://elsewhere.example"):  # type: ignore[arg-type]
        pass


@pytest.mark.both_pythons
def test_ctrl_c_ends_the_renderer_too(job: Path, tmp_path: Path) -> None:
    with start_server(str(job), verb="design", temporary=tmp_path) as started:
        with connect(f"ws://127.0.0.1:{started.port}/exact", max_size=None) as socket:
            talk = ExactSocket(started, socket)
            talk.render()
            worker = talk.round()["worker"]
            assert started.end() == 0
        with pytest.raises(ProcessLookupError):
            os.kill(worker, 0)
        assert list(tmp_path.iterdir()) == []
        assert "Traceback" not in started.log


def test_buffers_are_kept_of_the_last_two_scenes_alone(server: Served) -> None:
    def buffers_in(light: str) -> set[str]:
        server.json("/choose", look="plastic", rig=light)
        return set(re.findall(r'"buffer": "(\w+)"', json.dumps(server.json("/scene"))))

    first, second, third = map(buffers_in, ("white", "three_point", "softbox_product"))
    assert [server.ask(f"/buffers/{min(names)}")[0] for names in (first - second - third, second - third, third)] == [
        404, 200, 200,
    ]  # fmt: skip
    buffers_in("white")


def test_a_turntable_has_unsaved_edits_and_lights_and_a_folder_of_its_own(server: Served, job: Path) -> None:
    """The first run is cancelled, the second continues it, and the third has a brighter light."""

    def wait_for_end() -> Any:
        wait_until(lambda: server.json("/turntable")["state"] != "rendering", 120.0)
        return server.json("/turntable")

    assert server.json("/turntable")["state"] == "none"
    server.json("/edit", look=0, layer=0, parameter="roughness", value=0.77)
    server.json("/turntable", do="render")
    status, data, _ = server.ask("/turntable", "POST", b'{"do": "render"}')
    assert status == 200 or "cancel it first" in json.loads(data)["error"]
    server.json("/turntable", do="cancel")
    assert wait_for_end()["state"] == "cancelled"
    pictures = []
    for stops in (0.0, 1.0):
        server.json("/lights", light=0, on=True, stops=stops, color=[1, 1, 1], kelvin=None)
        server.json("/turntable", do="render")
        state = wait_for_end()
        assert (state["state"], state["done"], state["pictures"]) == ("done", 2, [0, 1])
        pictures.append(read_rec709(Path(state["output"]) / "element.0002.exr")[0])
    assert Path(state["output"]) == job.parent / "out" / "designer" / "plastic" / "white"
    assert pictures[1].sum() == pytest.approx(2.0 * pictures[0].sum(), rel=0.02)
    status, picture, _ = server.ask(f"/turntable/{state['run']}/1.png")
    assert (status, picture[:4]) == (200, b"\x89PNG")
    for path in (f"/turntable/{state['run']}/2.png", "/turntable/1/0.png", f"/turntable/{state['run']}/../job.toml"):
        assert server.ask(path)[0] == 404
