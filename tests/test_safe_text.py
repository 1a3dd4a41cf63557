"""Text files of any content are read whole, or refused with file and position; messages quote them safely."""

import os

import pytest

from lookdev.errors import AssetError, Fault, LookError
from lookdev.safe_text import MAX_DEPTH, TextError, parse_json, parse_toml, read_text


def test_a_text_is_read_with_or_without_a_mark(tmp_path):
    for start in (b"", b"\xef\xbb\xbf"):
        (tmp_path / "a.txt").write_bytes(start + "grün\r\n".encode())
        assert read_text(tmp_path / "a.txt") == "grün\r\n"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (os.mkfifo, "is a pipe, a socket or a device"),
        (lambda file: file.symlink_to("/dev/zero"), "is a pipe, a socket or a device"),
        (lambda file: file.mkdir(), "is a folder"),
        (lambda file: (file.touch(), os.truncate(file, 1 << 40)), "has 1099511627776 bytes (at most"),
        (lambda file: file.symlink_to(file), "cannot be read"),
        (lambda file: None, "cannot be read: No such file"),
        (lambda file: file.write_bytes("a\nb".encode("utf-16")), "line 1, column 1: not UTF-8 text"),
        (lambda file: file.write_bytes(b"a\n\xff"), "line 2, column 1: not UTF-8 text"),
    ],
)
def test_what_is_no_text_is_refused_at_once(tmp_path, make, message):
    file = tmp_path / "a.txt"
    make(file)
    with pytest.raises(TextError) as caught:
        read_text(file)
    assert str(caught.value).startswith(f"{file}: ")
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("parse", "text", "message"),
    [
        (parse_toml, "a = 1\nb = ]", "a: line 2, column 5: not TOML: Invalid value"),
        (parse_toml, "a = " + "9" * 5000, "not TOML: Exceeds the limit (4300 digits)"),
        (parse_toml, f"a = {'[' * 900}{']' * 900}", f"more than {MAX_DEPTH} deep"),
        (parse_toml, f"a = {'[' * 100_000}", f"more than {MAX_DEPTH} deep"),
        (parse_toml, f"{'a.' * 900}a = 1", f"more than {MAX_DEPTH} deep"),
        # A parser that takes time and memory by the square of the number of parts would need 40 GB.
        (parse_toml, "b = { " + "'a' . " * 100_000 + "a = 1 }", f"more than {MAX_DEPTH} deep"),
        (parse_toml, f"[{'x' * 300_000}]\n[{'x' * 300_000}]", "… (3000"),
        (parse_json, '{"a":\n x}', "a: line 2, column 2: not JSON"),
        (parse_json, "9" * 5000, "not JSON: Exceeds the limit"),
        (parse_json, f"{'[' * 900}{']' * 900}", f"more than {MAX_DEPTH} deep"),
        (parse_json, '{"a":' * 100_000, f"more than {MAX_DEPTH} deep"),
    ],
)
def test_a_text_that_does_not_parse_is_refused_with_its_place(parse, text, message):
    with pytest.raises(TextError) as caught:
        parse(text, "a")
    assert message in str(caught.value)
    assert len(str(caught.value)) < 2000


def test_a_text_may_be_nested_a_little():
    text = "[" * MAX_DEPTH + "]" * MAX_DEPTH
    assert parse_toml(f"a = {text[1:-1]}", "a")
    assert parse_json(text, "a")


def test_messages_are_short_and_cannot_control_a_terminal():
    for message in (str(Fault("a\x1b[31m", "b\n", "c" * 300_000, "d\u202e")), str(AssetError("\x9b" + "x" * 300_000))):
        assert len(message) < 2000
        assert not set(message) & {"\x1b", "\x9b", "\u202e"}


def test_a_message_of_many_faults_ends():
    error = LookError(Fault("a", str(number), "wrong") for number in range(1000))
    assert len(error.faults) == 1000
    assert str(error).splitlines()[99:] == ["a: 99: wrong", "and 900 more faults"]
