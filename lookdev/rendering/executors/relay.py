"""A process that a run starts in place of a worker, and that forwards all lines to a running worker at a socket.

Its arguments are ``SOCKET COMMAND``; COMMAND is the command of the worker as a JSON list. The server at the socket is a
`WarmServer` (`lookdev.rendering.executors.warm`).
"""

from __future__ import annotations

import json
import os
import socket
import sys
import threading

from lookdev.cache import package_digest
from lookdev.processes import end_with_parent


def main() -> None:
    """Copy standard input to the socket, and the socket's answers to standard output, until either ends."""
    end_with_parent()
    path, command = sys.argv[1:]
    connection = socket.socket(socket.AF_UNIX)
    try:
        connection.connect(path)
        greeting = {"command": json.loads(command), "code": package_digest()}
        connection.sendall(json.dumps(greeting).encode() + b"\n")
        first_line = connection.makefile("rb", buffering=0).readline()
    except OSError as error:
        sys.exit(f"no worker is kept at {path}: {error.strerror or error}")
    if not first_line:
        sys.exit(f"the worker kept at {path} does not start (log: {path}.log)")
    if refusal := json.loads(first_line).get("refused"):
        sys.exit(refusal)
    sys.stdout.buffer.write(first_line)
    sys.stdout.buffer.flush()

    def send_input() -> None:
        while data := os.read(0, 1 << 16):
            connection.sendall(data)
        os._exit(0)  # the run has ended

    threading.Thread(target=send_input, daemon=True).start()
    while data := connection.recv(1 << 16):
        sys.stdout.buffer.write(data)
        sys.stdout.buffer.flush()
    sys.exit(f"the worker kept at {path} died (log: {path}.log)")


if __name__ == "__main__":
    main()
