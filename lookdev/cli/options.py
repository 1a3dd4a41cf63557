"""Arguments and options that several verbs share."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

JobFile = Annotated[Path, typer.Argument(metavar="JOB", help="The job file, TOML.", show_default=False)]
LookFile = Annotated[Path, typer.Argument(metavar="LOOK", help="The look, a USD file.", show_default=False)]
Prim = Annotated[
    str | None,
    typer.Option("--prim", metavar="PATH", help="The material, where the file has several.", show_default=False),
]
Variants = Annotated[
    list[str] | None,
    typer.Option(
        "--variants",
        metavar="SET=VARIANT",
        help="The variant of a set; repeatable, once for each set.",
        show_default=False,
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Write one JSON document instead of text.")]


@contextmanager
def nothing_printed() -> Iterator[None]:
    """Turn what libraries print to stdout, before the answer of a verb, to stderr."""
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
