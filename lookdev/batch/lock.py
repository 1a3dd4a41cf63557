"""One run at a time in an output folder, and removal of the temporary files of a killed run."""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import socket
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from lookdev.errors import OutputError
from lookdev.render.executors.local import SCRATCH_PREFIX

STATE_FOLDER = ".lookdev"
"""Folder inside the output for lock, log, ledger and scratch files."""

# The names that lookdev.cache.atomic_path gives.
_TEMPORARY = re.compile(r"\..+\.\d+-[0-9a-f]{8}\.[a-z0-9]+")  # of any output


@contextmanager
def output_lock(output: Path) -> Iterator[Path]:
    """Lock an output folder, made if it does not exist, and yield its state folder, without scratch of a killed run.

    The kernel releases the lock when the process ends. Raises OutputError where another run holds it (the message names
    the run), or the folder cannot be written.
    """
    folder = output / STATE_FOLDER
    try:
        folder.mkdir(parents=True, exist_ok=True)
        stream = (folder / "lock").open("a+")
    except OSError as error:
        raise OutputError(f"{output}: the output folder cannot be written: {error.strerror}") from error
    with stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            stream.seek(0)
            holder = stream.read().strip() or "another run"
            raise OutputError(f"{output}: {holder} renders to it; wait for its end, or choose another output") from None
        except OSError as error:
            raise OutputError(f"{output}: its file system gives no locks: {error.strerror}") from error
        for scratch in folder.glob(SCRATCH_PREFIX + "*"):
            # The worker of a killed run may still write to it; the next run removes what remains.
            shutil.rmtree(scratch, ignore_errors=True)
        now = datetime.now(UTC).isoformat(timespec="seconds")
        try:
            stream.truncate(0)
            stream.write(f"process {os.getpid()} on {socket.gethostname()} (since {now})\n")
            stream.flush()
        except OSError as error:  # a full disk
            raise OutputError(f"{output}: the output folder cannot be written: {error.strerror}") from error
        yield folder


def remove_leftovers(folders: Iterable[Path]) -> None:
    """Remove temporary files of a killed run from `folders`. Call with the lock held."""
    for folder in folders:
        if folder.is_dir():
            for path in folder.iterdir():
                if _TEMPORARY.fullmatch(path.name):
                    path.unlink(missing_ok=True)
