"""The server: refused hosts and origins, limits of size, invalid messages, its end, and errors before its start."""

import json
import random
import signal
import socket
import time
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
from served import Served, start_server
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from lookdev.cli import run
from lookdev.studio.access import authorities

pytestmark = pytest.mark.both_pythons

ASKED = 10**6


def talk(server: Served, **options: Any) -> ClientConnection:
    options.setdefault("origin", server.url)
    return connect(f"ws://127.0.0.1:{server.port}/talk", max_size=None, compression=None, **options)


def answers(socket: ClientConnection, **request: Any) -> Any:
    socket.send(json.dumps({"id": ASKED, **request}))
    while True:
        message = socket.recv(timeout=300)
        if isinstance(message, bytes):
            message = message[4 : 4 + int.from_bytes(message[:4], "little")]
        if (answer := json.loads(message)).get("id") == ASKED:
            return answer


def is_alive(server: Served) -> bool:
    with talk(server) as socket:
        return "error" not in answers(socket, do="values", kind="retro", surface="lambert")


def test_the_page_is_served_with_a_policy(server: Served) -> None:
    status, body, headers = server.ask("/")
    policy = headers["content-security-policy"]
    assert (status, b"<title>Explorer" in body, headers["x-content-type-options"]) == (200, True, "nosniff")
    assert ("default-src 'none'" in policy, "unsafe" in policy) == (True, False)


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1:1", "127.0.0.1.evil.example:{port}"]
)
@pytest.mark.parametrize("path", ["/", "/start", "/upload?name=a"])
def test_another_host_is_refused(server: Served, host: str, path: str) -> None:
    """As when the name of another site resolves to this machine (DNS rebinding)."""
    method = "POST" if path.startswith("/upload") else "GET"
    status, body, _ = server.ask(path, method, b"" if method == "POST" else None, Host=host.format(port=server.port))
    assert (status, b"Host" in body) == (403, True)
    server.wait_for("refused")


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1:{port}", "http://localhost:1"])
def test_another_origin_is_refused(server: Served, origin: str) -> None:
    origin = origin.format(port=server.port)
    for path, method in (("/start", "GET"), ("/upload?name=a", "POST")):
        status, body, _ = server.ask(path, method, b"" if method == "POST" else None, Origin=origin)
        assert (status, b"Origin" in body) == (403, True)
    with pytest.raises(InvalidStatus) as refused, talk(server, origin=origin):
        pass
    assert refused.value.response.status_code == 403


def test_names_of_the_loopback_are_its_own(server: Served) -> None:
    for name in ("localhost", "LOCALHOST", "[::1]"):
        authority = f"{name}:{server.port}"
        assert server.ask("/start", Host=authority, Origin=f"http://{authority}")[0] == 200
    assert authorities(["::1", "Name"], 80) == {"[::1]:80", "name:80", "[::1]", "name"}


@pytest.mark.parametrize(
    "path",
    [
        "/../secret.dat", "/..%2fsecret.dat", "/%2e%2e/%2e%2e/secret.dat", "/....//secret.dat", "//etc/passwd",
        "/static/../../../../../../etc/passwd", "/..%5c..%5csecret.dat", "/%00", "/app.py", "/../app.py",
    ],
)  # fmt: skip
def test_no_path_leaves_the_static_files(server: Served, path: str) -> None:
    status, body, _ = server.ask(path)
    assert (status in (400, 404), b"secret" in body, b"root:" in body) == (True, False, False)


@pytest.mark.parametrize(
    "name", ["scans/../secret.dat", "../secret.dat", "/etc/passwd", "scans/out.dat", "uploads/../x"]
)
def test_no_surface_leaves_the_roots(server: Served, roots: Path, name: str) -> None:
    for words in (name, f"measured:file={name}", f"a={name}", f"{name}.usda", str(roots.parent / "secret.dat")):
        with talk(server) as socket:
            answer = answers(socket, do="describe", surface=words)
        assert "error" in answer, words
        assert "root:" not in answer["error"]
    status, body, _ = server.ask(f"/save/retro.csv?s={quote(name)}")
    assert (status, b"root:" in body) == (422, False)


def test_files_of_a_root_are_read(server: Served) -> None:
    with talk(server) as socket:
        assert answers(socket, do="describe", surface="scans/satin.binary")["model"] == "measured"
    assert "scans/satin.binary" in server.json("/start")["measured"]


def test_a_message_of_ten_megabytes_closes_its_socket_alone(server: Served) -> None:
    with talk(server) as socket:
        with pytest.raises(ConnectionClosed):
            answers(socket, do="x" * 10_000_000)
        # 1009, unless the connection is gone before that is read.
        assert socket.close_code in (1009, 1006)
    assert is_alive(server)


def test_a_body_that_is_too_large_is_refused(server: Served) -> None:
    assert server.ask("/start", "POST", b"x" * (1 << 20))[0] == 405
    status, body, _ = server.ask("/upload?name=large.binary", "POST", b"\0" * ((64 << 20) + 1), Origin=server.url)
    assert (status, b"MiB" in body) == (422, True)
    assert is_alive(server)


@pytest.mark.parametrize("content", [b"", b"text", b"\x5a\0\0\0\x5a\0\0\0\xb4\0\0\0" + b"\0" * 100])
def test_an_upload_that_is_no_measurement_is_refused(server: Served, content: bytes) -> None:
    status, body, _ = server.ask("/upload?name=../../chrome.binary", "POST", content, Origin=server.url)
    assert (status, b"MERL" in body, b"/tmp" in body) == (422, True, False)


def nonsense(rng: random.Random) -> str | bytes:
    """Return a message that is not a request, or a request with wrong values."""
    request: dict[str, Any] = {"id": 1, "do": rng.choice(["values", "shader", "pairs", "usd", "command", "describe"])}
    values = [None, -1, 1e999, float("nan"), "x" * 5000, [], {}, [[]] * 9, True, "disney:roughness=9", "\0", "disney"]
    keys = ("id", "do", "kind", "surface", "surfaces", "options", "draft", "slot", "live")
    for _ in range(rng.randrange(6)):
        request[rng.choice(keys)] = rng.choice(values)
    text = json.dumps(request)
    index = rng.randrange(len(text))
    broken = text[:index] + chr(rng.randrange(1, 0xD800)) + text[index + 1 :]
    return rng.choice([text, text[:index], broken, "[" * rng.randrange(1, 5000), rng.randbytes(rng.randrange(200))])


def test_a_thousand_messages_of_nonsense(server: Served) -> None:
    rng = random.Random(7)
    with talk(server) as socket:
        for _ in range(1000):
            socket.send(nonsense(rng))
        # It answers on the same socket, after all of them.
        assert answers(socket, do="describe", surface="lambert")["model"] == "lambert"
    assert is_alive(server)
    server.wait_for("refused a message")
    assert "Traceback" not in server.log


@pytest.mark.parametrize(
    "number", [pytest.param(signal.SIGINT, marks=pytest.mark.proof), signal.SIGTERM], ids=lambda number: number.name
)
def test_a_signal_ends_it_and_leaves_nothing(number: signal.Signals, tmp_path: Path) -> None:
    with start_server(temporary=tmp_path) as started, talk(started) as client:
        # A page is open, and a computation is in progress: the answer to a later request shows that it has begun.
        client.send(json.dumps({"id": 1, "do": "values", "kind": "sampling", "surface": "pixar"}))
        answers(client, do="describe", surface="lambert")
        began = time.monotonic()
        assert started.end(number) == 0
        # It takes two seconds on an idle machine; other tests may run at the same time.
        assert time.monotonic() - began < 10.0
        assert not list(tmp_path.iterdir())
        with pytest.raises(OSError, match="refused"):
            socket.create_connection(("127.0.0.1", started.port), timeout=5)
        assert "Traceback" not in started.log


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--port {taken}", "port {taken} is taken by another program; another --port"),
        ("disny", "did you mean 'disney'"),
        ("disney:roughness=2", "its range is 0 to 1"),
        ("--root missing", "no such file or folder"),
        ("--host 203.0.113.1", "cannot be listened at"),
    ],
)
def test_what_is_wrong_is_said_before_it_starts(
    arguments: str, message: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        taken = server.getsockname()[1]
        monkeypatch.setattr("sys.argv", ["lookdev", "explore", "--no-browser", *arguments.format(taken=taken).split()])
        with pytest.raises(SystemExit, match="2"):
            run()
    assert message.format(taken=taken) in " ".join(capsys.readouterr().err.split())
