"""A page that a process of its own serves, as when a user starts it."""

import http.client
import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from batch_case import wait_until

from lookdev.processes import end_with_parent

STARTED = re.compile(r"(http://\S+)/  \(Ctrl-C")


@dataclass
class Served:
    """The server's process, its URL without the last slash, and the lines of its output."""

    process: subprocess.Popen[str]
    lines: list[str] = field(default_factory=list)
    url: str = ""

    @property
    def port(self) -> int:
        return int(self.url.rsplit(":", 1)[1])

    @property
    def log(self) -> str:
        return "\n".join(self.lines)

    def wait_for(self, text: str) -> None:
        """Wait until the server has printed a text, which may follow its answer after a moment."""
        wait_until(lambda: text in self.log, 10.0)

    def ask(
        self, path: str, method: str = "GET", body: bytes | None = None, **headers: str
    ) -> tuple[int, bytes, dict[str, str]]:
        """Send a request, and return status, body and headers of the answer; `headers` may replace `Host`."""
        with closing(http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)) as connection:
            connection.request(method, path, body, {"Host": f"127.0.0.1:{self.port}", **headers})
            with connection.getresponse() as answer:
                return answer.status, answer.read(), {name.lower(): value for name, value in answer.getheaders()}

    def json(self, path: str, **body: Any) -> Any:
        """Return the answer to a request, with a JSON body if it has values."""
        status, data, _ = self.ask(path, "POST" if body else "GET", json.dumps(body).encode() if body else None)
        assert status == 200, data
        return json.loads(data)

    def end(self, number: int = signal.SIGINT) -> int:
        """Send a signal, and return the exit code."""
        self.process.send_signal(number)
        return self.process.wait(timeout=30)


@contextmanager
def start_server(
    *arguments: str, verb: str = "explore", cwd: Path | None = None, temporary: Path | None = None
) -> Iterator[Served]:
    """Start a server at a free port and wait until it answers."""
    command = [sys.executable, "-u", "-m", "lookdev", verb, "--no-browser", "--port", "0", *arguments]
    environment = os.environ | ({"TMPDIR": str(temporary)} if temporary else {})
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=cwd, env=environment,
        preexec_fn=end_with_parent,
    )  # fmt: skip
    server = Served(process)

    def read() -> None:
        assert process.stdout is not None
        for line in process.stdout:
            server.lines.append(line.rstrip("\n"))

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    try:
        wait_until(lambda: STARTED.search(server.log) or process.poll() is not None, 300.0)
        started = STARTED.search(server.log)
        assert started, server.log
        server.url = started[1]
        yield server
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
        reader.join(timeout=10)
        process.stdout.close()  # type: ignore[union-attr]


def descendants(parent: int) -> dict[int, str]:
    """Return the descendants of a process, by process id, with their command lines."""
    rows = subprocess.run(["ps", "-ww", "-eo", "pid=,ppid=,args="], capture_output=True, text=True, check=True).stdout
    listed = {int(pid): (int(above), line) for pid, above, line in (row.split(None, 2) for row in rows.splitlines())}
    family = {parent}
    while more := {pid for pid, (above, _) in listed.items() if above in family} - family:
        family |= more
    return {pid: listed[pid][1] for pid in family - {parent} if pid in listed}
