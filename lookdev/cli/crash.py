"""Report files about unexpected exceptions, which a user sends to the developers."""

from __future__ import annotations

import os
import platform
import shlex
import tempfile
import traceback
from collections.abc import Iterator, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from importlib import metadata
from pathlib import Path

from lookdev.cache import cache_dir, write_file
from lookdev.errors import OutputError, shorten

DISTRIBUTIONS = ("lookdev", "bpy", "numpy", "usd-core")
"""Installed distributions (packages of pip) whose versions a report contains."""


def record_crash(error: Exception, command: Sequence[str]) -> str:
    """Write a report file about an exception of a command line; return a line for the user that names the file.

    The file is in the cache folder, or, if this folder cannot be written, in the folder of temporary files. If neither
    can be written, the returned text has the report after the line. A report contains the job files that the command
    line names.
    """
    now = datetime.now(UTC)
    report = "\n".join(_report_lines(error, command, now)) + "\n"
    headline = shorten(f"internal error: {type(error).__name__}: {error}".partition("\n")[0])
    for folder in (partial(cache_dir, "reports"), tempfile.gettempdir):
        with suppress(OSError, OutputError):
            file = Path(folder(), f"lookdev-{now:%Y%m%d-%H%M%S}-{os.getpid()}.txt")
            write_file(file, report.encode("utf-8", "backslashreplace"))
            return f"{headline}; this is a defect of lookdev, please send its developers the report {file}"
    return f"{headline}; no report file can be written, so the report follows\n{report}"


def _report_lines(error: Exception, command: Sequence[str], now: datetime) -> Iterator[str]:
    """Yield the entries of a report: the command line, the system, the traceback and the job files."""
    yield f"command: {shlex.join(command)}"
    yield f"folder: {os.environ.get('PWD', 'unknown')}"
    yield f"time: {now.isoformat(timespec='seconds')}"
    yield f"system: {platform.platform()}"
    yield f"python: {platform.python_version()}"
    for distribution in DISTRIBUTIONS:
        try:
            yield f"{distribution}: {metadata.version(distribution)}"
        except metadata.PackageNotFoundError:
            yield f"{distribution}: not installed"
    yield f"\n{''.join(traceback.format_exception(error))}"
    for job in (Path(argument) for argument in command if argument.endswith(".toml")):
        with suppress(OSError):
            yield f"{job}:\n\n{job.read_text(encoding='utf-8', errors='backslashreplace')}"
