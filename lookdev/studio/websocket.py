"""The websocket of a page, on the server's side: it receives messages, computes answers in threads, and sends them."""

from __future__ import annotations

import asyncio
import json
import logging
import threading
from collections.abc import Callable, Coroutine, Mapping
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from lookdev.errors import FaultsError, LookdevError, shorten

log = logging.getLogger("lookdev.studio")

SocketMessage = bytes | Mapping[str, Any]
"""A packet of arrays (`lookdev.studio.packets`), or a mapping that is sent as JSON."""


class ComputationCancelled(LookdevError):
    """The page has cancelled the computation."""


@dataclass
class CancelToken:
    """The state of one computation for a page: `cancelled` is set when the page cancels the computation."""

    cancelled: threading.Event = field(default_factory=threading.Event)

    def check(self) -> None:
        """Raise ComputationCancelled if the page has cancelled the computation."""
        if self.cancelled.is_set():
            raise ComputationCancelled("cancelled")


class PageSocket:
    """The websocket of one page, with its asyncio tasks, and with the ticket of its newest computation.

    A ticket is a `CancelToken`. The argument `cancel` is a function that ends the computation of a ticket. When the
    page is gone, the newest ticket and all tasks are cancelled.
    """

    def __init__(self, socket: WebSocket, cancel: Callable[[CancelToken], None]) -> None:
        self._socket = socket
        self._cancel = cancel
        self._sending = asyncio.Lock()
        self._tasks: set[asyncio.Task[None]] = set()
        self._ticket: CancelToken | None = None

    async def serve(self, handle: Callable[[Any], Coroutine[Any, Any, None]]) -> None:
        """Call `handle` with the text of each message, or with None for a message of bytes, until the page is gone."""
        try:
            await self._socket.accept()
            with suppress(WebSocketDisconnect, RuntimeError):
                while (message := await self._socket.receive())["type"] != "websocket.disconnect":
                    await handle(message.get("text"))
        finally:
            self.cancel()
            tasks = tuple(self._tasks)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    def replace_ticket(self) -> CancelToken:
        """Cancel the newest ticket, and return a new ticket for the next computation."""
        self.cancel()
        self._ticket = CancelToken()
        return self._ticket

    def cancel(self) -> None:
        """Cancel the newest ticket, if there is one."""
        ticket, self._ticket = self._ticket, None
        if ticket is not None:
            self._cancel(ticket)

    def start_task(self, work: Coroutine[Any, Any, None]) -> None:
        """Run a coroutine while the websocket reads further messages."""
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def answer(
        self, request: Mapping[str, Any], compute: Callable[[], SocketMessage | None], threads: Executor
    ) -> None:
        """Compute the answer to a request in a thread of `threads` and send it; if that fails, send the reason.

        Nothing is sent if `compute` returns None.
        """
        reply = {"id": request["id"]}
        answer: SocketMessage | None
        try:
            answer = await asyncio.get_running_loop().run_in_executor(threads, compute)
        except ComputationCancelled:
            answer = {**reply, "cancelled": True}
        except FaultsError as error:
            answer = {**reply, "error": "; ".join(str(fault) for fault in error.faults)}
        except LookdevError as error:
            answer = {**reply, "error": str(error)}
        except Exception as error:
            log.exception("failed: %s", shorten(json.dumps(request), 400))
            answer = {**reply, "error": f"{type(error).__name__}: {shorten(str(error))}"}
        if answer is not None:
            await self.send(answer)

    async def send(self, answer: SocketMessage) -> None:
        """Send an answer, if the page is still there."""
        with suppress(WebSocketDisconnect, RuntimeError):
            async with self._sending:
                if isinstance(answer, bytes):
                    await self._socket.send_bytes(answer)
                else:
                    await self._socket.send_text(json.dumps(answer))
