"""Path mapping: where files of the machine that wrote a job are on this one, by rules of Open Job Description.

- "How Jobs Are Run", Open Job Description, section Path Mapping (schema pathmapping-1.0)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath, PurePosixPath, PureWindowsPath
from typing import Any

from lookdev.errors import Fault, JobError
from lookdev.text import TextError, parse_json, read_text

_FORMATS: dict[str, type[PurePath]] = {"POSIX": PurePosixPath, "WINDOWS": PureWindowsPath}


@dataclass(frozen=True)
class PathRule:
    """Paths in `source`, a folder of another machine, are in `target` here."""

    source: PurePath
    target: Path

    def mapped(self, path: str) -> Path | None:
        """Return where a path is; None where the rule is not about it."""
        given = type(self.source)(path)
        return self.target / given.relative_to(self.source) if given.is_relative_to(self.source) else None


PathRules = Sequence[PathRule]


def read_rules(file: Path) -> tuple[PathRule, ...]:
    """Read the rules of a session, the longest source first, as they apply; raises JobError."""
    try:
        data = parse_json(read_text(file), file)
    except TextError as error:
        raise JobError(error.faults) from None
    rules: Any
    match data:
        case {"version": "pathmapping-1.0", **rest}:
            rules = rest.get("path_mapping_rules", [])
        case {} if not data:  # of a session without rules
            rules = []
        case _:
            raise JobError([Fault(str(file), "version", "is not 'pathmapping-1.0'", "name a file of OpenJD's rules")])
    found = [_rule(file, number, rule) for number, rule in enumerate(rules)]
    return tuple(sorted(found, key=lambda rule: -len(rule.source.parts)))


def _rule(file: Path, number: int, rule: Any) -> PathRule:
    match rule:
        case {"source_path_format": form, "source_path": str(source), "destination_path": str(target)} if (
            form in _FORMATS
        ):
            return PathRule(_FORMATS[form](source), Path(target))
    what = "needs source_path_format (POSIX or WINDOWS), source_path and destination_path"
    raise JobError([Fault(str(file), f"path_mapping_rules[{number}]", what)])


def mapped(path: str, rules: PathRules) -> str:
    """Return where a path of a job is on this machine: by the first rule about it, else where it says."""
    return next((str(place) for rule in rules if (place := rule.mapped(path)) is not None), path)
