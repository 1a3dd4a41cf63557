"""Names and sentences of the package keep the rules of docs/glossary.md; names of test modules do not collide."""

import ast
import re
import sys
from collections import Counter, defaultdict
from dataclasses import dataclass
from functools import cache
from pathlib import Path

TESTS = Path(__file__).parent
ROOT = TESTS.parent

# Keys of job files and of `--json`, which users hold.
KEYS = {
    ("lookdev/errors.py", "what"),
    ("lookdev/job/surroundings.py", "place"),
    ("lookdev/material/validate/report.py", "what"),
    ("lookdev/plan/skips.py", "what"),
}
# The float64 side of comparisons, which only tests read.
FOR_TESTS = {"metal_reflectance", "parse_batches", "part_digests", "sample_slopes", "sample_texture"}


def test_no_two_modules_of_the_tests_share_a_name():
    names = Counter(path.stem for path in TESTS.rglob("*.py") if path.name != "conftest.py")
    assert not [name for name, count in names.items() if count > 1]


def test_no_module_of_the_tests_hides_another():
    others = sys.stdlib_module_names | {path.stem for path in TESTS.parent.iterdir() if path.is_dir()}
    assert not others & {path.stem for path in TESTS.rglob("*.py")}


@dataclass
class Names:
    """The names of a module: what it defines, binds and reads, and the first paragraphs of its docstrings."""

    definitions: list[tuple[ast.stmt, str]]
    bindings: set[str]
    reads: Counter[str]
    summaries: list[str]


@cache
def modules() -> dict[str, Names]:
    return {path.relative_to(ROOT).as_posix(): names_of(path.read_text()) for path in ROOT.glob("lookdev/**/*.py")}


def names_of(text: str) -> Names:
    module = ast.parse(text)
    names = Names([], set(), Counter(), [])
    for statement in module.body:
        match statement:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                names.definitions.append((statement, name))
            case ast.Assign(targets=[ast.Name(id=name)]) | ast.AnnAssign(target=ast.Name(id=name)):
                names.definitions.append((statement, name))
    for node in ast.walk(module):
        if isinstance(node, ast.Name | ast.Attribute):
            name = node.id if isinstance(node, ast.Name) else node.attr
            names.bindings.update([name] * isinstance(node.ctx, ast.Store))
            names.reads[name] += not isinstance(node.ctx, ast.Store)
        elif isinstance(node, ast.arg):
            names.bindings.add(node.arg)
        elif isinstance(node, ast.alias) and node.asname:
            names.reads[node.name] += 1
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and len(node.value) < 200:
            names.reads.update(re.findall(r"[A-Za-z_]\w*", node.value))  # an annotation, say
        elif isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            names.summaries.append((ast.get_docstring(node) or "").partition("\n\n")[0])
            names.bindings.update([] if isinstance(node, ast.Module) else [node.name])
    return names


def test_a_public_class_or_type_is_defined_once():
    files = defaultdict(list)
    for file, names in modules().items():
        for statement, name in names.definitions:
            is_variable = isinstance(statement, ast.Assign) and "TypeVar(" in ast.unparse(statement.value)
            is_type = isinstance(statement, ast.ClassDef) or re.fullmatch(r"[A-Z]+[a-z]\w*", name)
            if is_type and not is_variable and not name.startswith("_"):
                files[name].append(file)
    assert {name: places for name, places in files.items() if len(places) > 1} == {}


def test_no_name_is_a_word_that_the_glossary_bans():
    glossary = (ROOT / "docs" / "glossary.md").read_text()
    banned = set(re.search(r"^## Banned as names.*\n`(.+)`$", glossary, re.MULTILINE)[1].split())
    assert len(banned) > 20
    assert {
        (file, name) for file, names in modules().items() for name in names.bindings if name.strip("_") in banned
    } == KEYS


def test_every_name_of_a_module_is_read():
    read, unread = Counter[str](), set()
    for names in modules().values():
        read.update(names.reads)
    for statement, name in [definition for names in modules().values() for definition in names.definitions]:
        decorators = [ast.unparse(decorator) for decorator in getattr(statement, "decorator_list", [])]
        is_command = any(decorator.startswith("app.") for decorator in decorators)
        if not read[name] and not is_command and not name.startswith("__"):
            unread.add(name)
    assert unread == FOR_TESTS


def test_a_docstring_begins_with_one_line_of_plain_words():
    banned = re.compile(r"\bwhat of\b|\bso many\b|\bby which\b|\bsuch that\b.*\bwhich\b|; None: ")
    summaries = [(file, summary) for file, names in modules().items() for summary in names.summaries]
    assert [pair for pair in summaries if "\n" in pair[1] or banned.search(pair[1])] == []
