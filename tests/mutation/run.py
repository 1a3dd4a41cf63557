"""Running mutants: each in a copy of the checkout, against the tests that reach its function, until one fails."""

import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import replace
from itertools import accumulate, pairwise
from pathlib import Path
from queue import SimpleQueue

from mutant import ROOT, Mutant, mutated_source
from reach import reach_map

MARKERS = {"default": "not proof and not bench and not chaos", "proof": "proof"}
HANGS = "a test that does not end"
# Seconds of tests that run before others are collected: to collect all files that reach a function can take longer.
STAGES = (2.0, 20.0)
FACTOR, LEAST = 10.0, 300.0  # a mutant that takes this many times as long as its tests, and five minutes, hangs
LONG = 1.0  # seconds of a test that is run again where it fails
SLOWER, SHORTEST = 5, 30  # a test that takes this many times as long as it does alone, and half a minute, hangs


class Reached:
    """The tests by what they reach, as `reach.py` recorded it."""

    def __init__(self, folder: Path) -> None:
        self._tests = list(reach_map(folder))

    @property
    def tests(self) -> list[tuple[str, float]]:
        """All tests, by files."""
        return sorted((test, seconds) for test, seconds, _ in self._tests)

    def tests_of(self, function: str) -> list[tuple[str, float]]:
        """Return the tests that reach a function, or where none does, its module; the fastest first.

        Tests of similar duration stay together by file, whose fixtures they share, those of the function's room first.
        """
        module = function.partition(":")[0] + ":"
        room = f"tests/{module.split('/')[1]}/"
        found = [(test, seconds) for test, seconds, reached in self._tests if function in reached]
        if not found:
            found = [(t, seconds) for t, seconds, reached in self._tests if any(f.startswith(module) for f in reached)]

        def order(entry: tuple[str, float]) -> tuple[int, bool, str]:
            return round(math.log2(entry[1] + 0.02)), not entry[0].startswith(room), entry[0]

        return sorted(found, key=order)


class Copy:
    """A copy of the checkout in which one mutant at a time is planted."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        names = subprocess.run(
            ["git", "ls-files", "-coz", "--exclude-standard"], cwd=ROOT, capture_output=True, check=True, text=True
        ).stdout
        for name in filter(None, names.split("\0")):
            target = folder / "tree" / name
            target.parent.mkdir(parents=True, exist_ok=True)
            if (ROOT / name).exists():
                shutil.copy2(ROOT / name, target)
        self._stamp = time.time()

    @contextmanager
    def planted(self, mutant: Mutant) -> Iterator[None]:
        path = self.folder / "tree" / mutant.path
        source = path.read_text()
        mutated = mutated_source(source, mutant)
        assert mutated is not None, f"not in the code: {mutant}"
        try:
            self._write(path, mutated)
            yield
        finally:
            self._write(path, source)

    def _write(self, path: Path, text: str) -> None:
        """Write a module with a time of its own, by which Python sees that compiled code is of another text."""
        self._stamp += 2.0
        path.write_text(text)
        os.utime(path, (self._stamp, self._stamp))

    def test(self, tests: Sequence[tuple[str, float]], marker: str, failures: int = 1) -> list[str]:
        """Run tests in this order until so many fail; return their names."""
        order = self.folder / "order"
        order.write_text("\n".join(test for test, _ in tests))
        files = sorted({test.partition("::")[0] for test, _ in tests})
        scratch = Path(tempfile.mkdtemp())  # not in the folder: sockets in it have short paths
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join((str(self.folder / "tree"), str(Path(__file__).parent))),
            "PYTHONPYCACHEPREFIX": str(self.folder / "compiled"),
            "PYTHONDONTWRITEBYTECODE": "",
            "TMPDIR": str(scratch),
            "LOOKDEV_TEST_ORDER": str(order),
        }
        options = ["-q", f"--maxfail={failures}", "-n", "0", "-p", "order", "-p", "no:cacheprovider", "-m", marker]
        patience = max(SHORTEST, math.ceil(SLOWER * max(seconds for _, seconds in tests)))
        options += ["--tb=no", f"--timeout={patience}"]
        limit = max(LEAST, FACTOR * sum(seconds for _, seconds in tests))
        process = subprocess.Popen(
            [sys.executable, "-m", "pytest", *options, *files],
            cwd=self.folder / "tree",
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        try:
            output, _ = process.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            return [HANGS]
        finally:
            end_all(process, self.folder)
            shutil.rmtree(scratch, ignore_errors=True)
        if process.returncode in (0, 5):
            return []
        lines = (line for line in output.splitlines() if line.startswith(("FAILED ", "ERROR ")))
        names = [line.partition(" ")[2].partition(" - ")[0] for line in lines]
        return names or [f"the tests' collection: {output[-500:]}"]


def end_all(process: subprocess.Popen[str], folder: Path) -> None:
    """End what a run of the tests has started, also in sessions of its own: all that works in a folder."""
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    if process.stdout:
        process.stdout.close()
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if str(folder).encode() in (entry / "environ").read_bytes():
                os.kill(int(entry.name), signal.SIGKILL)
        except (OSError, ValueError):
            continue


def stages(tests: Sequence[tuple[str, float]], within: float) -> Iterator[list[tuple[str, float]]]:
    """Yield the tests of the first `within` seconds in their order, the fastest alone: most mutants need few files."""
    totals = list(accumulate(seconds for _, seconds in tests))
    ends = [0, *(bisect_right(totals, limit) for limit in (*(stage for stage in STAGES if stage < within), within))]
    yield from filter(None, ([*tests[first:last]] for first, last in pairwise(ends)))


def failing(copy: Copy, tests: Sequence[tuple[str, float]], marker: str) -> str:
    """Return the first test that fails, "" if none does.

    A long test counts if it fails twice: of hundreds that wait for programs, one may fail without a fault.
    """
    names, seconds = [test for test, _ in tests], dict(tests)
    for name in copy.test(tests, marker):
        if seconds.get(name, 0.0) < LONG or copy.test([(name, seconds[name])], marker):
            return name
        return failing(copy, tests[names.index(name) + 1 :], marker)
    return ""


def run_mutants(
    mutants: Sequence[Mutant], reached: Reached, tier: str, jobs: int, within: float = math.inf
) -> Iterator[Mutant]:
    """Yield mutants with what killed them, as results come.

    Those that tests of `within` seconds do not find, where there are more, are yielded as they were: without a result.
    """
    folder = Path(tempfile.mkdtemp(prefix="mutants-"))
    copies: SimpleQueue[Copy] = SimpleQueue()
    for job in range(jobs):
        copies.put(Copy(folder / str(job)))

    def run(mutant: Mutant) -> Mutant:
        tests, copy = reached.tests_of(mutant.function), copies.get()
        try:
            with copy.planted(mutant):
                killed_by = next(
                    filter(None, (failing(copy, part, MARKERS[tier]) for part in stages(tests, within))), ""
                )
        finally:
            copies.put(copy)
        if not killed_by and sum(seconds for _, seconds in tests) > within:
            return mutant
        return replace(mutant, killed_by=killed_by, tier=tier)

    try:
        with ThreadPoolExecutor(jobs) as pool:
            for future in as_completed([pool.submit(run, mutant) for mutant in mutants]):
                yield future.result()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def failing_without_a_fault(reached: Reached) -> list[str]:
    """Return the tests that fail in a copy without a mutant: they would seem to find every fault."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        return Copy(Path(folder)).test(reached.tests, MARKERS["default"], failures=1000)
