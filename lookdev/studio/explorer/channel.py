"""The websocket of one page of the Explorer, on the server's side: it answers requests, by computations in threads.

A request is a JSON object with an ``id``, a ``slot``, and the name ``do`` of the computation. The slot names what the
answer updates, for example a plot. A later request of the same slot replaces one that has not begun: while a slider
moves, only its newest position is computed. An answer has the id of its request; it is JSON or a packet of arrays
(`lookdev.studio.packets`).
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
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
from lookdev.studio.packets import encode_packet
from lookdev.studio.websocket import CancelToken, PageSocket, SocketMessage, log

_MAX_WAITING = 64  # largest number of waiting requests of a page; a further one drops the oldest
_MAX_LOGGED = 20  # largest number of logged refusals of a page
_CONCURRENT_REQUESTS = 3
"""Number of requests of one page that are computed at the same time."""

_COMPUTATIONS = ("values", "describe", "shader", "pairs", "dome", "usd", "command")
"""The values of ``do`` in requests that `_compute` answers: all except ``render`` and ``cancel``.

``values``
    The values of a surface in a plot.
``describe``
    The data of a surface that the page edits, such as its model and parameters.
``shader``
    The GLSL functions of a surface, and the tables that they read.
``pairs``
    Python's values of a surface at random pairs of directions, with which the page compares its shader.
``dome``
    The light of the dome, as a map and as samples.
``usd``
    The look of a surface as USD text.
``command``
    The command line that writes the same plot.
"""
_REQUESTS = (*_COMPUTATIONS, "render", "cancel")
"""All values of ``do``."""


class InvalidRequest(LookdevError):
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
        self._rendering = rendering  # threads of their own, so that plots do not wait for frames
        self._waiting: dict[str, dict[str, object]] = {}  # the requests that have not begun, by slot
        self._arrived = asyncio.Event()
        self._refusals = 0

    async def run(self) -> None:
        """Serve the page; a message that is not a valid request is refused, and does not end the websocket."""
        for _ in range(_CONCURRENT_REQUESTS):
            self._socket.start_task(self._answer_requests())
        await self._socket.serve(self._handle_message)

    async def _handle_message(self, text: object) -> None:
        """Start, cancel or enqueue the computation that a message requests, or refuse the message."""
        try:
            request = _parse_request(text)
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
        """Let a request wait, in place of an earlier one with its slot; drop the oldest request if too many wait."""
        slot = str(request["slot"])
        self._waiting.pop(slot, None)
        if len(self._waiting) >= _MAX_WAITING:
            self._waiting.pop(next(iter(self._waiting)))
        self._waiting[slot] = request
        self._arrived.set()

    async def _answer_requests(self) -> None:
        """Answer the waiting requests, one after the other, until the task is cancelled."""
        while True:
            await self._arrived.wait()
            if not self._waiting:
                self._arrived.clear()
                continue
            request = self._waiting.pop(next(iter(self._waiting)))
            await self._socket.answer(request, partial(_compute, self._surfaces, request), self._threads)

    async def _render(self, request: Mapping[str, object], ticket: CancelToken) -> None:
        """Answer a request for an exact frame, and send its progress meanwhile."""
        loop = asyncio.get_running_loop()

        def report(state: dict[str, object]) -> None:
            with suppress(RuntimeError):  # the loop has ended
                asyncio.run_coroutine_threadsafe(self._socket.send({"id": request["id"], "progress": state}), loop)

        def compute() -> SocketMessage:
            look = self._surfaces.look_to_render(_text_value(request, "surface"))
            facts, arrays = self._frames.render(look, ticket, report)
            return encode_packet({"id": request["id"], **facts}, arrays)

        await self._socket.answer(request, compute, self._rendering)

    async def _refuse(self, problem: str) -> None:
        """Tell the page that its message is not a valid request, and log the problem."""
        self._refusals += 1
        if self._refusals <= _MAX_LOGGED:
            more = "; further ones are not logged" if self._refusals == _MAX_LOGGED else ""
            log.warning("refused a message: %s%s", shorten(problem, 160), more)
        await self._socket.send({"error": problem})


def _parse_request(text: object) -> dict[str, object]:
    """Return the request in a message; raise LookdevError if the message is not a valid request."""
    if not isinstance(text, str):
        raise InvalidRequest("a message of bytes; JSON would be right")
    try:
        request = parse_json(text, "message")
    except TextError as error:
        raise InvalidRequest(str(error)) from None
    if not isinstance(request, dict):
        raise InvalidRequest("a JSON object would be right")
    if request.get("do") not in _REQUESTS:
        raise InvalidRequest(
            f"do is {shorten(repr(request.get('do')), 40)}; one of {', '.join(_REQUESTS)} would be right"
        )
    if isinstance(request.get("id"), bool) or not isinstance(request.get("id"), int) or request["id"] < 0:
        raise InvalidRequest("id: a whole number would be right")
    if not isinstance(request.setdefault("slot", ""), str) or len(request["slot"]) > 200:
        raise InvalidRequest("slot: a short text would be right")
    return request


def _text_value(request: Mapping[str, object], key: str, default: str | None = None) -> str:
    """Return the text of a key; raise InvalidRequest if the value is not a text."""
    value = request.get(key, default)
    if not isinstance(value, str):
        raise InvalidRequest(f"{key}: a text would be right")
    return value


def _text_list(request: Mapping[str, object], key: str) -> list[str]:
    """Return the list of texts of a key, by default empty; raise InvalidRequest if the value is not such a list."""
    values = request.get(key, [])
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise InvalidRequest(f"{key}: a list of texts would be right")
    return values


def parse_options(data: object) -> PlotOptions:
    """Return the options of a plot from JSON data; raise LookdevError if they are not valid."""
    if not isinstance(data, dict):
        raise InvalidRequest("options: an object would be right")
    defaults = {option.name: option.default for option in fields(PlotOptions)}
    values = dict(data)
    for name, value in data.items():
        if name not in defaults:
            raise InvalidRequest(f"options: no '{shorten(str(name), 40)}'")
        default = defaults[name]
        if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if type(value) is not type(default) or value != value:  # NaN
            raise InvalidRequest(f"options: {name} is {shorten(repr(value), 40)}; {default!r} would be right")
        values[name] = value
    return PlotOptions(**values)


def _compute(surfaces: Surfaces, request: Mapping[str, object]) -> SocketMessage:
    """Return the answer to a request for one of `_COMPUTATIONS`."""
    reply = {"id": request["id"]}
    match request["do"]:
        case "values":
            return _plot_values(surfaces, request)
        case "describe":
            return {**reply, **surfaces.describe(_text_value(request, "surface"))}
        case "shader":
            surface, live = _text_value(request, "surface"), _text_list(request, "live")
            header, tables = shading.surface_shader(surfaces, surface, live)
            return encode_packet({**reply, **header}, tables)
        case "pairs":
            return encode_packet(reply, shading.reference_values(surfaces, _text_value(request, "surface")))
        case "dome":
            return encode_packet(reply, shading.dome())
        case "usd":
            return {**reply, "text": usd.usd_text(surfaces, _text_value(request, "surface"))}
    options = parse_options(request.get("options", {}))
    return {**reply, "text": surfaces.command(_text_value(request, "kind"), _text_list(request, "surfaces"), options)}


def _plot_values(surfaces: Surfaces, request: Mapping[str, object]) -> SocketMessage:
    """Return the values of a surface in a plot; for a sampling test, add a note on the result of the test.

    ``moving`` is the name of the parameter whose slider the user has moved last, or "" if there is none. ``draft`` is
    whether a faster draft of the values is enough.
    """
    kind, options = _text_value(request, "kind"), parse_options(request.get("options", {}))
    kind_named(kind)  # raises an error if there is no such kind
    surface, moved_parameter = _text_value(request, "surface"), _text_value(request, "moving", "")
    values = surfaces.values(kind, surface, options, request.get("draft") is True, moved_parameter)
    note = {"note": sampling_note(values)} if "test" in values else {}
    return encode_packet({"id": request["id"], **note}, values)
