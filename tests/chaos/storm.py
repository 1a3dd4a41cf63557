"""Runs of one job at once, in chunks and whole, while faults of every kind happen to them; then what is on disk.

Runs are forked from this process, which has imported all they need: so a thousand of them start in minutes. Leases and
patience are seconds, so that what stands still is noticed. ``python tests/chaos/storm.py KILLS`` prints the figures.

Where file systems may be mounted, the output is one of a few megabytes; once in a storm of `LONG` kills it is read-only
for a minute. Where libfaketime is preloaded, the clocks of most runs and their workers are an hour off::

    pip install libfaketime
    eval "$(python-libfaketime)"
    python tests/chaos/storm.py 300
"""

import ctypes
import itertools
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import batch_case as case
import batches

from lookdev.errors import LookdevError
from lookdev.job import Job
from lookdev.plan.chunks import Chunk, Division
from lookdev.rendering.backends import BACKENDS
from lookdev.run import render as batch
from lookdev.run.runs import LEASE_VARIABLE

CHUNKS, AT_ONCE = 3, 4
LEASE, PATIENCE = 1, 1.5  # seconds
HOUR = 3600.0
TIN = '[[look]]\nname = "tin"\nmaterial = "gold.usda"\n'
TURNTABLES = '[[turntable]]\nkind = "element"\nframes = 8\n[[turntable]]\nkind = "lighting"\nframes = 5\n'
DISK = 3 << 20  # bytes of the small disk
MINUTE, LONG = 60.0, 100  # seconds without writing, in storms of so many kills or more
OTHER_CLOCKS = "libfaketime" in os.environ.get("LD_PRELOAD", "")
ENDED = "ended: "
CAUSES = {
    "disk full": "No space left on device",
    "unwritable": "Operation not permitted|Permission denied|Read-only file system",
    "taken for dead": "this run stood still",
    "frame given up": "frames failed",
}
"""Why a run may end with exit code 1, each by what its message contains."""

READ_ONLY = "read-only for a minute"
KEPT = {"pictures.json", "digests.json", "plan.json", "worker.log"}


@dataclass
class Figures:
    """What a storm did; how runs ended, by their exit codes; the causes of exit code 1, of `CAUSES`."""

    faults: Counter[str] = field(default_factory=Counter)
    ends: Counter[int] = field(default_factory=Counter)
    causes: Counter[str] = field(default_factory=Counter)
    rounds: int = 0

    @property
    def kills(self) -> int:
        return self.faults["run killed"] + self.faults["worker killed"]


def write_job(folder: Path) -> Path:
    (folder / "gold.usda").touch()
    file = folder / "job.toml"
    file.write_text(case.JOB + TIN + TURNTABLES + case.RENDER)
    return file


def render(job: Path, chunk: Chunk | None, frame_seconds: float, clock: str = "") -> int:
    """Render a job as the command line does, with the quick worker; return the exit code.

    `clock` is how far that of the run is off, as libfaketime has it, where that is preloaded.
    """
    os.environ["FAKETIME"] = clock or "+0"

    def prepare(job: Job, ahead: object) -> Any:
        return SimpleNamespace(job=job, notes=(), plan=case.make_plan(job))

    command = (sys.executable, "-S", "-E", str(Path(__file__).with_name("quick_worker.py")), str(frame_seconds))
    BACKENDS["exact"] = replace(BACKENDS["exact"], command=command)
    batch._open_executor = partial(batch._open_executor, timeout=PATIENCE)  # type: ignore[assignment]
    try:
        result = batch.render_job(job, prepare=prepare, chunk=chunk)
    except LookdevError as error:
        why, code = str(error), 1
    else:
        why, code = result.summary(), result.exit_code
    if code:
        sys.stderr.write(f"{ENDED}{' '.join(why.splitlines())}\n")
    return code


def forked(program: Callable[[], int], log: Path) -> int:
    """Run a program in a fork of this process, and return its process id."""
    child = os.fork()
    if child:
        return child
    code = 70
    try:
        os.dup2(os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND), 2)
        os.environ[LEASE_VARIABLE] = str(LEASE)
        code = program()
    except BaseException:  # noqa: BLE001  it must not go on as its parent
        import traceback

        traceback.print_exc()
    finally:
        os._exit(code)


def children(process: int) -> list[int]:
    try:
        return [int(each) for each in Path(f"/proc/{process}/task/{process}/children").read_text().split()]
    except (FileNotFoundError, ProcessLookupError):
        return []


def ended(process: int | None) -> bool:
    """Return whether there is no such process, or nobody has asked yet how it ended."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] in "ZX"
    except (FileNotFoundError, ProcessLookupError):
        return True


def inherit_orphans() -> None:
    """Become the parent of processes whose parents, runs of a storm, are killed (PR_SET_CHILD_SUBREAPER)."""
    ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)


def await_orphans() -> None:
    """Wait until no child is left; raises AssertionError where one outlives its run by more than ten seconds."""
    until = time.monotonic() + 10.0
    with suppress(ChildProcessError):
        while time.monotonic() < until:
            if os.waitpid(-1, os.WNOHANG)[0] == 0:
                time.sleep(0.02)
        raise AssertionError(f"processes {children(os.getpid())} outlive their runs")


@contextmanager
def small_disk(folder: Path) -> Iterator[bool]:
    """Mount a file system of some megabytes; yield whether that is allowed."""
    folder.mkdir(exist_ok=True)
    mount = ["mount", "-t", "tmpfs", "-o", f"size={DISK}", "storm", str(folder)]
    mounted = shutil.which("mount") is not None and subprocess.run(mount, capture_output=True).returncode == 0
    try:
        yield mounted
    finally:
        if mounted:
            subprocess.run(["umount", "-l", str(folder)], check=True)


class Storm:
    """A round of a storm over the output of a job."""

    def __init__(self, folder: Path, rng: random.Random, figures: Figures, disk: bool, long: bool) -> None:
        self._job, self._out, self._log = folder / "job.toml", folder / "out", folder / "errors.log"
        self._rng, self._figures, self._long = rng, figures, long
        self._runs: dict[int, Chunk | None] = {}
        self._done = False
        self._later: list[tuple[float, Callable[[], None]]] = []
        self._again = self._writable = 0.0  # when such a fault may happen next; when a read-only disk is no more
        self._faults: dict[str, tuple[float, Callable[[], bool]]] = {
            "run killed": (10.0, self._kill_run),
            "worker killed": (6.0, self._kill_worker),
            "run stopped": (1.0, lambda: self._stop(self._any_run())),
            "worker stopped": (1.0, lambda: self._stop(self._any_worker())),
            "clock skewed": (3.0, self._skew),
            "unwritable": (0.5, self._make_unwritable),
            **({"disk full": (0.5, self._fill), READ_ONLY: (0.5, self._make_read_only)} if disk else {}),
        }

    def blow(self, kills: int, longest: float) -> None:
        """Render, with faults until so many kills or seconds, or all frames are done; then let it end."""
        end, target = time.monotonic() + longest, self._figures.kills + kills
        while (
            self._figures.kills < target and time.monotonic() < end and not self._done
        ) or time.monotonic() < self._writable:
            self._keep_running()
            time.sleep(self._rng.uniform(0.0, 0.12))
            self._do_later()
            names = list(self._faults)
            (name,) = self._rng.choices(names, [self._faults[each][0] for each in names])
            if self._faults[name][1]():
                self._figures.faults[name] += 1
        while self._later:
            time.sleep(0.05)
            self._do_later()
        while self._runs:
            self._collect()
            time.sleep(0.02)
        await_orphans()
        for _ in range(20):
            run = self._start(None)
            del self._runs[run]
            if (code := os.waitstatus_to_exitcode(os.waitpid(run, 0)[1])) == 0:
                return
            self._figures.ends[code] += 1
        raise AssertionError(f"the job does not end: {self._log.read_text()[-4000:]}")

    def _keep_running(self) -> None:
        self._collect()
        while len(self._runs) < AT_ONCE:
            number = self._rng.randrange(CHUNKS + 1)
            self._start(Chunk(number, Division(CHUNKS)) if number else None)
            if time.monotonic() < self._writable:
                return  # it ends at once

    def _start(self, chunk: Chunk | None) -> int:
        clock = self._rng.choice(("-1h", "+0", "+1h")) if OTHER_CLOCKS else ""
        self._figures.faults["run with a clock an hour off"] += clock in ("-1h", "+1h")
        run = forked(partial(render, self._job, chunk, self._rng.uniform(0.0, 0.2), clock), self._log)
        self._runs[run] = chunk
        return run

    def _collect(self) -> None:
        for run in list(self._runs):
            if (end := os.waitpid(run, os.WNOHANG))[0]:
                code = os.waitstatus_to_exitcode(end[1])
                self._done = self._done or (code == 0 and self._runs[run] is None)
                del self._runs[run]
                self._figures.ends[code] += 1

    def _do_later(self) -> None:
        now = time.monotonic()
        due = [each for each in self._later if each[0] <= now]
        self._later = [each for each in self._later if each[0] > now]
        for _, do in due:
            do()

    def _any_run(self) -> int | None:
        return self._rng.choice(sorted(self._runs)) if self._runs else None

    def _any_worker(self) -> int | None:
        workers = [worker for run in sorted(self._runs) for worker in children(run)]
        return self._rng.choice(workers) if workers else None

    def _signal(self, process: int | None, number: signal.Signals) -> bool:
        if process is None:
            return False
        with suppress(ProcessLookupError):
            os.kill(process, number)
            return True
        return False

    def _kill_run(self) -> bool:
        """Kill a run; one that has ended before is no kill."""
        before = self._figures.ends[-signal.SIGKILL]
        if self._signal(run := self._any_run(), signal.SIGKILL):
            while run in self._runs:
                self._collect()
        return self._figures.ends[-signal.SIGKILL] > before

    def _kill_worker(self) -> bool:
        worker = self._any_worker()
        return not ended(worker) and self._signal(worker, signal.SIGKILL)

    def _stop(self, process: int | None) -> bool:
        if not self._signal(process, signal.SIGSTOP):
            return False
        until = time.monotonic() + self._rng.uniform(0.5, 3.0) * LEASE
        self._later.append((until, lambda: self._signal(process, signal.SIGCONT) and None))
        return True

    def _skew(self) -> bool:
        """Set times of signs of life, and of a frame, an hour off."""
        done = False
        for file in [*self._out.glob(".lookdev/runs/*"), *list(self._out.glob("*/*/*.exr"))[:1]]:
            with suppress(OSError):
                there = file.stat().st_mtime + self._rng.choice((-HOUR, HOUR))
                os.utime(file, (there, there))
                done = True
        return done

    def _make_unwritable(self) -> bool:
        """Let no file be made, replaced or removed for a while."""
        if time.monotonic() < self._again:
            return False
        folders = [str(path) for path in (self._out, *self._out.rglob("*")) if path.is_dir()]
        if os.geteuid() == 0:
            if subprocess.run(["chattr", "+i", *folders], capture_output=True).returncode:
                subprocess.run(["chattr", "-f", "-i", *folders], capture_output=True)
                return False
            back = ["chattr", "-f", "-i", *folders]
        else:
            subprocess.run(["chmod", "a-w", *folders], capture_output=True)
            back = ["chmod", "u+w", *folders]
        self._again = time.monotonic() + 3.0
        self._later.append((time.monotonic() + 1.0, lambda: subprocess.run(back, capture_output=True) and None))
        return True

    def _make_read_only(self) -> bool:
        """Let the file system be read-only for a minute, once in a long storm, for all that opens files by then."""
        if time.monotonic() < self._again or self._figures.faults[READ_ONLY] or not self._long:
            return False
        out, aside = str(self._out), str(self._out.with_name("aside"))
        Path(aside).mkdir(exist_ok=True)
        # Made where nobody writes: a mount with open files cannot become read-only.
        mounts = ["--bind", out, aside], ["-o", "remount,bind,ro", aside], ["--bind", aside, out]
        for mount in mounts:
            subprocess.run(["mount", *mount], check=True)
        subprocess.run(["umount", "-l", aside], check=True)
        self._writable = time.monotonic() + MINUTE
        self._again = self._writable + 3.0
        self._later.append((self._writable, lambda: subprocess.run(["umount", "-l", out], check=True) and None))
        return True

    def _fill(self) -> bool:
        """Fill the disk for a while."""
        if time.monotonic() < self._again:
            return False
        ballast = self._out / "ballast"
        with suppress(OSError), ballast.open("wb") as stream:
            for size in (1 << 16, 1 << 12, 1):
                with suppress(OSError):
                    while True:
                        stream.write(b"\0" * size)
                        stream.flush()
        self._again = time.monotonic() + 3.0
        self._later.append((time.monotonic() + 1.0, lambda: ballast.unlink(missing_ok=True)))
        return True


def contents(out: Path) -> dict[str, object]:
    """Return all files of an output: `batches.contents` of frames, and bytes of the others but state and manifest."""
    found = batches.contents(out)
    others = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()} - {*found, "manifest.json"}
    return found | {name: (out / name).read_bytes() for name in sorted(others) if not name.startswith(".lookdev/")}


def causes(log: Path) -> Counter[str]:
    """Count the causes of exit code 1 in the log of a storm; raises AssertionError for another than `CAUSES`."""
    found: Counter[str] = Counter()
    for line in log.read_text().splitlines():
        if line.startswith(ENDED):
            known = [cause for cause, text in CAUSES.items() if re.search(text, line)]
            assert known, line
            found[known[0]] += 1
    return found


def check(out: Path, whole: Mapping[str, object]) -> None:
    """Raise AssertionError unless an output is as that of an undisturbed run, and nothing is left over."""
    found = contents(out)
    assert list(found) == list(whole)
    assert [name for name, each in found.items() if each != whole[name]] == []
    assert {path.relative_to(out / ".lookdev").as_posix() for path in (out / ".lookdev").rglob("*")} - KEPT == set()


def storm(folder: Path, kills: int, seed: int, each: int = 40) -> Figures:
    """Let storms of `each` so many kills go over a job until there were `kills`, and check what is left after each."""
    rng, figures = random.Random(seed), Figures()
    calm = folder / "calm"
    calm.mkdir()
    inherit_orphans()
    # The name of the job file is in the headers: both have it from the same folder, one after the other.
    with ExitStack() as stack:
        write_job(calm)
        run = forked(partial(render, calm / "job.toml", None, 0.0), calm / "errors.log")
        assert os.waitpid(run, 0)[1] == 0, (calm / "errors.log").read_text()
        whole = contents(calm / "out")
        shutil.rmtree(calm / "out")
        disk = stack.enter_context(small_disk(calm / "out"))
        for figures.rounds in itertools.count(1):
            Storm(calm, rng, figures, disk, kills >= LONG).blow(min(each, kills - figures.kills), 60.0)
            check(calm / "out", whole)
            figures.causes = causes(calm / "errors.log")
            assert figures.causes.total() == figures.ends[1]
            if figures.kills >= kills:
                return figures
            for path in (calm / "out").iterdir():
                shutil.rmtree(path) if path.is_dir() else path.unlink()
    raise AssertionError


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        started = time.perf_counter()
        found = storm(Path(place), int(sys.argv[1]), int((sys.argv[2:] or ["1"])[0]))
        sys.stdout.write(f"{found} in {time.perf_counter() - started:.0f} s\n")
