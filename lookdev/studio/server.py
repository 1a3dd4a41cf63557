"""The local server: a socket, an application, and an end at a signal."""

from __future__ import annotations

import asyncio
import errno
import ipaddress
import signal
import socket
import threading
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import uvicorn
from starlette.types import ASGIApp

from lookdev.errors import LookdevError
from lookdev.studio import Address
from lookdev.studio.access import Guarded, authorities

PORT = 8421
"""The port of a server that is not told another, if it is free."""

LONGEST_MESSAGE = 1 << 16
"""Bytes of a message over a websocket; a longer one closes it, with code 1009."""

_GRACE = 1  # seconds for open connections at the end
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_LOCAL = ("127.0.0.1", "localhost", "::1")


@dataclass(frozen=True)
class Bound:
    """A socket that listens, its URL, and whether it has the port that was wanted."""

    socket: socket.socket
    url: str
    allowed: frozenset[str]
    wanted: int
    as_wanted: bool


def bind(address: Address) -> Bound:
    """Listen at an address; where no port is asked for and the usual one is taken, at one that is free.

    Raises LookdevError where the address is not of this machine, or the port is taken.
    """
    wanted = PORT if address.port is None else address.port
    try:
        listening = _listen(address.host, wanted)
    except OSError as error:
        if address.port is None and error.errno == errno.EADDRINUSE:
            listening = _listen(address.host, 0)
        elif error.errno == errno.EADDRINUSE:
            raise LookdevError(
                f"port {wanted} is taken by another program; another --port, or none, would be right"
            ) from None
        else:
            raise LookdevError(f"{address.host}:{wanted}: cannot be listened at: {error.strerror or error}") from None
    port = listening.getsockname()[1]
    names = (*_LOCAL, *address.names) if _is_local(address.host) else (address.host, *_LOCAL, *address.names)
    shown = f"[{address.host}]" if ":" in address.host else address.host
    return Bound(listening, f"http://{shown}:{port}/", authorities(names, port), wanted, wanted in (port, 0))


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
        listening.listen(64)
    except BaseException:
        listening.close()
        raise
    return listening


def _is_local(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def serve_page(
    app: Callable[[], ASGIApp],
    address: Address,
    uploads: Sequence[str],
    *,
    browser: bool,
    say: Callable[[str], None],
) -> None:
    """Serve the application that `app` makes once the address is listened at, and `say` where; errors as `bind`.

    Otherwise as `serve`; the user's `browser` is opened at the page.
    """
    bound = bind(address)
    if not bound.as_wanted:
        say(f"port {bound.wanted} is taken by another program, so this is another one:")

    def started() -> None:
        say(f"{bound.url}  (Ctrl-C ends it)")
        if browser:
            open_browser(bound.url)

    serve(app(), bound, uploads, started)


class _Server(uvicorn.Server):
    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave signals to `serve`: uvicorn would raise them again at the end."""
        yield


def serve(app: ASGIApp, bound: Bound, uploads: Sequence[str] = (), started: Callable[[], None] = lambda: None) -> None:
    """Serve an application until SIGINT or SIGTERM, and call `started` when it answers.

    These signals are how a server ends, so they raise nothing here. Open connections have a second to close.
    """
    config = uvicorn.Config(
        Guarded(app, bound.allowed, uploads),
        log_config=None,
        access_log=False,
        server_header=False,
        date_header=False,
        lifespan="on",
        ws="websockets-sansio",
        ws_max_size=LONGEST_MESSAGE,
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=_GRACE,
        timeout_keep_alive=30,
    )
    server = _Server(config)

    async def run() -> None:
        serving = asyncio.create_task(server.serve(sockets=[bound.socket]))
        loop = asyncio.get_running_loop()
        own = threading.current_thread() is threading.main_thread()
        for number in _SIGNALS if own else ():
            loop.add_signal_handler(number, _end, server)
        try:
            while not server.started and not serving.done():
                await asyncio.sleep(0.01)
            if server.started:
                started()
            await serving
        finally:
            for number in _SIGNALS if own else ():
                loop.remove_signal_handler(number)

    asyncio.run(run())


def _end(server: uvicorn.Server) -> None:
    server.should_exit = True


def open_browser(url: str) -> None:
    """Open a page in the user's browser, if there is one, without waiting for it."""
    threading.Thread(target=lambda: webbrowser.open(url), daemon=True).start()
