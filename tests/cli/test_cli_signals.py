"""SIGTERM and Ctrl-C: the command line and all its children end within two seconds."""

import os
import signal
import subprocess
import sys
from itertools import product
from pathlib import Path

import pytest
from batch_case import is_alive, wait_until
from looks import quick_among

pytestmark = pytest.mark.both_pythons

# Its children write their number to a file.
_CHILD = """import os, pathlib, time
from lookdev.processes import end_with_parent
end_with_parent()
pathlib.Path({0!r}).write_text(str(os.getpid()))
time.sleep(60)"""
_PROGRAM = """import contextlib, hashlib, subprocess, sys, time
from lookdev.cli import app, main
child = (sys.executable, "-c", {child!r})
@app.command()
def work():
    {work}
sys.argv = ["lookdev", "work"]
main()"""
WORK = {
    "waits": "subprocess.run(child)",
    # USD loses the exception while it is imported.
    "loses": "with contextlib.suppress(BaseException): subprocess.run(child)",
    # A library that computes for a minute, and does not return to Python.
    "computes": 'subprocess.Popen(child), hashlib.pbkdf2_hmac("sha256", b"", b"", 10**8)',
}
QUICK = [("waits", "SIGTERM"), ("loses", "SIGINT"), ("computes", "SIGINT")]


def command(work, child=""):
    return [sys.executable, "-c", _PROGRAM.format(work=work, child=child)]


@pytest.mark.parametrize(("work", "name"), quick_among([*product(WORK, ("SIGTERM", "SIGINT"))], QUICK))
def test_children_end_with_the_program(tmp_path, work, name):
    file, number = tmp_path / "child", signal.Signals[name]
    process = subprocess.Popen(command(WORK[work], _CHILD.format(str(file))), stderr=subprocess.DEVNULL)
    try:
        wait_until(lambda: file.exists() and file.read_text())
        child = int(file.read_text())
        assert is_alive(child)
        process.send_signal(number)
        assert process.wait(2.0) in (130, 128 + number)
        wait_until(lambda: not is_alive(child), 0.5)
    finally:
        process.kill()
        process.wait()


def test_a_signal_during_an_import_waits_for_its_end(tmp_path):
    """A library in C++ loses the exception of a signal: without the wait, nothing would be tidied up."""
    (tmp_path / "library.py").write_text(
        "import pathlib, time\n"
        "pathlib.Path('child').touch()\n"
        "try: time.sleep(0.5)\n"
        "except BaseException: raise ImportError('initialization failed') from None\n"
    )
    work = """try:
        import library
        time.sleep(60)
    except KeyboardInterrupt:
        print("tidy", flush=True)"""
    process = subprocess.Popen(command(work), cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    try:
        wait_until((tmp_path / "child").exists)
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=2.0)[0] == "tidy\n"
        assert process.returncode == 130
    finally:
        process.kill()
        process.wait()


@pytest.mark.cycles
def test_blender_ends_with_the_program_that_is_killed():
    """The input of the worker stays open here: its end would end the worker, too."""
    program = "import subprocess, sys, time; subprocess.Popen([sys.executable, '-m', 'lookdev.cycles']); time.sleep(60)"
    reader, writer = os.pipe()
    with subprocess.Popen([sys.executable, "-c", program], stdin=reader, stdout=subprocess.PIPE) as process:
        assert b"ready" in process.stdout.readline()
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        process.kill()
        wait_until(lambda: not any(is_alive(int(child)) for child in children), 2.0)
    os.close(reader)
    os.close(writer)
