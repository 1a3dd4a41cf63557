"""Mutants are found by function and text even if the function was moved or renamed."""

from dataclasses import replace

import pytest
from mutant import Mutant, locate, mutated_source, read_mutants, read_sources, write_mutants
from renames import follow
from run import failing

SOURCE = """
def albedo(x):
    y = x * 2.0
    if x:
        y = x * 2.0
    return y


class Lobe:
    def pdf(self):
        return [
            1.0,
            self.share,
        ]
"""
MUTANT = Mutant("brdf", "lookdev/brdf/a.py:albedo", "y = x * 2.0", "y = x / 2.0", occurrence=1)


def test_a_mutant_is_planted_at_its_occurrence() -> None:
    lines = (mutated_source(SOURCE, MUTANT) or "").split("\n")
    assert [(n, line) for n, line in enumerate(lines) if line != SOURCE.split("\n")[n]] == [(4, "        y = x / 2.0")]


def test_a_mutant_of_several_lines_keeps_their_indentation() -> None:
    mutant = Mutant("brdf", "lookdev/brdf/a.py:Lobe.pdf", "1.0,\nself.share,", "1.0,")
    assert "        return [\n            1.0,\n        ]" in (mutated_source(SOURCE, mutant) or "")


def test_a_mutant_outlives_a_rename_where_its_text_is_unique() -> None:
    mutant = replace(MUTANT, before="return y", after="return", occurrence=0)
    (present,), lost = locate([mutant], {"lookdev/brdf/b.py": SOURCE.replace("albedo", "directional_albedo")})
    assert (present.function, lost) == ("lookdev/brdf/b.py:directional_albedo", [])
    (lost,) = locate([replace(MUTANT, before="gone")], {"lookdev/brdf/a.py": SOURCE})[1]
    assert lost.before == "gone"


def test_the_list_is_of_this_code(tmp_path) -> None:
    mutants = read_mutants()
    sources = read_sources()
    assert not locate(mutants, sources)[1], (
        "`python tests/mutation follow REVISION` takes over new names, `redraw --seed N` draws others"
    )
    assert len({mutant.name for mutant in mutants}) == len(mutants)
    write_mutants(mutants, tmp_path / "copy.jsonl")
    assert read_mutants(tmp_path / "copy.jsonl") == mutants


def test_a_long_test_that_fails_once_finds_nothing() -> None:
    class Copy:
        """Fails each test a given number of times; other tests pass."""

        def __init__(self, **failures: int) -> None:
            self.failures = failures

        def test(self, tests: list[tuple[str, float]], marker: str) -> list[str]:
            for name, _ in tests:
                if self.failures.get(name, 0) > 0:
                    self.failures[name] -= 1
                    return [name]
            return []

    tests = [("quick", 0.1), ("long", 5.0), ("longer", 9.0)]
    assert failing(Copy(quick=1), tests, "") == "quick"
    assert failing(Copy(long=1, longer=2), tests, "") == "longer"
    assert failing(Copy(long=1), tests, "") == ""


def test_a_mutant_follows_new_names_and_is_lost_with_its_formula(monkeypatch: pytest.MonkeyPatch) -> None:
    old = "def _made(given):\n    kept = given.size + 1\n    return [each * kept for each in given]\n"
    new = 'def weights(sizes):\n    """Weigh."""\n    count = sizes.size + 1\n    return [w * count for w in sizes]\n'
    monkeypatch.setattr("renames.old_source", lambda revision, path: old)
    mutants = [
        Mutant("room", "a.py:_made", "kept = given.size + 1", "kept = given.size - 1"),
        Mutant("room", "a.py:_made", "return [each * kept for each in given]", "return [kept for each in given]"),
    ]
    present, lost = follow(mutants, {"a.py": new}, "HEAD")
    assert [(mutant.function, mutant.before, mutant.after) for mutant in present] == [
        ("a.py:weights", "count = sizes.size + 1", "count = sizes.size - 1"),
        ("a.py:weights", "return [w * count for w in sizes]", "return [count for w in sizes]"),
    ]
    assert lost == []
    present, lost = follow(mutants, {"a.py": new.replace("sizes.size + 1", "sizes.size + 2 * 3")}, "HEAD")
    assert [mutant.before for mutant in lost] == ["kept = given.size + 1"]
