"""A home of its own for a run of the tests: nothing is read from the user's, and nothing stays behind."""

import os
import re
import shutil
import tempfile
from itertools import count
from pathlib import Path

import pytest

from lookdev.processes import end_with_parent

# What leads programs to folders outside of the home: each of them would be read, or written.
ELSEWHERE = ("XDG_CACHE_HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME", "LOOKDEV_LIBRARY", "OCIO")
# Without compiled modules each of the hundreds of processes of a run would compile the whole package, for a second.
SLOW = "PYTHONDONTWRITEBYTECODE"
_NUMBERS = count()


def pytest_configure(config: pytest.Config) -> None:
    """Make the home before anything is imported; processes of xdist and all that tests start inherit it.

    Cache and compiled kernels in it are shared by all tests but those that set ``$LOOKDEV_CACHE`` to a folder of
    their own. ``$TMPDIR`` is in it too, for what a killed process leaves there; folders of ``tmp_path`` stay outside,
    as they hold the pictures of what failed.
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

    def leave() -> None:
        patch.undo()
        if os.getpid() == owner:
            shutil.rmtree(home, ignore_errors=True)

    owner = os.getpid()
    config.add_cleanup(leave)


@pytest.fixture
def tmp_path(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    """Return a new folder. pytest's own fixture reads the names of all others first: 5 ms for each of thousands.

    No name comes twice in a process: USD would hand the layer out that was there before.
    """
    name = re.sub(r"\W", "_", request.node.name)[:25]
    return tmp_path_factory.mktemp(f"{name}-{next(_NUMBERS)}", numbered=False)
