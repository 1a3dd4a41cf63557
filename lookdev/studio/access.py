"""Who may talk to the server: requests for its own names, from its own pages, of bounded size.

A page of another site can send requests to a local server, and can make its own name resolve to this machine ("DNS
rebinding"). Both are seen by the headers: `Host` is the name that the browser was given, `Origin` the site whose page
sends the request.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from lookdev.errors import shortened

log = logging.getLogger("lookdev.studio")

LONGEST_BODY = 1 << 16
"""Bytes of a request's body, but of an upload, which has a limit of its own."""

_HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}


def authorities(names: Iterable[str], port: int) -> frozenset[str]:
    """Return what `Host` is for names of the server, which it has at a port; an IPv6 address gets its brackets."""
    hosts = [f"[{name}]" if ":" in name else name.lower() for name in names]
    # Port 80 is not in the header.
    return frozenset(f"{host}:{port}" for host in hosts) | (frozenset(hosts) if port == 80 else frozenset())


class Guarded:
    """An application behind checks of `Host`, `Origin` and the size of bodies; refusals are logged."""

    def __init__(self, app: ASGIApp, allowed: frozenset[str], uploads: Iterable[str] = ()) -> None:
        self._app = app
        self._allowed = allowed
        self._uploads = frozenset(uploads)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        if problem := self._problem(scope, headers):
            log.warning("refused %s: %s", shortened(scope["path"], 80), problem)
            if scope["type"] == "websocket":
                await send({"type": "websocket.close", "code": 1008, "reason": problem[:100]})
            else:
                await PlainTextResponse(f"refused: {problem}\n", 403)(scope, receive, send)
            return
        await self._app(scope, self._bounded(scope, receive), _with_headers(send))

    def _problem(self, scope: Scope, headers: Headers) -> str:
        hosts = headers.getlist("host")
        if len(hosts) != 1 or hosts[0].lower() not in self._allowed:
            return f"Host {shortened(', '.join(hosts) or 'missing', 80)} is not this server"
        origins = headers.getlist("origin")
        if any(origin.lower() not in {f"http://{each}" for each in self._allowed} for origin in origins):
            return f"Origin {shortened(', '.join(origins), 80)} is not this server"
        # Browsers send it with every websocket and every POST: what sends none is no page.
        return ""

    def _bounded(self, scope: Scope, receive: Receive) -> Receive:
        if scope["type"] != "http" or scope["path"] in self._uploads:
            return receive
        size = 0

        async def bounded() -> Message:
            nonlocal size
            message = await receive()
            size += len(message.get("body", b""))
            if size > LONGEST_BODY:
                log.warning("refused %s: a body of more than %d bytes", shortened(scope["path"], 80), LONGEST_BODY)
                return {"type": "http.disconnect"}
            return message

        return bounded


def _with_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            known = {name.lower() for name, _ in message.get("headers", [])}
            extra = [(k.encode(), v.encode()) for k, v in _HEADERS.items() if k.encode() not in known]
            message = {**message, "headers": [*message.get("headers", []), *extra]}
        await send(message)

    return sending
