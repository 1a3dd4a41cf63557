"""A worker of `lookdev.rendering.worker` that connects to a running one at a socket: ``relay SOCKET COMMAND``."""

from __future__ import annotations

import json
import os
import socket
import sys
import threading

from lookdev.cache import package_digest
from lookdev.lifetime import end_with_parent


def main() -> None:
    """Pass standard input to the socket, and its answers to standard output, until either ends."""
    end_with_parent()
    at, command = sys.argv[1:]
    connection = socket.socket(socket.AF_UNIX)
    try:
        connection.connect(at)
        hello = {"command": json.loads(command), "code": package_digest()}
        connection.sendall(json.dumps(hello).encode() + b"\n")
        first = connection.makefile("rb", buffering=0).readline()
    except OSError as error:
        sys.exit(f"no worker is kept at {at}: {error.strerror or error}")
    if not first:
        sys.exit(f"the worker kept at {at} does not start (log: {at}.log)")
    if refused := json.loads(first).get("refused"):
        sys.exit(refused)
    sys.stdout.buffer.write(first)
    sys.stdout.buffer.flush()

    def send() -> None:
        while data := os.read(0, 1 << 16):
            connection.sendall(data)
        os._exit(0)  # the run has ended

    threading.Thread(target=send, daemon=True).start()
    while data := connection.recv(1 << 16):
        sys.stdout.buffer.write(data)
        sys.stdout.buffer.flush()
    sys.exit(f"the worker kept at {at} died (log: {at}.log)")


if __name__ == "__main__":
    main()
