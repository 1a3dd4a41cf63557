"""A program in a child process: a file that ends it is named in a message; otherwise it ends as without a child."""

import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from lookdev.sandbox import MEMORY_VARIABLE, SECONDS_VARIABLE

pytestmark = pytest.mark.both_pythons

_PROGRAM = """
import ctypes, os, signal, sys, time
from pathlib import Path
from lookdev.sandbox import report_opened, report_reading, run_supervised
from lookdev.processes import end_at_signals
def program():
{body}
try:
    print("code", run_supervised(program))
except Exception as error:
    print(type(error).__name__, error)
"""


def outcome(body: str, **variables: str) -> str:
    """Return the output of a supervised program, and that of its parent after it."""
    done = subprocess.run(
        (sys.executable, "-c", _PROGRAM.format(body=textwrap.indent(body, "    "))),
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | variables,
        check=True,
        timeout=60.0,
    )
    return done.stdout


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("print('hello')", "hello\ncode 0\n"),
        ("sys.exit(3)", "code 3\n"),
        ("with report_reading(Path('a')): sys.exit(3)", "code 3\n"),
        ("os.kill(os.getpid(), signal.SIGTERM)", f"code {128 + signal.SIGTERM}\n"),
        ("sys.stderr.close(); raise ValueError", "code 1\n"),
    ],
)
def test_a_program_ends_as_it_would_alone(body, expected):
    assert outcome(body) == expected


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (
            "with report_reading(Path('a.usd')):\n  with report_reading(Path('b.png')): ctypes.string_at(0)",
            "ReadingError b.png: reading it crashed (SIGSEGV); it is damaged: write it anew\n",
        ),
        (
            "with report_reading(Path('a.usd')):\n  with report_reading(Path('b.png')): pass\n  os.abort()",
            "ReadingError a.usd: reading it crashed (SIGABRT); it is damaged: write it anew\n",
        ),
        (
            "with report_reading(Path('a\\x1b[2J')): os.kill(os.getpid(), signal.SIGKILL)",
            "KilledError the system killed the program while it read a?[2J (SIGKILL), "
            "as it does where memory is short\n",
        ),
    ],
)
def test_a_signal_while_a_file_is_read_names_the_file(body, message):
    assert outcome(body) == message


def test_a_signal_at_another_time_is_a_defect_with_its_place():
    text = outcome("with report_reading(Path('a.usd')): pass\nos.abort()")
    assert text.startswith("NativeCrashError SIGABRT\n")
    assert 'File "<string>", line 8 in program' in text


_READING_A = "report_reading(Path('a.usd'))"
_SWELLS = "held = b'x' * (64 << 20)"


@pytest.mark.parametrize(
    ("body", "whole"),
    [
        (f"with report_reading(Path('a.usd')): {_SWELLS}; time.sleep(10)", False),
        (f"with {_READING_A}:\n  with report_reading(Path('b.usd')): {_SWELLS}\n  time.sleep(10)", False),
        (f"{_SWELLS}\nwith report_reading(Path('a.usd')): time.sleep(0.2)", True),
        (f"with report_reading(Path('large')): {_SWELLS}; time.sleep(0.2)", True),
        (f"with report_reading(Path('a.usd')): report_opened(Path('large')); {_SWELLS}; time.sleep(0.2)", True),
    ],
    ids=["swells", "inside", "before", "large", "layer"],
)
def test_memory_is_bounded_by_the_size_of_what_is_read(tmp_path, monkeypatch, body, whole):
    monkeypatch.chdir(tmp_path)
    Path("large").write_bytes(bytes(1 << 20))
    started = time.monotonic()
    text = outcome(body, **{MEMORY_VARIABLE: "32"})
    if whole:
        assert text == "code 0\n"
    else:
        assert text.startswith("ReadingError a.usd: reading it takes more than 32 MiB of memory; ")
        assert f"{MEMORY_VARIABLE}, 32 MiB beside 128 times the size of its files" in text
        assert time.monotonic() - started < 8.0  # the parent did not wait for it


@pytest.mark.parametrize(
    ("body", "ends"),
    [
        ("with report_reading(Path('a.usd')):\n  while True: pass", False),
        ("with report_reading(Path('a.usd')): time.sleep(1.3)", True),  # another file system may be slow
    ],
    ids=["computes", "waits"],
)
def test_time_is_bounded(body, ends):
    text = outcome(body, **{SECONDS_VARIABLE: "1"})
    assert (text == "code 0\n") == ends
    assert ends or text.startswith("ReadingError a.usd: reading it takes more than 1 s; ")


def test_a_limit_that_is_no_number_is_refused():
    text = outcome("pass", **{MEMORY_VARIABLE: "2 GiB"})
    assert text == f"LookdevError {MEMORY_VARIABLE} is '2 GiB'; a whole number from 1 to 999999999 is needed\n"


def test_the_first_signal_counts():
    """Ctrl-C comes from the terminal and from the parent: the second does not interrupt the handling of the first."""
    body = """
    with end_at_signals():
        try:
            for _ in range(2):
                signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            signal.raise_signal(signal.SIGINT)
            print("removed")
            sys.exit(130)"""
    assert outcome(body) == "removed\ncode 130\n"


def test_signals_that_come_together_interrupt_once():
    """The second may come at any instruction of the handler of the first; it waits for no lock of the first."""
    body = """
    def again(*_):
        events.append(number)
        if len(events) == number:
            signal.raise_signal(signal.SIGINT)
        return again
    interruptions = 0
    for number in range(1, 60):
        events = []
        with end_at_signals():
            try:
                sys.settrace(again)
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                sys.settrace(None)
                interruptions += 1
    print(interruptions)"""
    assert outcome(body) == "59\ncode 0\n"


def test_a_signal_is_repeated_until_it_is_raised():
    """A signal that comes just before a wait begins does not end the wait."""
    body = """
    with end_at_signals() as interruption:
        interruption.raised = True
        signal.raise_signal(signal.SIGINT)
        interruption.raised = False
        try:
            time.sleep(60.0)
        except KeyboardInterrupt:
            print("raised")"""
    assert outcome(body) == "raised\ncode 0\n"
