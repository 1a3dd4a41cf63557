"""The command line as a whole: help, exit codes, and what becomes of an exception."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

import lookdev
from lookdev.batch.crash import DISTRIBUTIONS
from lookdev.batch.doctor import Finding
from lookdev.errors import AssetError

Command = Callable[..., tuple[int, str, str]]
Plant = Callable[[BaseException], None]


def test_version_and_help(run_cli: Command) -> None:
    assert run_cli("--version") == (0, f"lookdev {lookdev.__version__}\n", "")
    code, shown, _ = run_cli("--help")
    assert code == 0
    assert all(verb in shown for verb in ("render", "plan", "example", "schema", "eval", "doctor"))
    code, _, errors = run_cli("rendre")
    assert code == 2
    assert "Did you mean 'render'?" in errors


def test_help_loads_nothing_heavy() -> None:
    program = "import lookdev.cli\ntry: lookdev.cli.app(['--help'])\nfinally:\n import sys; print(*sys.modules)"
    loaded = subprocess.run((sys.executable, "-c", program), capture_output=True, text=True, check=True)
    assert {"typer", "lookdev.cli"} <= set(loaded.stdout.split())
    heavy = {"numpy", "pydantic", "scipy", "pxr", "OpenEXR", "OpenImageIO", "MaterialX", "bpy", "importlib.metadata"}
    assert not heavy & set(loaded.stdout.split())


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (AssetError("ball.usd: no mesh in it"), 2, "lookdev: ball.usd: no mesh in it\n"),
        (
            OSError(errno.ENOSPC, "No space left on device", "/cache/1.npz"),
            1,
            "lookdev: /cache/1.npz: No space left on device\n",
        ),
        (KeyboardInterrupt(), 130, ""),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else "",
)
@pytest.mark.parametrize("verb", ["render", "plan"])
def test_an_error_is_a_line_and_an_exit_code(
    run_cli: Command, job_file: Path, plant: Plant, error: BaseException, code: int, message: str, verb: str
) -> None:
    plant(error)
    assert run_cli(verb, job_file) == (code, "", message)


@pytest.mark.parametrize("blocked", [(), ("cache",), ("cache", "temporary")], ids=["cache", "temporary", "stderr"])
def test_a_defect_is_one_line_and_a_report(
    run_cli: Command, job_file: Path, plant: Plant, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, blocked: tuple
) -> None:
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
    expected = [
        f"command: lookdev plan {job_file}",
        "Traceback (most recent call last)",
        "defect",
        job_file.read_text(),
    ]
    expected += [f"\n{name}: " for name in DISTRIBUTIONS]
    assert [text for text in expected if text not in report] == []


def test_a_closed_pipe_ends_quietly() -> None:
    command = (sys.executable, "-m", "lookdev", "schema")
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 1


@pytest.mark.parametrize(("good", "code"), [(True, 0), (False, 1)])
def test_doctor(run_cli: Command, monkeypatch: pytest.MonkeyPatch, good: bool, code: int) -> None:
    findings = [Finding("Python", "3.11", good=True), Finding("bpy (Blender)", "4.5", good=good)]
    monkeypatch.setattr("lookdev.batch.doctor.examine", lambda: iter(findings))
    left, shown, _ = run_cli("doctor")
    assert left == code
    assert "bpy (Blender)  4.5" in shown


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_closed_streams_are_no_defect(closed: str) -> None:
    command = f"{sys.executable} -m lookdev plan gone.toml {closed}"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert ("gone.toml" in done.stderr) == ("2>&-" not in closed)


def test_a_terminal_without_unicode_is_no_defect() -> None:
    done = subprocess.run(
        (sys.executable, "-m", "lookdev", "plan", "漢.toml"),
        env=os.environ | {"PYTHONIOENCODING": "latin-1"},
        capture_output=True,
        check=False,
    )
    assert done.returncode == 2
    assert rb"\u6f22.toml: cannot be read" in done.stderr
