"""The local server of the pages: it listens at an address, serves an ASGI application, and ends at a signal."""

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
from lookdev.studio.access import RequestGuard, authorities

PORT = 8421
"""The default port, if it is free."""

MAX_MESSAGE_BYTES = 1 << 16
"""Largest message over a websocket, in bytes; a longer one closes the websocket with code 1009."""

_CLOSE_SECONDS = 1  # seconds that open connections have to close at the end
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_LOCAL = ("127.0.0.1", "localhost", "::1")  # names of the loopback interface


@dataclass(frozen=True)
class BoundSocket:
    """A socket that listens, and its URL.

    `allowed` has the values of the header `Host` that requests may have. `requested_port` is the port that the caller
    requested; 0 requests any free port. `is_requested_port` is false if the requested port was taken.
    """

    socket: socket.socket
    url: str
    allowed: frozenset[str]
    requested_port: int
    is_requested_port: bool


def bind_address(address: Address) -> BoundSocket:
    """Listen at an address; if its port is None and the default port is taken, listen at a free port.

    Raises LookdevError if the address is not an address of this machine, or its port is taken.
    """
    requested_port = PORT if address.port is None else address.port
    try:
        listener = _listen(address.host, requested_port)
    except OSError as error:
        if address.port is None and error.errno == errno.EADDRINUSE:
            listener = _listen(address.host, 0)
        elif error.errno == errno.EADDRINUSE:
            raise LookdevError(
                f"port {requested_port} is taken by another program; another --port, or none, would be right"
            ) from None
        else:
            raise LookdevError(
                f"{address.host}:{requested_port}: cannot be listened at: {error.strerror or error}"
            ) from None
    port = listener.getsockname()[1]
    names = (*_LOCAL, *address.names) if _is_local(address.host) else (address.host, *_LOCAL, *address.names)
    display_host = f"[{address.host}]" if ":" in address.host else address.host
    url, allowed = f"http://{display_host}:{port}/", authorities(names, port)
    return BoundSocket(listener, url, allowed, requested_port, requested_port in (port, 0))


def _listen(host: str, port: int) -> socket.socket:
    """Return a socket that listens at a host and a port; raises OSError."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen(64)
    except BaseException:
        listener.close()
        raise
    return listener


def _is_local(host: str) -> bool:
    """Return whether a host is the loopback interface, which only this machine can reach."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def serve_page(
    app: Callable[[], ASGIApp],
    address: Address,
    upload_paths: Sequence[str],
    *,
    browser: bool,
    say: Callable[[str], None],
) -> None:
    """Listen at an address, print its URL by `say`, and serve an application there until SIGINT or SIGTERM.

    `app` makes the application, after the server has begun to listen. `upload_paths` are the paths of requests whose
    bodies have no limit (see `RequestGuard`). With `browser`, the user's browser opens the URL. Raises what
    `bind_address` raises.
    """
    bound = bind_address(address)
    if not bound.is_requested_port:
        say(f"port {bound.requested_port} is taken by another program, so this is another one:")

    def announce() -> None:
        say(f"{bound.url}  (Ctrl-C ends it)")
        if browser:
            open_browser(bound.url)

    serve(app(), bound, upload_paths, announce)


class _Server(uvicorn.Server):
    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave signals to `serve`: uvicorn would raise them again at the end."""
        yield


def serve(
    app: ASGIApp, bound: BoundSocket, upload_paths: Sequence[str] = (), on_start: Callable[[], None] = lambda: None
) -> None:
    """Serve an application at a bound socket until SIGINT or SIGTERM; call `on_start` when the server has started.

    These signals are the normal end of a server, so they raise no exception. Open connections have a second to close.
    """
    config = uvicorn.Config(
        RequestGuard(app, bound.allowed, upload_paths),
        log_config=None,
        access_log=False,
        server_header=False,
        date_header=False,
        lifespan="on",
        ws="websockets-sansio",
        ws_max_size=MAX_MESSAGE_BYTES,
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=_CLOSE_SECONDS,
        timeout_keep_alive=30,
    )
    server = _Server(config)

    async def run() -> None:
        serving = asyncio.create_task(server.serve(sockets=[bound.socket]))
        loop = asyncio.get_running_loop()
        in_main_thread = threading.current_thread() is threading.main_thread()
        for signal_number in _SIGNALS if in_main_thread else ():
            loop.add_signal_handler(signal_number, setattr, server, "should_exit", True)
        try:
            while not server.started and not serving.done():
                await asyncio.sleep(0.01)
            if server.started:
                on_start()
            await serving
        finally:
            for signal_number in _SIGNALS if in_main_thread else ():
                loop.remove_signal_handler(signal_number)

    asyncio.run(run())


def open_browser(url: str) -> None:
    """Open a page in the user's browser, if there is one, without waiting for it."""
    threading.Thread(target=lambda: webbrowser.open(url), daemon=True).start()
