"""Measures how long the default tier of the tests takes, and writes the times into docs/testing.md.

    python tests/durations.py    # in two processes; on Python 3.13 only the tests marked `both_pythons`

The times of the files are also written to tests/durations.json. By them, conftest.py starts the longest tests first.
"""

import datetime
import json
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

from testing_page import write_part

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / "tests" / "durations.json"
HEAVY = "not proof and not bench and not chaos"  # selects the default tier: all but the heavy tests
SHOWN = 30  # rows of a table


def measure(version: str) -> dict[str, object]:
    """Run the default tier; return its date, its minutes, and the seconds of files and of the longest tests.

    Files have the number of their tests and the seconds.
    """
    marker = HEAVY if version == "3.11" else f"both_pythons and {HEAVY}"
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        command = [sys.executable, "-m", "pytest", "-q", "-n", "2", "-m", marker, f"--junitxml={report}"]
        start = time.monotonic()
        code = subprocess.run(command, cwd=ROOT, check=False).returncode
        minutes = (time.monotonic() - start) / 60.0
        if code not in (0, 1):
            sys.exit(code)
        cases = list(ElementTree.parse(report).iter("testcase"))
    seconds: Counter[str] = Counter()
    count: Counter[str] = Counter()
    tests: Counter[str] = Counter()
    for case in cases:
        file, duration = file_of(case.attrib["classname"]), float(case.attrib["time"])
        seconds[file] += duration
        count[file] += 1
        tests[f"{file}::{case.attrib['name']}"] += duration
    return {
        "date": str(datetime.date.today()),
        "minutes": round(minutes, 1),
        "files": {file: [count[file], round(seconds[file], 2)] for file in sorted(seconds)},
        "tests": {test: round(duration, 2) for test, duration in tests.most_common(SHOWN)},
    }


def file_of(name: str) -> str:
    """Return the path below tests/ of a test module; `name` has dots, and may end with the name of a class."""
    parts = name.split(".")
    while parts and not (ROOT / Path(*parts).with_suffix(".py")).exists():
        parts.pop()
    return "/".join(parts[1:]) + ".py"


def tables(measured: dict[str, dict]) -> str:
    """Return the tables of the page, in Markdown: the totals of each Python version, then files and tests by time."""
    versions = sorted(measured)
    lines = ["| Python | date | tests | minutes, two processes | seconds of tests |", "|---|---|---|---|---|"]
    for version in versions:
        run = measured[version]
        total, duration = map(sum, zip(*run["files"].values(), strict=True))
        lines.append(f"| {version} | {run['date']} | {total} | {run['minutes']} | {duration:.0f} |")
    for title, key in (("file", "files"), ("test", "tests")):
        lines += [
            "",
            f"| {title} | " + " | ".join(f"seconds, {v}" for v in versions) + " |",
            "|---" * (1 + len(versions)) + "|",
        ]
        values = {v: {n: d[1] if key == "files" else d for n, d in measured[v][key].items()} for v in versions}
        names = sorted(set().union(*values.values()), key=lambda name: -max(v.get(name, 0.0) for v in values.values()))
        for name in names[:SHOWN]:
            cells = " | ".join(f"{values[v][name]:.1f}" if name in values[v] else "" for v in versions)
            lines.append(f"| {name.replace('|', ' ')} | {cells} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure with this version of Python, and write the results; those of other versions are kept."""
    version = "{}.{}".format(*sys.version_info[:2])
    measured = json.loads(DATA.read_text()) | {version: measure(version)}
    DATA.write_text(json.dumps(measured, indent=1) + "\n")
    write_part("durations", tables(measured))


if __name__ == "__main__":
    main()
