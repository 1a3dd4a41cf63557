"""A plugin of pytest that records which functions of the package each test reaches, and how long the test takes.

``python tests/mutation reach`` loads it. It needs Python 3.12 or later, whose `sys.monitoring` costs next to nothing.
A test also reaches the functions that its fixtures reach, including fixtures that several tests share. Programs that
tests start record their functions by `children/sitecustomize.py`, for the test or the fixture that started them.
"""

import functools
import json
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from recorder import FOLDER, MONITORING, OWNER, Recorder


class Reach:
    """The hooks of pytest that record functions and seconds into a file of JSON lines.

    The owner of a function that is reached is the running test, or the fixture that is set up.
    """

    def __init__(self, folder: Path) -> None:
        self._file = (folder / f"tests-{os.getpid()}.jsonl").open("a", buffering=1)
        self._recorder = Recorder()
        self._seconds: dict[str, float] = {}

    def _write(self, **values: object) -> None:
        self._file.write(json.dumps(values) + "\n")

    def pytest_runtest_protocol(self, item) -> None:
        """Begin to record for a test."""
        os.environ[OWNER] = _plain(item.nodeid)
        forget_results()
        self._recorder.switch(set())

    def pytest_runtest_logreport(self, report) -> None:
        self._seconds[report.nodeid] = self._seconds.get(report.nodeid, 0.0) + report.duration

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        reached, seconds = sorted(self._recorder.switch(set())), round(self._seconds.pop(nodeid, 0.0), 4)
        self._write(owner=_plain(nodeid), reached=reached, seconds=seconds)

    def pytest_collection_finish(self, session) -> None:
        """Record the fixtures of each test."""
        for item in session.items:
            self._write(test=_plain(item.nodeid), fixtures=sorted(item.fixturenames))

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef, request):
        """Record the functions that the setup of a shared fixture reaches for the fixture, not for the running test."""
        outer = self._recorder.reached
        if fixturedef.scope == "function":
            return (yield)
        owner, os.environ[OWNER] = os.environ.get(OWNER, ""), f"fixture {fixturedef.argname}"
        self._recorder.switch(set())
        try:
            return (yield)
        finally:
            os.environ[OWNER] = owner
            self._write(owner=f"fixture {fixturedef.argname}", reached=sorted(self._recorder.switch(outer)))


def _plain(nodeid: str) -> str:
    """Return the name of a test without the group that pytest-xdist appends, which is a file or a fixture."""
    return re.sub(r"@(\w+\.py|cycles_worker|mitsuba_worker|browser)$", "", nodeid)


@functools.cache
def _caching(count: int) -> tuple[object, ...]:
    """Return the functions of the package that cache their results.

    `count` is the number of modules of the package that are imported: with a new number, the functions are searched
    again.
    """
    functions = {}
    for name, module in list(sys.modules.items()):
        if name.startswith("lookdev"):
            values = [*vars(module).values()]
            values += [value for kind in values if isinstance(kind, type) for value in vars(kind).values()]
            functions |= {id(value): value for value in values if hasattr(value, "cache_clear")}
    return tuple(functions.values())


def forget_results() -> None:
    """Empty the caches of the package's functions, so that a test reaches all functions that it depends on."""
    for function in _caching(sum(name.startswith("lookdev") for name in list(sys.modules))):
        function.cache_clear()


def reach_map(folder: Path) -> Iterator[tuple[str, float, set[str]]]:
    """Read the files in a folder; yield each test, its seconds, and the functions that it and its fixtures reach."""
    reached: dict[str, set[str]] = {}
    seconds: dict[str, float] = {}
    fixtures: dict[str, list[str]] = {}
    for path in folder.glob("*.jsonl"):
        for entry in map(json.loads, path.read_text().splitlines()):
            if "test" in entry:
                fixtures[entry["test"]] = entry["fixtures"]
            else:
                reached.setdefault(entry["owner"], set()).update(entry["reached"])
                seconds[entry["owner"]] = max(seconds.get(entry["owner"], 0.0), entry.get("seconds", 0.0))
    for test, names in fixtures.items():
        if test in seconds:
            yield test, seconds[test], reached[test].union(*(reached.get(f"fixture {name}", ()) for name in names))


def pytest_configure(config) -> None:
    if MONITORING is None:
        raise SystemExit("which functions a test reaches is recorded on Python 3.12 or later")
    config.pluginmanager.register(Reach(Path(os.environ[FOLDER])))
