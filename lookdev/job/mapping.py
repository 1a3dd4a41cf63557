"""Path mapping on render farms: from paths of the machine that submitted a job to paths of this machine.

Open Job Description defines the rules: "How Jobs Are Run", section Path Mapping (schema pathmapping-1.0).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath, PurePosixPath, PureWindowsPath
from typing import Any

from lookdev.errors import Fault, JobError
from lookdev.safe_text import TextError, parse_json, read_text

_FORMATS: dict[str, type[PurePath]] = {"POSIX": PurePosixPath, "WINDOWS": PureWindowsPath}


@dataclass(frozen=True)
class PathRule:
    """A rule: files below `source`, a folder of another machine, are below `target` on this machine."""

    source: PurePath
    target: Path

    def map_path(self, path: str) -> Path | None:
        """Return the path on this machine; None if `path` is not in the source folder."""
        source_path = type(self.source)(path)
        if not source_path.is_relative_to(self.source):
            return None
        return self.target / source_path.relative_to(self.source)


PathRules = Sequence[PathRule]


def read_rules(file: Path) -> tuple[PathRule, ...]:
    """Read the file of rules of an OpenJD session, and return them in the order in which they apply.

    A rule with a longer source comes first. Raises JobError.
    """
    try:
        data = parse_json(read_text(file), file)
    except TextError as error:
        raise JobError(error.faults) from None
    entries: Any
    match data:
        case {"version": "pathmapping-1.0", **rest}:
            entries = rest.get("path_mapping_rules", [])
        case {} if not data:  # the file of a session without rules is {}
            entries = []
        case _:
            raise JobError([Fault(str(file), "version", "is not 'pathmapping-1.0'", "name a file of OpenJD's rules")])
    rules = [_parse_rule(file, number, entry) for number, entry in enumerate(entries)]
    return tuple(sorted(rules, key=lambda rule: -len(rule.source.parts)))


def _parse_rule(file: Path, number: int, entry: Any) -> PathRule:
    match entry:
        case {"source_path_format": form, "source_path": str(source), "destination_path": str(target)} if (
            form in _FORMATS
        ):
            return PathRule(_FORMATS[form](source), Path(target))
    problem = "needs source_path_format (POSIX or WINDOWS), source_path and destination_path"
    raise JobError([Fault(str(file), f"path_mapping_rules[{number}]", problem)])


def map_path(path: str, rules: PathRules) -> str:
    """Return the path on this machine of a path in a job: by the first rule whose source contains it, or unchanged."""
    return next((str(target) for rule in rules if (target := rule.map_path(path)) is not None), path)
