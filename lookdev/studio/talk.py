"""The websocket of a page: its messages, and answers that are computed in threads."""

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

from lookdev.errors import FaultsError, LookdevError, shortened

log = logging.getLogger("lookdev.studio")

Answer = bytes | Mapping[str, Any]
"""A packet of arrays (`lookdev.studio.packets`), or what becomes JSON."""


class Cancelled(LookdevError):
    """The page no longer wants what is computed."""


@dataclass
class Ticket:
    """Something that a page wants, until it is cancelled."""

    cancelled: threading.Event = field(default_factory=threading.Event)

    def check(self) -> None:
        """Raise Cancelled where it is."""
        if self.cancelled.is_set():
            raise Cancelled("cancelled")


class Talk:
    """A websocket until its page is gone; what was begun for it is cancelled then, the newest ticket by `cancel`."""

    def __init__(self, socket: WebSocket, cancel: Callable[[Ticket], None]) -> None:
        self._socket = socket
        self._cancel = cancel
        self._sending = asyncio.Lock()
        self._tasks: set[asyncio.Task[None]] = set()
        self._ticket: Ticket | None = None

    async def serve(self, take: Callable[[Any], Coroutine[Any, Any, None]]) -> None:
        """Have the text of each message taken; None for one that is bytes."""
        try:
            await self._socket.accept()
            with suppress(WebSocketDisconnect, RuntimeError):
                while (message := await self._socket.receive())["type"] != "websocket.disconnect":
                    await take(message.get("text"))
        finally:
            self.cancel()
            tasks = tuple(self._tasks)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    def replaced(self) -> Ticket:
        """Cancel the newest ticket, and return one in its place."""
        self.cancel()
        self._ticket = Ticket()
        return self._ticket

    def cancel(self) -> None:
        """Cancel the newest ticket, if there is one."""
        ticket, self._ticket = self._ticket, None
        if ticket is not None:
            self._cancel(ticket)

    def begin(self, work: Coroutine[Any, Any, None]) -> None:
        """Do something besides reading messages."""
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def answer(self, request: Mapping[str, Any], compute: Callable[[], Answer | None], threads: Executor) -> None:
        """Compute the answer of a request in a thread and send it, or why there is none."""
        named = {"id": request["id"]}
        answer: Answer | None
        try:
            answer = await asyncio.get_running_loop().run_in_executor(threads, compute)
        except Cancelled:
            answer = {**named, "cancelled": True}
        except FaultsError as error:
            answer = {**named, "error": "; ".join(str(fault) for fault in error.faults)}
        except LookdevError as error:
            answer = {**named, "error": str(error)}
        except Exception as error:
            log.exception("failed: %s", shortened(json.dumps(request), 400))
            answer = {**named, "error": f"{type(error).__name__}: {shortened(str(error))}"}
        if answer is not None:
            await self.send(answer)

    async def send(self, answer: Answer) -> None:
        """Send an answer, if the page is still there."""
        with suppress(WebSocketDisconnect, RuntimeError):
            async with self._sending:
                if isinstance(answer, bytes):
                    await self._socket.send_bytes(answer)
                else:
                    await self._socket.send_text(json.dumps(answer))
