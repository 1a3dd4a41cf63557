"""Mutants, which are functions of the package with one small fault, and the file with their list and results.

A mutant is identified by its function and by the text of the changed lines, not by line numbers. If the function was
moved or renamed, the text alone identifies the mutant, provided that it is unique.
"""

import ast
import functools
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LIST = Path(__file__).with_name("mutants.jsonl")


@dataclass(frozen=True)
class Mutant:
    """One fault, and the result of testing it.

    Attributes
    ----------
    room
        The part of the package for which it was drawn.
    function
        File and qualified name of the function, like ``lookdev/brdf/disney.py:diffuse``.
    before, after
        The lines that change, without and with the fault. `before` has no indentation; `after` has the indentation
        relative to its first line.
    occurrence
        The number, from 0, of the changed lines among the equal lines of the function.
    killed_by
        The test that found the fault, by failing. Empty: no test.
    tier
        The tier of that test, ``default`` or ``proof``, or the last tier that was run if no test failed. Empty: no
        tests were run.
    equivalent
        The reason why no test can find the fault. Empty: a test could.
    """

    room: str
    function: str
    before: str
    after: str
    occurrence: int = 0
    killed_by: str = ""
    tier: str = ""
    equivalent: str = ""

    @property
    def name(self) -> tuple[str, str, str, int]:
        return self.function, self.before, self.after, self.occurrence

    @property
    def path(self) -> str:
        return self.function.partition(":")[0]

    def __str__(self) -> str:
        return f"{self.function}\n    - {self.before}\n    + {self.after}"


def read_mutants(path: Path = LIST) -> list[Mutant]:
    """Return the drawn mutants with their results."""
    return [Mutant(**json.loads(line)) for line in path.read_text().splitlines()] if path.exists() else []


def write_mutants(mutants: Iterable[Mutant], path: Path = LIST) -> None:
    """Write the list of mutants, each as a line of JSON without its empty values."""
    entries = ({key: value for key, value in asdict(mutant).items() if value} for mutant in mutants)
    scratch = path.with_suffix(".new")
    scratch.write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    scratch.replace(path)


@functools.cache  # thousands of mutants need the functions of the same modules
def functions_of(source: str) -> tuple[tuple[str, int, int], ...]:
    """Return name, first and last line (from 1) of a module's functions and methods, except nested functions."""

    def visit(body: Sequence[ast.stmt], prefix: str) -> Iterator[tuple[str, int, int]]:
        for node in body:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield prefix + node.name, node.lineno, node.end_lineno or node.lineno
            elif isinstance(node, ast.ClassDef):
                yield from visit(node.body, f"{prefix}{node.name}.")

    return tuple(visit(ast.parse(source).body, ""))


def places_of(lines: Sequence[str], before: str, first: int, last: int) -> list[int]:
    """Return the numbers, from 1, of the lines at which the text `before` begins, from line `first` to `last`."""
    texts = [line.strip() for line in before.split("\n")]
    span = len(texts)
    return [n for n in range(first, last - span + 2) if [line.strip() for line in lines[n - 1 : n - 1 + span]] == texts]


def mutated_source(source: str, mutant: Mutant) -> str | None:
    """Return the text of a module with the fault of a mutant, or None if it lacks the function or the lines."""
    lines = source.split("\n")
    name = mutant.function.partition(":")[2]
    for function, first, last in functions_of(source):
        places = places_of(lines, mutant.before, first, last) if function == name else []
        if mutant.occurrence < len(places):
            place = places[mutant.occurrence]
            indentation = lines[place - 1][: len(lines[place - 1]) - len(lines[place - 1].lstrip())]
            after = [indentation + line if line else line for line in mutant.after.split("\n")]
            lines[place - 1 : place - 1 + len(mutant.before.split("\n"))] = after
            return "\n".join(lines)
    return None


def locate(mutants: Sequence[Mutant], sources: Mapping[str, str]) -> tuple[list[Mutant], list[Mutant]]:
    """Return the mutants whose lines are in the code, with their present functions, and the other mutants.

    A mutant is lost if its function lacks its lines, and these lines are in no other function or in several. `sources`
    has the text of the package's modules by path.
    """
    present, lost = [], []
    for mutant in mutants:
        if mutated_source(sources.get(mutant.path, ""), mutant) is not None:
            present.append(mutant)
            continue
        functions = [
            f"{path}:{function}"
            for path, source in sources.items()
            for function, first, last in functions_of(source)
            if places_of(source.split("\n"), mutant.before, first, last)
        ]
        if len(functions) == 1:
            present.append(replace(mutant, function=functions[0], occurrence=0))
        else:
            lost.append(mutant)
    return present, lost


def read_sources(root: Path = ROOT) -> dict[str, str]:
    """Return the texts of the package's modules by their paths in the checkout."""
    return {path.relative_to(root).as_posix(): path.read_text() for path in sorted((root / "lookdev").rglob("*.py"))}
