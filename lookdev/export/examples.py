"""Lists the example jobs that ship with lookdev, and copies them with the files that they need.

This is for `lookdev example`.
"""

from __future__ import annotations

import filecmp
import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lookdev.cache import output_errors, write_file
from lookdev.errors import LookdevError, OutputError, nearest_hint
from lookdev.job import load_job
from lookdev.run.manifest import input_files
from lookdev.safe_text import align_columns
from lookdev.shipped import shipped_folder

_TIME_COMMENT = re.compile(r"^# About (\d+) (s|min) on two cores\.$", re.MULTILINE)
_SECONDS = {"s": 1, "min": 60}


@dataclass(frozen=True)
class Example:
    """A shipped job: its file, its title, and its render time on two cores in seconds.

    The title and the time are comments in the file. The time is 0 if the file has none.
    """

    file: Path
    title: str
    seconds: int

    @property
    def name(self) -> str:
        """The name of the example: the name of the file, without suffix."""
        return self.file.stem


@dataclass(frozen=True)
class CopiedExample:
    """The copied job file, and the number of files that were written, including the job."""

    job: Path
    written: int

    def summary(self) -> str:
        """Return the result as text, with the command that renders the job."""
        result = f"{self.written} files written" if self.written else "every file is there already"
        return f"{self.job}: {result}; next: lookdev render {shlex.quote(str(self.job))}"


def list_examples() -> tuple[Example, ...]:
    """Return the shipped jobs, quickest first."""
    examples = []
    for file in shipped_folder().joinpath("jobs").glob("*.toml"):
        text = file.read_text(encoding="utf-8")
        time = _TIME_COMMENT.search(text)
        title = text.partition("\n")[0].removeprefix("# ")
        examples.append(Example(file, title, int(time[1]) * _SECONDS[time[2]] if time else 0))
    return tuple(sorted(examples, key=lambda example: (example.seconds, example.name)))


def examples_text(examples: Sequence[Example]) -> str:
    """Return an aligned table of examples (name, time on two cores, title) and the command that copies one."""
    rows = []
    for example in examples:
        seconds = example.seconds
        time = f"{round(seconds / 60)} min" if seconds >= 60 else f"{seconds} s" if seconds else ""
        rows.append((example.name, f"{time:>6}", example.title))
    hint = "Times are for two cores. To copy one into this folder: lookdev example first"
    return "\n".join([*align_columns(rows), "", hint])


def copy_example(name: str, to: Path, *, force: bool = False) -> CopiedExample:
    """Copy a shipped job with its looks, presets and textures, as ``jobs/<name>.toml`` and ``materials/...`` in `to`.

    Raises
    ------
    LookdevError
        No shipped job has that name.
    OutputError
        Without `force`, a file exists and differs; then nothing is written. Or a file cannot be written.
    """
    examples = {example.name: example for example in list_examples()}
    if name not in examples:
        raise LookdevError(f"there is no example '{name}' ({nearest_hint(name, list(examples))})")
    root, source = shipped_folder(), examples[name].file
    targets = {file: to / file.relative_to(root) for file in input_files(load_job(source))}
    stale = [file for file, target in targets.items() if not (target.is_file() and filecmp.cmp(file, target, False))]
    differing = [str(targets[file]) for file in stale if targets[file].exists()]
    if differing and not force:
        hint = "--force replaces what differs, --to names another folder"
        raise OutputError(f"these files exist and differ from the example's: {', '.join(differing)} ({hint})")
    with output_errors(to, "the example cannot be written"):
        for file in stale:
            # The file's mode is not copied, because an installed file may be read-only.
            write_file(targets[file], file.read_bytes())
    return CopiedExample(targets[source], len(stale))
