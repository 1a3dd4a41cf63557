"""Findings in the looks of a file, as data and as text."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import groupby
from typing import Any, Literal

Severity = Literal["error", "warning", "note"]
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")

_SHOWN_VARIANTS = 4  # combinations of variants that the text names of one finding; the data has all


@dataclass(frozen=True)
class Finding:
    """A fault of a look, or a note on it.

    `prim` and `input` are its place; both may be empty. `hint` is what would be right. `variants` has the combinations
    of variants with the finding; it is empty for all of them.
    """

    severity: Severity
    prim: str
    input: str
    what: str
    hint: str = ""
    variants: tuple[str, ...] = ()


@dataclass(frozen=True)
class Report:
    """The findings in a file."""

    file: str
    findings: tuple[Finding, ...]
    materials: int = 0
    combinations: int = 0

    @property
    def has_errors(self) -> bool:
        """Whether a look is wrong."""
        return any(finding.severity == "error" for finding in self.findings)

    def data(self) -> dict[str, Any]:
        """Return the report as data for JSON."""
        return asdict(self)

    def text(self) -> str:
        """Return a summary, then the findings by prim."""
        counts = [(severity, sum(each.severity == severity for each in self.findings)) for severity in SEVERITIES]
        found = ", ".join(_number(count, severity) for severity, count in counts if count) or "nothing wrong"
        looks = f"{_number(self.materials, 'material')}, {_number(self.combinations, 'combination')} of variants"
        lines = [f"{self.file}: {found} ({looks})"]
        by_prim = sorted(self.findings, key=lambda each: each.prim)
        for prim, findings in groupby(by_prim, key=lambda each: each.prim):
            lines += ["", prim or "the file"]
            for finding in findings:
                lines += _lines(finding)
        return "\n".join(lines)


def _lines(finding: Finding) -> list[str]:
    what, *more = finding.what.split("\n")  # an expression is shown with a caret on lines of its own
    head = f"  {finding.severity:<7}  "
    margin = " " * len(head)
    lines = [head + (f"{finding.input}: " if finding.input else "") + what, *(margin + line for line in more)]
    if finding.hint:
        lines.append(f"{margin}hint: {finding.hint}")
    if finding.variants:
        shown = " | ".join(finding.variants[:_SHOWN_VARIANTS])
        rest = len(finding.variants[_SHOWN_VARIANTS:])
        lines.append(f"{margin}in: {shown}" + (f" and {rest} more" if rest else ""))
    return lines


def _number(count: int, name: str) -> str:
    return f"{count} {name}" + ("" if count == 1 else "s")
