"""Malformed inputs: each a right result or a clear message, never silence, a traceback, a hang or a crash."""

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path

import pytest
from bombs import BOMBS
from cases import Outcome
from kinds import KINDS
from pool import Child, outcomes

from lookdev.sandbox import MEMORY_VARIABLE, SECONDS_VARIABLE


@pytest.fixture(scope="module")
def child(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Child]:
    with closing(Child(tmp_path_factory.mktemp("fuzz"))) as child:
        yield child


def assert_right(kind: str, seed: int, found: Mapping[int, Outcome]) -> None:
    wrong = [
        f"{outcome.title}: {outcome.outcome}, not {' or '.join(outcome.expected)}: {outcome.text[-1500:]}\n"
        f'python tests/fuzz/rerun.py "{kind}" {seed} {number}'
        for number, outcome in sorted(found.items())
        if not outcome.right
    ]
    assert not wrong, "\n\n".join(wrong)


@pytest.mark.both_pythons
@pytest.mark.parametrize("kind", KINDS)
def test_a_sample_of_malformed_inputs_is_clear(child: Child, kind: str) -> None:
    count = 60 if kind == "USD assets" else 20  # of 2,000 and more, which take little time
    assert_right(kind, 0, child.outcomes(kind, 0, KINDS[kind].sample(0, count)))


@pytest.mark.proof
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_all_malformed_inputs_are_clear(kind: str, seed: int, tmp_path: Path) -> None:
    found = outcomes(kind, seed, range(KINDS[kind].count), tmp_path)
    assert len(found) == KINDS[kind].count
    assert_right(kind, seed, found)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if number == 0 else pytest.mark.proof) for number, name in enumerate(BOMBS)]
)
def test_a_bomb_is_refused_by_name(tmp_path: Path, name: str) -> None:
    """Small files that crash, stall or swell what reads them end the command line with a message that names them."""
    file = BOMBS[name](tmp_path)
    done = subprocess.run(
        (sys.executable, "-m", "lookdev", "inspect", str(file), "--json"),
        capture_output=True,
        text=True,
        env=os.environ | {MEMORY_VARIABLE: "200", SECONDS_VARIABLE: "8"},
        timeout=120.0,
        check=False,
    )
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    assert done.stderr.startswith(f"lookdev: {file}: ")
    assert done.stderr.count("\n") == 1
    assert len(done.stderr) < 2000
