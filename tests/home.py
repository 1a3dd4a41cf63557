"""Gives a run of the tests a temporary home folder: nothing of the user's is read, and nothing is left behind."""

import os
import re
import shutil
import tempfile
from itertools import count
from pathlib import Path

import pytest

from lookdev.processes import end_with_parent

# Environment variables that name folders or files outside of the home.
ELSEWHERE = ("XDG_CACHE_HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME", "LOOKDEV_LIBRARY", "OCIO")
# With this environment variable, Python stores no compiled modules. Each of the hundreds of processes of a run would
# then compile the whole package, for a second.
SLOW = "PYTHONDONTWRITEBYTECODE"
_NUMBERS = count()  # of temporary folders


def pytest_configure(config: pytest.Config) -> None:
    """Make the home before anything is imported.

    The processes of pytest-xdist and all processes that tests start inherit it. Its cache and compiled kernels are
    shared by all tests, except those that set ``$LOOKDEV_CACHE`` to a folder of their own. ``$TMPDIR`` is in the home,
    too, so that files of killed processes are removed. Folders of ``tmp_path`` are outside of it, because they keep the
    pictures of failed tests.
    """
    if hasattr(config, "workerinput"):
        end_with_parent()
        return
    home = Path(tempfile.mkdtemp(prefix="lookdev-home-"))
    patch = pytest.MonkeyPatch()
    for name in (*ELSEWHERE, SLOW):
        patch.delenv(name, raising=False)
    patch.setenv("HOME", str(home))
    patch.setenv("LOOKDEV_CACHE", str(home / "cache"))
    patch.setenv("LOOKDEV_STATE", str(home / "state"))
    patch.setenv("PYTEST_DEBUG_TEMPROOT", os.environ.get("PYTEST_DEBUG_TEMPROOT") or tempfile.gettempdir())
    (home / "tmp").mkdir()
    patch.setenv("TMPDIR", str(home / "tmp"))
    patch.setattr(tempfile, "tempdir", str(home / "tmp"))

    def remove_home() -> None:
        patch.undo()
        if os.getpid() == owner:
            shutil.rmtree(home, ignore_errors=True)

    owner = os.getpid()
    config.add_cleanup(remove_home)


@pytest.fixture
def tmp_path(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    """Return a new folder, in place of pytest's own fixture of this name.

    pytest's fixture first reads the names of all other folders, which takes 5 ms for each of thousands of tests. No
    name is used twice in a process: for a file with the path of an earlier one, USD would return the earlier layer.
    """
    name = re.sub(r"\W", "_", request.node.name)[:25]
    return tmp_path_factory.mktemp(f"{name}-{next(_NUMBERS)}", numbered=False)
