"""Tests mutants: plants each in a copy of the checkout, and runs the tests that reach its function until one fails."""

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

MARKERS = {"default": "not proof and not bench and not chaos", "proof": "proof"}  # option -m of pytest, by tier
HANGS = "a test that does not end"
# The fastest tests of a mutant run first, in stages that end at these sums of seconds. To collect all test files that
# reach a function can take longer than to run these tests.
STAGES = (2.0, 20.0)
FACTOR, LEAST = 10.0, 300.0  # a run hangs if it takes longer than FACTOR times the seconds of its tests and than LEAST
LONG = 1.0  # a test that takes this number of seconds or more is run again if it fails
SLOWER, SHORTEST = 5, 30  # a test hangs if it takes longer than SLOWER times the longest of the run, and than SHORTEST


class Reached:
    """The tests, with the functions that they reach and their seconds, as `reach.py` has recorded them."""

    def __init__(self, folder: Path) -> None:
        self._tests = list(reach_map(folder))

    @property
    def tests(self) -> list[tuple[str, float]]:
        """All tests with their seconds, sorted by name, so that the tests of a file are together."""
        return sorted((test, seconds) for test, seconds, _ in self._tests)

    def tests_of(self, function: str) -> list[tuple[str, float]]:
        """Return the tests that reach a function, or if there are none, its module, with their seconds; fastest first.

        Among tests of similar duration, those in the test folder of the function's package are first. The tests of a
        file stay together, because they share fixtures.
        """
        module = function.partition(":")[0] + ":"
        room = f"tests/{module.split('/')[1]}/"
        tests = [(test, seconds) for test, seconds, reached in self._tests if function in reached]
        if not tests:
            tests = [(t, seconds) for t, seconds, reached in self._tests if any(f.startswith(module) for f in reached)]

        def order(entry: tuple[str, float]) -> tuple[int, bool, str]:
            # With the addend of 0.02 s, tests that take next to no time are in one class of duration.
            return round(math.log2(entry[1] + 0.02)), not entry[0].startswith(room), entry[0]

        return sorted(tests, key=order)


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
        """Plant a mutant in the copy, and remove it at the end of the context."""
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
        """Write a module with a new modification time, so that Python does not use compiled code of another text."""
        self._stamp += 2.0
        path.write_text(text)
        os.utime(path, (self._stamp, self._stamp))

    def test(self, tests: Sequence[tuple[str, float]], marker: str, failures: int = 1) -> list[str]:
        """Run tests in this order until a number of failures; return the names of the tests that fail.

        `tests` are names and seconds. If the run hangs, `HANGS` is returned in place of names.
        """
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
        timeout = max(SHORTEST, math.ceil(SLOWER * max(seconds for _, seconds in tests)))
        options += ["--tb=no", f"--timeout={timeout}"]
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
    """Kill a run of the tests, and all processes with a folder in their environment, which the tests have started."""
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
    """Yield the tests of the first `within` seconds in groups, which end at `STAGES`.

    Most mutants are found by the first group, which needs few files.
    """
    totals = list(accumulate(seconds for _, seconds in tests))
    ends = [0, *(bisect_right(totals, limit) for limit in (*(stage for stage in STAGES if stage < within), within))]
    yield from filter(None, ([*tests[first:last]] for first, last in pairwise(ends)))


def failing(copy: Copy, tests: Sequence[tuple[str, float]], marker: str) -> str:
    """Return the name of the first test that fails, or "" if none does.

    A long test only counts if it fails twice. Hundreds of long tests wait for programs, and one of them may fail
    without a fault.
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
    """Test mutants in parallel; yield each with its result, in the order of the results.

    For each mutant, `within` limits the seconds of the tests that run. If none of them fails and there are more tests,
    the mutant is yielded without a result.
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
    """Return the tests that fail in a copy without a mutant. They would seem to find every mutant."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        return Copy(Path(folder)).test(reached.tests, MARKERS["default"], failures=1000)
