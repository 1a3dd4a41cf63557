"""A mutant: a function of the package with one small fault, named by the function and the text of the fault.

Names outlive moves and renames: where the function is gone, the text alone finds its place, if it is unique.
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
    """One fault, and what came of it.

    Attributes
    ----------
    room
        The part of the package that it was drawn for.
    function
        File and qualified name, ``lookdev/brdf/disney.py:diffuse``.
    before, after
        The lines that change, without indentation; `after` keeps the indentation relative to the first.
    occurrence
        Which of the places in the function that read `before`, from 0.
    killed_by
        The test that failed; empty: none.
    tier
        The tier of that test, ``default`` or ``proof``; of a survivor the last that was tried; empty: not tried yet.
    equivalent
        Why no test can fail; empty: one can.
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
    """Write the list, a line a mutant, without values that are empty."""
    entries = ({key: value for key, value in asdict(mutant).items() if value} for mutant in mutants)
    scratch = path.with_suffix(".new")
    scratch.write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    scratch.replace(path)


@functools.cache  # for thousands of mutants, the same modules
def functions_of(source: str) -> tuple[tuple[str, int, int], ...]:
    """Return the functions of a module that are in no other, methods included: name, first and last line, from 1."""

    def visit(body: Sequence[ast.stmt], prefix: str) -> Iterator[tuple[str, int, int]]:
        for node in body:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield prefix + node.name, node.lineno, node.end_lineno or node.lineno
            elif isinstance(node, ast.ClassDef):
                yield from visit(node.body, f"{prefix}{node.name}.")

    return tuple(visit(ast.parse(source).body, ""))


def places_of(lines: Sequence[str], before: str, first: int, last: int) -> list[int]:
    """Return the lines, from 1, in a range of a module at which the text of a mutant begins."""
    wanted = [line.strip() for line in before.split("\n")]
    span = len(wanted)
    return [
        n for n in range(first, last - span + 2) if [line.strip() for line in lines[n - 1 : n - 1 + span]] == wanted
    ]


def mutated_source(source: str, mutant: Mutant) -> str | None:
    """Return the module with the fault; None where function or text is not in it."""
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
    """Return the mutants at their present functions, and those whose text is nowhere or not unique.

    `sources` are the modules of the package by path.
    """
    present, lost = [], []
    for mutant in mutants:
        if mutated_source(sources.get(mutant.path, ""), mutant) is not None:
            present.append(mutant)
            continue
        found = [
            f"{path}:{function}"
            for path, source in sources.items()
            for function, first, last in functions_of(source)
            if places_of(source.split("\n"), mutant.before, first, last)
        ]
        if len(found) == 1:
            present.append(replace(mutant, function=found[0], occurrence=0))
        else:
            lost.append(mutant)
    return present, lost


def read_sources(root: Path = ROOT) -> dict[str, str]:
    """Return the modules of the package by their paths in the checkout."""
    return {path.relative_to(root).as_posix(): path.read_text() for path in sorted((root / "lookdev").rglob("*.py"))}
