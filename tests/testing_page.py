"""Reads and writes the parts of docs/testing.md that commands write; a part is between two comments with its name."""

from pathlib import Path

PAGE = Path(__file__).resolve().parents[1] / "docs" / "testing.md"


def _parts(name: str) -> tuple[str, str, str]:
    """Return the text of the page before a part, the part, and the text after it.

    The comments around the part belong to the first and the last text.
    """
    begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
    head, _, rest = PAGE.read_text().partition(begin)
    part, _, tail = rest.partition(end)
    return head + begin, part, end + tail


def read_part(name: str) -> str:
    """Return the text of a part."""
    return _parts(name)[1]


def write_part(name: str, text: str) -> None:
    """Replace a part by a text, which ends with a line break."""
    head, _, tail = _parts(name)
    PAGE.write_text(head + text + tail)
