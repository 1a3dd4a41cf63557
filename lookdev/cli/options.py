"""Arguments and options that several commands share, and the functions with which commands print."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from lookdev.errors import replace_controls

JobFile = Annotated[Path, Argument(metavar="JOB", help="The job file, TOML.")]
LookFile = Annotated[Path, Argument(metavar="LOOK", help="The look, a USD file.")]
Prim = Annotated[str | None, Option(metavar="PATH", help="The material, if the file has several.")]
VariantOptions = Annotated[
    list[str] | None, Option(metavar="SET=VARIANT", help="The variant of a set; repeatable, once for each set.")
]
AsJson = Annotated[bool, Option("--json", help="Write one JSON document instead of text.")]


def say(text: str, *, err: bool = False) -> None:
    """Print a text to stdout, or to stderr if `err`; question marks replace control characters, as in file names."""
    typer.echo(replace_controls(text), err=err)


def say_notes(notes: Iterable[object]) -> None:
    """Print notes for the user to stderr: stdout has only the answer of a command."""
    for note in notes:
        say(f"note: {note}", err=True)


def say_json(data: object) -> None:
    """Print data as a JSON document; NaN and infinity, which JSON lacks, become null."""
    say(json.dumps(_replace_nonfinite(data), indent=2, allow_nan=False))


def _replace_nonfinite(data: object) -> object:
    """Return JSON data with None in place of NaN and infinity."""
    if isinstance(data, Mapping):
        return {key: _replace_nonfinite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_replace_nonfinite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data


@contextmanager
def stdout_to_stderr() -> Iterator[None]:
    """Redirect stdout to stderr in the block, since what libraries print there is not part of a command's answer."""
    sys.stdout.flush()
    saved_stdout = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        os.dup2(saved_stdout, 1)
        os.close(saved_stdout)
