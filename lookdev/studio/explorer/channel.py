"""The messages of one page: requests over its websocket, and their answers, which threads compute.

A request is a JSON object with an ``id``, a ``slot``, and the name ``do`` of the computation. A later request of the
same slot replaces one that has not begun: while a slider moves, positions that it has passed are not computed. An
answer has the id; it is JSON or a packet of arrays (`lookdev.studio.packets`).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import fields
from functools import partial

from starlette.websockets import WebSocket

from lookdev.errors import LookdevError, shorten
from lookdev.plotting import PlotOptions, kind_named
from lookdev.plotting.sampling import sampling_note
from lookdev.safe_text import TextError, parse_json
from lookdev.studio.explorer import shading, usd
from lookdev.studio.explorer.frames import ExactFrames
from lookdev.studio.explorer.surfaces import Surfaces
from lookdev.studio.packets import packet
from lookdev.studio.websocket import PageSocket, SocketMessage, Ticket, log

_MOST_WAITING = 64
_MOST_LOGGED = 20
_AT_ONCE = 3
"""Number of requests of one page that are computed at the same time."""


class Refused(LookdevError):
    """A message is not a valid request."""


class ExplorerConnection:
    """The server's end of one websocket: it reads requests and answers them, until the page is gone."""

    def __init__(
        self,
        socket: WebSocket,
        surfaces: Surfaces,
        frames: ExactFrames,
        threads: ThreadPoolExecutor,
        rendering: ThreadPoolExecutor,
    ) -> None:
        self._socket = PageSocket(socket, frames.cancel)
        self._surfaces = surfaces
        self._frames = frames
        self._threads = threads
        self._rendering = rendering  # plots do not wait for frames
        self._waiting: dict[str, dict[str, object]] = {}
        self._arrived = asyncio.Event()
        self._refusals = 0

    async def run(self) -> None:
        """Serve the page; a message that is not a valid request is refused, and does not end the websocket."""
        for _ in range(_AT_ONCE):
            self._socket.start_task(self._work())
        await self._socket.serve(self._take)

    async def _take(self, text: object) -> None:
        try:
            request = _request(text)
        except LookdevError as error:
            await self._refuse(str(error))
            return
        match request["do"]:
            case "cancel":
                self._socket.cancel()
            case "render":
                self._socket.start_task(self._render(request, self._socket.replace_ticket()))
            case _:
                self._enqueue(request)

    def _enqueue(self, request: dict[str, object]) -> None:
        slot = str(request["slot"])
        self._waiting.pop(slot, None)
        if len(self._waiting) >= _MOST_WAITING:
            self._waiting.pop(next(iter(self._waiting)))
        self._waiting[slot] = request
        self._arrived.set()

    async def _work(self) -> None:
        while True:
            await self._arrived.wait()
            if not self._waiting:
                self._arrived.clear()
                continue
            request = self._waiting.pop(next(iter(self._waiting)))
            compute = partial(_DO[str(request["do"])], self._surfaces, request)
            await self._socket.answer(request, compute, self._threads)

    async def _render(self, request: Mapping[str, object], ticket: Ticket) -> None:
        loop = asyncio.get_running_loop()

        def report(state: dict[str, object]) -> None:
            with suppress(RuntimeError):  # the loop has ended
                asyncio.run_coroutine_threadsafe(self._socket.send({"id": request["id"], "progress": state}), loop)

        def compute() -> SocketMessage:
            look = self._surfaces.rendered_look(_text_value(request, "surface"))
            facts, arrays = self._frames.render(look, ticket, report)
            return packet({"id": request["id"], **facts}, arrays)

        await self._socket.answer(request, compute, self._rendering)

    async def _refuse(self, problem: str) -> None:
        self._refusals += 1
        if self._refusals <= _MOST_LOGGED:
            more = "; further ones are not logged" if self._refusals == _MOST_LOGGED else ""
            log.warning("refused a message: %s%s", shorten(problem, 160), more)
        await self._socket.send({"error": problem})


def _request(text: object) -> dict[str, object]:
    """Return the request in a message; raise LookdevError if the message is not a valid request."""
    if not isinstance(text, str):
        raise Refused("a message of bytes; JSON would be right")
    try:
        request = parse_json(text, "message")
    except TextError as error:
        raise Refused(str(error)) from None
    if not isinstance(request, dict):
        raise Refused("a JSON object would be right")
    if request.get("do") not in (*_DO, "render", "cancel"):
        raise Refused(f"do is {shorten(repr(request.get('do')), 40)}; one of {', '.join(_DO)} would be right")
    if isinstance(request.get("id"), bool) or not isinstance(request.get("id"), int) or request["id"] < 0:
        raise Refused("id: a whole number would be right")
    if not isinstance(request.setdefault("slot", ""), str) or len(request["slot"]) > 200:
        raise Refused("slot: a short text would be right")
    return request


def _text_value(request: Mapping[str, object], key: str, default: str | None = None) -> str:
    value = request.get(key, default)
    if not isinstance(value, str):
        raise Refused(f"{key}: a text would be right")
    return value


def parse_options(data: object) -> PlotOptions:
    """Return the options of a plot from JSON data; raise LookdevError if they are not valid."""
    if not isinstance(data, dict):
        raise Refused("options: an object would be right")
    defaults = {option.name: option.default for option in fields(PlotOptions)}
    values = dict(data)
    for name, value in data.items():
        if name not in defaults:
            raise Refused(f"options: no '{shorten(str(name), 40)}'")
        default = defaults[name]
        if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if type(value) is not type(default) or value != value:  # NaN
            raise Refused(f"options: {name} is {shorten(repr(value), 40)}; {default!r} would be right")
        values[name] = value
    return PlotOptions(**values)


def _values(surfaces: Surfaces, request: Mapping[str, object]) -> SocketMessage:
    kind, options = _text_value(request, "kind"), parse_options(request.get("options", {}))
    kind_named(kind)
    plot_values = surfaces.values(
        kind, _text_value(request, "surface"), options, request.get("draft") is True, _text_value(request, "moving", "")
    )
    header: dict[str, object] = {"id": request["id"]}
    if "test" in plot_values:
        header["note"] = sampling_note(plot_values)
    return packet(header, plot_values)


def _describe(surfaces: Surfaces, request: Mapping[str, object]) -> SocketMessage:
    return {"id": request["id"], **surfaces.describe(_text_value(request, "surface"))}


def _shader(surfaces: Surfaces, request: Mapping[str, object]) -> SocketMessage:
    extra = request.get("live", [])
    if not isinstance(extra, list) or not all(isinstance(name, str) for name in extra):
        raise Refused("live: a list of names would be right")
    header, tables = shading.shader(surfaces, _text_value(request, "surface"), extra)
    return packet({"id": request["id"], **header}, tables)


def _pairs(surfaces: Surfaces, request: Mapping[str, object]) -> SocketMessage:
    return packet({"id": request["id"]}, shading.pairs(surfaces, _text_value(request, "surface")))


def _dome(surfaces: Surfaces, request: Mapping[str, object]) -> SocketMessage:
    return packet({"id": request["id"]}, shading.dome())


def _usd(surfaces: Surfaces, request: Mapping[str, object]) -> SocketMessage:
    return {"id": request["id"], "text": usd.usd_text(surfaces, _text_value(request, "surface"))}


def _command(surfaces: Surfaces, request: Mapping[str, object]) -> SocketMessage:
    words = request.get("surfaces", [])
    if not isinstance(words, list) or not all(isinstance(surface, str) for surface in words):
        raise Refused("surfaces: a list of texts would be right")
    text = surfaces.command(_text_value(request, "kind"), words, parse_options(request.get("options", {})))
    return {"id": request["id"], "text": text}


_DO: dict[str, Callable[[Surfaces, Mapping[str, object]], SocketMessage]] = {
    "values": _values,
    "describe": _describe,
    "shader": _shader,
    "pairs": _pairs,
    "dome": _dome,
    "usd": _usd,
    "command": _command,
}
"""The computations of a request, by the name ``do``; rendering and cancelling are apart."""
