"""Measures idle cores and free memory of this machine, by proc(5) and cgroups(7).

From these figures, executors decide how many workers to start.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from lookdev.rendering.threads import usable_cores

_TICKS = os.sysconf("SC_CLK_TCK")  # clock ticks per second: the unit of times in /proc is one tick
_RESERVE = 0.1  # the share of the machine's memory that is left to other processes
_MIN_GAIN = 0.5  # another worker needs at least this share of the cores that a worker uses now to be idle
_START_SECONDS = 30.0  # with less work than this left, another worker gains little: starting and compiling take time
_GROWTH = 1.5  # another worker may need this factor times the peak memory that a worker has used so far


@dataclass(frozen=True)
class CpuUse:
    """A measurement of the use of cores. Two measurements give the use in between."""

    clock: float  # seconds of `time.monotonic`
    processes: float  # core seconds that some processes have used since they started
    machine: float  # core seconds that all processes have used on the cores that this process may use

    @classmethod
    def of(cls, processes: Iterable[int]) -> CpuUse:
        """Measure the use by some running processes, given by their ids, and by this process."""
        used = sum(map(_cpu_seconds, {os.getpid(), *processes}))
        allowed = {f"cpu{number}" for number in os.sched_getaffinity(0)}
        rows = (line.split() for line in Path("/proc/stat").read_text().splitlines())
        # A row of /proc/stat has the ticks in these states: user, nice, system, idle, waiting, interrupts (two
        # numbers), stolen by a hypervisor. All except idle and waiting are use.
        busy = sum(sum(map(int, row[1:4])) + sum(map(int, row[6:9])) for row in rows if row[0] in allowed)
        return cls(time.monotonic(), used, busy / _TICKS)


def idle_cores(before: CpuUse, now: CpuUse) -> float:
    """Return the mean number of idle cores between two measurements."""
    seconds = now.clock - before.clock
    used = max(now.processes - before.processes, now.machine - before.machine)
    return max(usable_cores() - used / seconds, 0.0) if seconds > 0.0 else 0.0


def is_worker_worthwhile(workers: int, idle: float, left: float, memory: int, free: int) -> bool:
    """Return whether one more worker gains more than it costs.

    workers : the number of workers that run now; idle : the number of idle cores; left : the seconds of work that
    remain for each worker; memory : the bytes that a worker takes; free : the free bytes.
    """
    used = (usable_cores() - idle) / workers
    return idle > 0.0 and idle >= _MIN_GAIN * used and left > _START_SECONDS and free > _GROWTH * memory


def free_memory() -> int:
    """Return the bytes that more processes can take, within the limit of a container if there is one."""
    rows = dict(line.split(":", 1) for line in Path("/proc/meminfo").read_text().splitlines())
    total, free = (1024 * int(rows[key].split()[0]) for key in ("MemTotal", "MemAvailable"))
    with suppress(OSError, ValueError):  # no limit, or no such cgroup
        folder = Path("/sys/fs/cgroup")
        limit, used = (int((folder / name).read_text()) for name in ("memory.max", "memory.current"))
        total, free = min(total, limit), min(free, limit - used)
    return max(int(free - _RESERVE * total), 0)


def _cpu_seconds(process: int) -> float:
    """Return the core seconds, in user and system mode, that a process has used since it started."""
    try:
        times = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[11:13]
    except OSError:  # the process has ended
        return 0.0
    return sum(map(int, times)) / _TICKS
