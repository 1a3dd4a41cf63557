"""A run of the tests leaves no process, and no file outside of pytest's folder; if it is killed, no process."""

import os
import shutil
import subprocess
import sys
import uuid
from pathlib import Path

import pytest
from batch_case import wait_until

TESTS = Path(__file__).parent
# With a fake in the place of Cycles, which starts at once.
TINY = """
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import batch_case
from lookdev.cache import cache_dir
from lookdev.rendering.backends import BACKENDS

folder = Path(__file__).parent
BACKENDS["exact"] = replace(BACKENDS["exact"], command=batch_case.command(folder))

def test_tiny(cycles_worker, tmp_path):
    cycles_worker.start()
    for written in (tmp_path, cache_dir("rooms"), Path.home(), Path(tempfile.mkdtemp())):
        (written / "file").touch()
    (folder / "started").touch()
    while (folder / "waits").exists():
        time.sleep(0.1)  # until this process is killed
"""


def processes(mark: str) -> list[int]:
    """Return the processes that have a mark in their environment."""
    marked = []
    for file in Path("/proc").glob("[0-9]*/environ"):
        try:
            marked += [int(file.parent.name)] if mark.encode() in file.read_bytes() else []
        except OSError:  # it has ended, or is another user's
            continue
    return marked


@pytest.mark.parametrize("is_killed", [False, True])
def test_a_run_leaves_nothing_behind(tmp_path, is_killed):
    (tmp_path / "tests").mkdir()
    for file in (*TESTS.glob("*.py"), TESTS / "durations.json"):
        shutil.copy(file, tmp_path / "tests")
    (tmp_path / "tests" / "test_tiny.py").write_text(TINY)
    home, temporary = tmp_path / "home", tmp_path / "temporary"
    home.mkdir()
    temporary.mkdir()
    mark = uuid.uuid4().hex
    if is_killed:
        (tmp_path / "tests" / "waits").touch()
    # xdist itself lets its processes run for some seconds after theirs is killed.
    options = ["-n", "0" if is_killed else "1", "-p", "no:cacheprovider"]
    command = (sys.executable, "-m", "pytest", *options, "tests/test_tiny.py")
    environment = os.environ | {"HOME": str(home), "TMPDIR": str(temporary), "PYTEST_DEBUG_TEMPROOT": "", "MARK": mark}
    log = tmp_path / "log"
    with log.open("w") as output, subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=output) as process:
        try:
            if is_killed:
                wait_until((tmp_path / "tests" / "started").exists)
                assert len(processes(mark)) == 2  # that of the test, and the worker
            else:
                assert process.wait(120.0) == 0, log.read_text()
        finally:
            process.kill()
    wait_until(lambda: not processes(mark), 10.0)
    if not is_killed:
        assert [file.name.partition("-of-")[0] for file in temporary.iterdir()] == ["pytest"]
        assert list(home.iterdir()) == []
