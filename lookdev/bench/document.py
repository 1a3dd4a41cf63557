"""Measured text in a document, between markers: ``<!-- bench: NAME -->`` and ``<!-- end -->``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from lookdev.cache import write_file
from lookdev.errors import LookdevError
from lookdev.text import read_text

END = "<!-- end -->"


def marker(name: str) -> str:
    """Return the line before a measured text."""
    return f"<!-- bench: {name} -->"


def check_document(file: Path, name: str) -> None:
    """Raise LookdevError unless a document has the markers of a text, each once and in order."""
    _split(file, name)


def write_section(file: Path, name: str, text: str) -> None:
    """Replace the text between markers, and nothing else; the file is written whole or not at all."""
    before, after = _split(file, name)
    write_file(file, f"{before}\n{text.strip()}\n{after}")


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table; all columns but the first are numbers."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _split(file: Path, name: str) -> tuple[str, str]:
    parts = read_text(file).split(f"{marker(name)}\n")
    middle, end, after = parts[-1].partition(END)
    if len(parts) != 2 or not end or "<!-- bench:" in middle:
        raise LookdevError(f"{file}: measured text goes between the lines '{marker(name)}' and '{END}', once")
    return f"{parts[0]}{marker(name)}\n", f"{end}{after}"
