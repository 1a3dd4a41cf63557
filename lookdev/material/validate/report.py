"""The report of `lookdev validate` on the looks of a file, as data and as text."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import groupby
from typing import Literal

Severity = Literal["error", "warning", "note"]
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")
"""The severities of findings, the worst first."""

_MAX_LISTED_COMBINATIONS = 4  # combinations of variants that the text lists for one finding; the data has all


@dataclass(frozen=True)
class ValidationFinding:
    """A fault of a look, or a note on it.

    `prim` is the path of the prim concerned, and `input` the name of a property of that prim; both may be empty. `what`
    states the fault, and `hint` what would be right. `variants` has the combinations of variants that have the fault;
    it is empty where all have it.
    """

    severity: Severity
    prim: str
    input: str
    what: str
    hint: str = ""
    variants: tuple[str, ...] = ()


@dataclass(frozen=True)
class ValidationReport:
    """The findings in a file.

    `materials` and `combinations` are the numbers of the materials and of the combinations of variants examined.
    """

    file: str
    findings: tuple[ValidationFinding, ...]
    materials: int = 0
    combinations: int = 0

    @property
    def has_errors(self) -> bool:
        """Whether a finding is an error."""
        return any(finding.severity == "error" for finding in self.findings)

    def data(self) -> dict[str, object]:
        """Return the report as data for JSON."""
        return asdict(self)

    def text(self) -> str:
        """Return the report as text: a line of summary, then the findings by prim."""
        counts = [(severity, sum(finding.severity == severity for finding in self.findings)) for severity in SEVERITIES]
        summary = ", ".join(_count_text(count, severity) for severity, count in counts if count) or "nothing wrong"
        materials, combinations = _count_text(self.materials, "material"), _count_text(self.combinations, "combination")
        lines = [f"{self.file}: {summary} ({materials}, {combinations} of variants)"]
        by_prim = sorted(self.findings, key=lambda finding: finding.prim)
        for prim, findings in groupby(by_prim, key=lambda finding: finding.prim):
            lines += ["", prim or "the file"]
            for finding in findings:
                lines += _finding_lines(finding)
        return "\n".join(lines)


def _finding_lines(finding: ValidationFinding) -> list[str]:
    """Return the lines of text for a finding."""
    first_line, *more = finding.what.split("\n")  # a faulty expression and its caret are on further lines
    head = f"  {finding.severity:<7}  "
    margin = " " * len(head)
    lines = [head + (f"{finding.input}: " if finding.input else "") + first_line, *(margin + line for line in more)]
    if finding.hint:
        lines.append(f"{margin}hint: {finding.hint}")
    if finding.variants:
        combinations = " | ".join(finding.variants[:_MAX_LISTED_COMBINATIONS])
        rest = len(finding.variants[_MAX_LISTED_COMBINATIONS:])
        lines.append(f"{margin}in: {combinations}" + (f" and {rest} more" if rest else ""))
    return lines


def _count_text(count: int, name: str) -> str:
    """Return a number with a noun in singular or plural."""
    return f"{count} {name}" + ("" if count == 1 else "s")
