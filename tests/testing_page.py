"""The parts of docs/testing.md that commands write: each between two comments with its name."""

from pathlib import Path

PAGE = Path(__file__).resolve().parents[1] / "docs" / "testing.md"


def _parts(name: str) -> tuple[str, str, str]:
    """Return the page before a part, the part, and the page after it, with the comments outside of the part."""
    begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
    head, _, rest = PAGE.read_text().partition(begin)
    part, _, tail = rest.partition(end)
    return head + begin, part, end + tail


def read_part(name: str) -> str:
    return _parts(name)[1]


def write_part(name: str, text: str) -> None:
    """Replace a part; the text ends with a line break."""
    head, _, tail = _parts(name)
    PAGE.write_text(head + text + tail)
