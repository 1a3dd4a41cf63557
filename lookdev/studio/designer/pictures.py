"""The websocket of exact pictures: the page asks for one, and each round is a packet of arrays."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from lookdev.errors import FaultsError, LookdevError, shortened
from lookdev.render.wire import Cancelled
from lookdev.scene import Scene
from lookdev.studio.designer.exact import Exact, Ticket, wanted_of
from lookdev.studio.packets import packet
from lookdev.text import TextError, parse_json

log = logging.getLogger("lookdev.studio")


class Pictures:
    """Reads the requests of one page until it is gone: ``render`` with an ``id`` and a view, or ``cancel``."""

    def __init__(self, socket: WebSocket, scene: Callable[[], Scene], exact: Exact) -> None:
        self._socket = socket
        self._scene = scene
        self._exact = exact
        self._ticket: Ticket | None = None
        self._sending = asyncio.Lock()

    async def run(self) -> None:
        """Serve the page."""
        await self._socket.accept()
        tasks: set[asyncio.Task[None]] = set()
        try:
            while True:
                message = await self._socket.receive()
                if message["type"] == "websocket.disconnect":
                    return
                request = _request(message.get("text"))
                self._cancel()
                if request is None:
                    await self._send({"error": "a message is JSON that renders, with an id, or cancels"})
                elif request["do"] == "render":
                    self._ticket = Ticket()
                    task = asyncio.create_task(self._render(request, self._ticket))
                    tasks.add(task)
                    task.add_done_callback(tasks.discard)
        except (WebSocketDisconnect, RuntimeError):
            return
        finally:
            self._cancel()
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    def _cancel(self) -> None:
        ticket, self._ticket = self._ticket, None
        if ticket is not None:
            self._exact.cancel(ticket)

    async def _render(self, request: Mapping[str, Any], ticket: Ticket) -> None:
        loop, named = asyncio.get_running_loop(), {"id": request["id"]}

        def deliver(facts: dict[str, Any], arrays: Mapping[str, Any]) -> None:
            if ticket.cancelled.is_set():
                return
            with suppress(RuntimeError):  # the loop has ended
                # Waited for: a page that is slow to take rounds is sent no more of them.
                asyncio.run_coroutine_threadsafe(self._send({**named, **facts}, arrays), loop).result(timeout=30)

        def compute() -> None:
            self._exact.render(self._scene(), wanted_of(request), ticket, deliver)

        answer: dict[str, Any] | None = None
        try:
            await loop.run_in_executor(self._exact.thread, compute)
        except Cancelled:
            answer = {"cancelled": True}
        except FaultsError as error:
            answer = {"error": "; ".join(str(fault) for fault in error.faults)}
        except LookdevError as error:
            answer = {"error": str(error)}
        except Exception as error:
            log.exception("failed to render")
            answer = {"error": f"{type(error).__name__}: {shortened(str(error))}"}
        if answer is not None:
            await self._send({**named, **answer})

    async def _send(self, header: Mapping[str, Any], arrays: Mapping[str, Any] | None = None) -> None:
        with suppress(WebSocketDisconnect, RuntimeError):
            async with self._sending:
                if arrays:
                    await self._socket.send_bytes(packet(header, arrays))
                else:
                    await self._socket.send_text(json.dumps(header))


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
