"""The websocket of exact pictures: the page asks for one, and each round is a packet of arrays."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from starlette.websockets import WebSocket

from lookdev.scene import Scene
from lookdev.studio.designer.exact import Exact, wanted_of
from lookdev.studio.packets import packet
from lookdev.studio.talk import Talk, Ticket
from lookdev.text import TextError, parse_json


class Pictures:
    """Reads the requests of one page until it is gone: ``render`` with an ``id`` and a view, or ``cancel``."""

    def __init__(self, socket: WebSocket, scene: Callable[[], Scene], exact: Exact) -> None:
        self._talk = Talk(socket, exact.cancel)
        self._scene = scene
        self._exact = exact

    async def run(self) -> None:
        """Serve the page."""
        await self._talk.serve(self._take)

    async def _take(self, text: Any) -> None:
        request = _request(text)
        self._talk.cancel()
        if request is None:
            await self._talk.send({"error": "a message is JSON that renders, with an id, or cancels"})
        elif request["do"] == "render":
            self._talk.begin(self._render(request, self._talk.replaced()))

    async def _render(self, request: Mapping[str, Any], ticket: Ticket) -> None:
        loop, named = asyncio.get_running_loop(), {"id": request["id"]}

        def deliver(facts: dict[str, Any], arrays: Mapping[str, Any]) -> None:
            if ticket.cancelled.is_set():
                return
            header = {**named, **facts}
            with suppress(RuntimeError):  # the loop has ended
                sent = self._talk.send(packet(header, arrays) if arrays else header)
                # Waited for: a page that is slow to take rounds is sent no more of them.
                asyncio.run_coroutine_threadsafe(sent, loop).result(timeout=30)

        def compute() -> None:
            self._exact.render(self._scene(), wanted_of(request), ticket, deliver)

        await self._talk.answer(request, compute, self._exact.thread)


def _request(text: Any) -> dict[str, Any] | None:
    """Return a request; None for any other message."""
    if not isinstance(text, str):
        return None
    try:
        found = parse_json(text, "message")
    except TextError:
        return None
    if not isinstance(found, dict):
        return None
    number = found.get("id")
    numbered = isinstance(number, int) and not isinstance(number, bool)
    return found if found.get("do") == "cancel" or (found.get("do") == "render" and numbered) else None
