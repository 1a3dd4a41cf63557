"""Access control of the local server: it refuses requests from pages of other sites, and bodies that are too large.

A page of another site can send requests to a local server, and can make its own name resolve to this machine ("DNS
rebinding"). The headers reveal both: `Host` is the name in the browser's address, and `Origin` is the site whose page
sends the request.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from lookdev.errors import shorten

log = logging.getLogger("lookdev.studio")

MAX_BODY_BYTES = 1 << 16
"""Largest body of a request, in bytes; it does not apply to uploads, whose handlers check the size themselves."""

_SECURITY_HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}


def authorities(names: Iterable[str], port: int) -> frozenset[str]:
    """Return the values of `Host` that name the server at a port; IPv6 addresses are in brackets."""
    hosts = [f"[{name}]" if ":" in name else name.lower() for name in names]
    # Browsers leave port 80 out of the header.
    return frozenset(f"{host}:{port}" for host in hosts) | (frozenset(hosts) if port == 80 else frozenset())


class RequestGuard:
    """An ASGI application that checks each request, and passes it to `app` or refuses it; refusals are logged.

    The value of `Host`, and the site in `Origin` if there is one, must be in `allowed` (see `authorities`). A body has
    at most `MAX_BODY_BYTES`, unless the path of its request is in `upload_paths`.
    """

    def __init__(self, app: ASGIApp, allowed: frozenset[str], upload_paths: Iterable[str] = ()) -> None:
        self._app = app
        self._allowed = allowed
        self._upload_paths = frozenset(upload_paths)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        if problem := self._refusal(scope, headers):
            log.warning("refused %s: %s", shorten(scope["path"], 80), problem)
            if scope["type"] == "websocket":
                await send({"type": "websocket.close", "code": 1008, "reason": problem[:100]})
            else:
                await PlainTextResponse(f"refused: {problem}\n", 403)(scope, receive, send)
            return
        await self._app(scope, self._limit_body(scope, receive), _add_headers(send))

    def _refusal(self, scope: Scope, headers: Headers) -> str:
        """Return the reason why a request is refused; an empty string if it is accepted."""
        hosts = headers.getlist("host")
        if len(hosts) != 1 or hosts[0].lower() not in self._allowed:
            return f"Host {shorten(', '.join(hosts) or 'missing', 80)} is not this server"
        origins = headers.getlist("origin")
        if any(origin.lower() not in {f"http://{authority}" for authority in self._allowed} for origin in origins):
            return f"Origin {shorten(', '.join(origins), 80)} is not this server"
        # Browsers send Origin with every websocket and every POST. So a websocket or POST without Origin is not from a
        # page of another site, and is accepted.
        return ""

    def _limit_body(self, scope: Scope, receive: Receive) -> Receive:
        """Return `receive`, or a function in its place that disconnects a client that sends too large a body."""
        if scope["type"] != "http" or scope["path"] in self._upload_paths:
            return receive
        size = 0

        async def receive_limited() -> Message:
            nonlocal size
            message = await receive()
            size += len(message.get("body", b""))
            if size > MAX_BODY_BYTES:
                log.warning("refused %s: a body of more than %d bytes", shorten(scope["path"], 80), MAX_BODY_BYTES)
                return {"type": "http.disconnect"}
            return message

        return receive_limited


def _add_headers(send: Send) -> Send:
    """Return a function in place of `send`; it adds the missing `_SECURITY_HEADERS` to each response."""

    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            present = {name.lower() for name, _ in message.get("headers", [])}
            extra = [(k.encode(), v.encode()) for k, v in _SECURITY_HEADERS.items() if k.encode() not in present]
            message = {**message, "headers": [*message.get("headers", []), *extra]}
        await send(message)

    return send_with_headers
