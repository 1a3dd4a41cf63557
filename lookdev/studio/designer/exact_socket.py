"""The websocket of exact pictures: a page requests a picture, and receives each round as a packet of arrays."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from starlette.websockets import WebSocket

from lookdev.safe_text import TextError, parse_json
from lookdev.scene import Scene
from lookdev.studio.designer.exact import ExactRenderer, parse_view
from lookdev.studio.packets import encode_packet
from lookdev.studio.websocket import CancelToken, PageSocket


class ExactPictureSocket:
    """The server's end of the websocket of one page: it answers the page's requests for pictures of a scene.

    ``do`` of a request is ``render`` or ``cancel``. A request to render has an ``id`` and a view (see `parse_view`).
    """

    def __init__(self, socket: WebSocket, scene: Callable[[], Scene], exact: ExactRenderer) -> None:
        self._socket = PageSocket(socket, exact.cancel)
        self._scene = scene
        self._exact = exact

    async def run(self) -> None:
        """Serve the page until it is gone."""
        await self._socket.serve(self._handle_message)

    async def _handle_message(self, text: Any) -> None:
        """Cancel the present picture, and start another one if a message requests it."""
        request = _parse_request(text)
        self._socket.cancel()
        if request is None:
            await self._socket.send({"error": "a message is JSON that renders, with an id, or cancels"})
        elif request["do"] == "render":
            self._socket.start_task(self._render(request, self._socket.replace_ticket()))

    async def _render(self, request: Mapping[str, Any], ticket: CancelToken) -> None:
        """Render the picture of a request, and send each round to the page."""
        loop, reply = asyncio.get_running_loop(), {"id": request["id"]}

        def deliver(facts: dict[str, Any], arrays: Mapping[str, Any]) -> None:
            if ticket.cancelled.is_set():
                return
            header = {**reply, **facts}
            with suppress(RuntimeError):  # the loop has ended
                sending = self._socket.send(encode_packet(header, arrays) if arrays else header)
                # Wait until the round is sent: rounds must not queue up for a slow page.
                asyncio.run_coroutine_threadsafe(sending, loop).result(timeout=30)

        def compute() -> None:
            self._exact.render(self._scene(), parse_view(request), ticket, deliver)

        await self._socket.answer(request, compute, self._exact.thread)


def _parse_request(text: Any) -> dict[str, Any] | None:
    """Return the request in a message, or None if the message is not a valid request."""
    try:
        request = parse_json(text, "message") if isinstance(text, str) else None
    except TextError:
        return None
    match request:
        case {"do": "cancel"}:
            return request
        case {"do": "render", "id": int(number)} if not isinstance(number, bool):
            return request
    return None
