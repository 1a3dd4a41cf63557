"""The command line as a whole: help, exit codes, the handling of exceptions, and the output of verbs.

Output contains no character that controls the terminal, and with --json it is one document.
"""

import errno
import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import pytest
from looks import quick_among

import lookdev.cli
from lookdev.cli.crash import DISTRIBUTIONS
from lookdev.cli.files import inspect
from lookdev.cli.options import say, say_json
from lookdev.errors import AssetError, RenderError
from lookdev.inspect.doctor import DoctorFinding

ROOT = Path(__file__).parents[2]
CONTROLS = "\x00 \x07 \x1b[31m \x1b]0;title\x07 \x7f \x9b2J \t \r \u202e \u2066 \ud800"
CLOSED = ("<&-", ">&-", "2>&-", "<&- >&-", "<&- >&- 2>&-")


def test_version_and_help(run_cli):
    assert run_cli("--version") == (0, f"lookdev {lookdev.__version__}\n", "")
    code, output, _ = run_cli("--help")
    assert code == 0
    assert all(verb in output for verb in ("render", "plan", "example", "schema", "eval", "doctor"))
    code, _, errors = run_cli("rendre")
    assert code == 2
    assert "Did you mean 'render'?" in errors


def test_help_loads_nothing_heavy():
    program = "import lookdev.cli\ntry: lookdev.cli.app(['--help'])\nfinally:\n import sys; print(*sys.modules)"
    loaded = subprocess.run((sys.executable, "-c", program), capture_output=True, text=True, check=True)
    assert {"typer", "lookdev.cli"} <= set(loaded.stdout.split())
    heavy = {"numpy", "pydantic", "scipy", "pxr", "OpenEXR", "OpenImageIO", "MaterialX", "bpy", "importlib.metadata"}
    assert not heavy & set(loaded.stdout.split())


CARD = '#usda 1.0\ndef Mesh "Card" {}\n'
LAMP = '#usda 1.0\ndef SphereLight "Lamp" {}\n'


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("inspect card.usda --purpose hero", "'hero' is not one of"),
        ("inspect card.usda --variants size=big", "has no variant set 'size'"),
        ("inspect card.usda --layer looks.usda", "looks.usda: no such file"),
        ("inspect nowhere.usda", "nowhere.usda: no such file"),
        ("inspect tree_point", "no such file or built-in rig (did you mean 'three_point'?)"),
        ("inspect lamp.usda --time 3", "is a rig, for which --png, --time and --purpose have no meaning"),
        ("bench --out out --scenes shaderbal", "there is no scene 'shaderbal' (did you mean 'shaderball'?)"),
        ("bench --out out --looks plastic,carpaint", "there is no look 'carpaint' (did you mean 'car_paint'?)"),
        ("bench --out out --samples 4,5", "5 samples: counts are powers of two"),
        ("bench --out out --sequence --scenes sphere,suzanne", "the sequence is of one scene and one look"),
        ("bench --scale --sequence", "one kind of benchmark at a time, not --sequence and --scale"),
        ("check leaf.usda --only point", "there is no check 'point' (did you mean 'points'?)"),
        ("check leaf.usda --depth deep", "'deep' is not one of 'quick', 'default', 'full'"),
        ("check leaf.usda --variants wear", "SET=VARIANT is needed"),
        ("check leaf.usda --backend node", "there is no backend 'node' (did you mean 'nodes'?)"),
        ("check", "all checks but that of stability need a job or a look"),
        ("check none.usda", "none.usda"),
        ("export blend suzanne.toml", "Missing option '-o' / '--out'"),
        ("export blend none.toml -o look.blend", "none.toml"),
        ("export mitsuba none.toml -o scenes", "none.toml"),
        ("plot retor lambert -o plot.png", "unknown plot 'retor' (did you mean 'retro'?)"),
        ("plot retro lamber -o plot.png", "did you mean 'lambert'"),
        ("plot retro lambert --theta 20 -o plot.png", "retro has no --theta"),
        ("example frist", "there is no example 'frist' (did you mean 'first'?)"),
    ],
)
def test_what_is_wrong_with_arguments_leaves_with_2_and_writes_nothing(run_cli, tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    Path("card.usda").write_text(CARD)
    Path("lamp.usda").write_text(LAMP)
    Path("leaf.usda").symlink_to(ROOT / "materials" / "leaf.usda")
    Path("suzanne.toml").symlink_to(ROOT / "jobs" / "suzanne.toml")
    before = set(tmp_path.rglob("*"))
    code, output, errors = run_cli(*shlex.split(words))
    assert (code, output) == (2, "")
    assert message in " ".join(errors.replace("│", " ").split())
    assert "Traceback" not in errors
    assert set(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (AssetError("ball.usd: no mesh in it"), 2, "lookdev: ball.usd: no mesh in it\n"),
        (RenderError("look 'gold' has too many layers"), 1, "lookdev: look 'gold' has too many layers\n"),
        (OSError(errno.ENOSPC, "No space left", "/cache/1.npz"), 1, "lookdev: /cache/1.npz: No space left\n"),
        (KeyboardInterrupt(), 130, ""),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else "",
)
@pytest.mark.parametrize("verb", ["render", "plan"])
def test_an_error_is_a_line_and_an_exit_code(run_cli, job_file, plant, error, code, message, verb):
    plant(error)
    assert run_cli(verb, job_file) == (code, "", message)


@pytest.mark.parametrize("blocked", [(), ("cache",), ("cache", "temporary")], ids=["cache", "temporary", "stderr"])
def test_a_defect_is_one_line_and_a_report(run_cli, job_file, plant, tmp_path, monkeypatch, blocked):
    for name in blocked:
        (tmp_path / name).write_text("a file where a folder should be")
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    plant(ValueError("a planted\ndefect"))
    code, output, errors = run_cli("plan", job_file)
    assert (code, output) == (70, "")
    line, _, report = errors.partition("\n")
    assert line.startswith("lookdev: internal error: ValueError: a planted; ")
    if len(blocked) < 2:
        assert report == ""
        file = Path(line.rpartition(" ")[2])
        assert file.parent == tmp_path.joinpath(*(("temporary",) if blocked else ("cache", "reports")))
        assert list(file.parent.iterdir()) == [file]
        report = file.read_text()
    expected = [f"command: lookdev plan {job_file}", "Traceback (most recent call last)", "defect"]
    expected += [job_file.read_text(), *(f"\n{name}: " for name in DISTRIBUTIONS)]
    assert [text for text in expected if text not in report] == []


def test_a_closed_pipe_ends_quietly():
    command = (sys.executable, "-m", "lookdev", "schema")
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 1


@pytest.mark.parametrize(("good", "code"), [(True, 0), (False, 1)])
def test_doctor(run_cli, monkeypatch, good, code):
    findings = [DoctorFinding("Python", "3.11", good=True), DoctorFinding("bpy (Blender)", "4.5", good=good)]
    monkeypatch.setattr("lookdev.inspect.doctor.examine_machine", lambda: iter(findings))
    exit_code, output, _ = run_cli("doctor")
    assert exit_code == code
    assert "bpy (Blender)  4.5" in output


@pytest.mark.parametrize("closed", quick_among([(c,) for c in CLOSED], [("<&- >&- 2>&-",)]))
def test_closed_streams_are_no_defect(closed):
    command = f"{sys.executable} -m lookdev plan gone.toml {closed}"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert ("gone.toml" in done.stderr) == ("2>&-" not in closed)


def test_a_terminal_without_unicode_is_no_defect():
    command, environment = (
        (sys.executable, "-m", "lookdev", "plan", "漢.toml"),
        os.environ | {"PYTHONIOENCODING": "latin-1"},
    )
    done = subprocess.run(command, env=environment, capture_output=True, check=False)
    assert done.returncode == 2
    assert rb"\u6f22.toml: cannot be read" in done.stderr


def test_nothing_printed_controls_the_terminal(capsys):
    say(f"one{CONTROLS}\ntwo é 日本")
    say(CONTROLS, err=True)
    output, errors = capsys.readouterr()
    assert output.endswith("\ntwo é 日本\n")
    assert [(text.replace("\n", "").isprintable(), "\u202e" in text) for text in (output, errors)] == [
        (True, False)
    ] * 2


def test_every_verb_prints_by_one_function():
    modules = Path(lookdev.cli.__file__).parent.glob("*.py")
    verbs = {module.name: module.read_text() for module in modules if module.name not in ("__init__.py", "options.py")}
    assert "jobs.py" in verbs
    assert [name for name, text in verbs.items() if re.search(r"typer\.echo|\bprint\(", text)] == []


def test_a_document_has_no_numbers_that_json_lacks(capsys):
    say_json({"size": (1.5, float("nan"), [float("-inf")]), "path": "a\udcff\x1b\u202e", "deep": {"x": float("inf")}})
    output = capsys.readouterr().out
    assert json.loads(output) == {"size": [1.5, None, [None]], "path": "a\udcff\x1b\u202e", "deep": {"x": None}}
    assert output.replace("\n", "").isprintable()


def test_what_a_library_prints_is_not_in_the_document(provide, capfd):
    def inspect_file(*arguments: object, **options: object) -> tuple[SimpleNamespace, None]:
        os.write(1, b"a warning of a library\n")
        return SimpleNamespace(data=lambda: {"parts": []}), None

    provide("lookdev.inspect.assets", inspect_file=inspect_file)
    inspect(Path("a.usda"), as_json=True)
    output, errors = capfd.readouterr()
    assert json.loads(output) == {"parts": []}
    assert errors == "a warning of a library\n"


@pytest.mark.parametrize("verb", ["inspect", "plan"])
def test_after_an_error_there_is_no_document(run_cli, tmp_path, verb):
    code, output, errors = run_cli(verb, tmp_path / "none\x1b[31m\udcff", "--json")
    assert (code, output) == (2, "")
    assert errors.replace("\n", "").isprintable()
    assert "its path is not UTF-8" in errors
