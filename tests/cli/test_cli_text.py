"""What verbs print: nothing in it controls the terminal, and with --json it is one document."""

import json
import os
import re
from pathlib import Path
from types import SimpleNamespace

import pytest

import lookdev.cli
from lookdev.cli.assets import inspect
from lookdev.cli.options import say, say_json

CONTROLS = "\x00 \x07 \x1b[31m \x1b]0;title\x07 \x7f \x9b2J \t \r \u202e \u2066 \ud800"


def test_nothing_printed_controls_the_terminal(capsys):
    say(f"one{CONTROLS}\ntwo é 日本")
    say(CONTROLS, err=True)
    shown, errors = capsys.readouterr()
    assert shown.endswith("\ntwo é 日本\n")
    assert [(text.replace("\n", "").isprintable(), "\u202e" in text) for text in (shown, errors)] == [(True, False)] * 2


def test_every_verb_prints_by_one_function():
    modules = Path(lookdev.cli.__file__).parent.glob("*.py")
    verbs = {module.name: module.read_text() for module in modules if module.name not in ("__init__.py", "options.py")}
    assert "jobs.py" in verbs
    assert [name for name, text in verbs.items() if re.search(r"typer\.echo|\bprint\(", text)] == []


def test_a_document_has_no_numbers_that_json_lacks(capsys):
    say_json({"size": (1.5, float("nan"), [float("-inf")]), "path": "a\udcff\x1b\u202e", "deep": {"x": float("inf")}})
    shown = capsys.readouterr().out
    assert json.loads(shown) == {"size": [1.5, None, [None]], "path": "a\udcff\x1b\u202e", "deep": {"x": None}}
    assert shown.replace("\n", "").isprintable()


def test_what_a_library_prints_is_not_in_the_document(provide, capfd):
    def inspect_file(*given: object, **options: object) -> tuple[SimpleNamespace, None]:
        os.write(1, b"a warning of a library\n")
        return SimpleNamespace(data=lambda: {"parts": []}), None

    provide("lookdev.batch.inspect", inspect_file=inspect_file)
    inspect(Path("a.usda"), as_json=True)
    shown, errors = capfd.readouterr()
    assert json.loads(shown) == {"parts": []}
    assert errors == "a warning of a library\n"


@pytest.mark.parametrize("verb", ["inspect", "plan"])
def test_after_an_error_there_is_no_document(run_cli, tmp_path, verb):
    code, shown, errors = run_cli(verb, tmp_path / "none\x1b[31m\udcff", "--json")
    assert (code, shown) == (2, "")
    assert errors.replace("\n", "").isprintable()
    assert "its path is not UTF-8" in errors
