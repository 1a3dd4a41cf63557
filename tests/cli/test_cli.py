from __future__ import annotations

import errno
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from io import StringIO
from pathlib import Path
from types import ModuleType, SimpleNamespace

import batch_case as case
import pytest

import lookdev
from lookdev.batch.doctor import Finding
from lookdev.batch.run import run_plan
from lookdev.cli import main
from lookdev.errors import AssetError, ModelError
from lookdev.job import json_schema, load_job

Command = Callable[..., int]


@pytest.fixture
def run_cli(monkeypatch: pytest.MonkeyPatch) -> Command:
    """Return a function that runs the command line in this process and returns its exit code."""

    def run(*arguments: object) -> int:
        monkeypatch.setattr(sys, "argv", ["lookdev", *map(str, arguments)])
        with pytest.raises(SystemExit) as left:
            main()
        return int(left.value.code or 0)

    return run


def provide(monkeypatch: pytest.MonkeyPatch, name: str, **members: object) -> None:
    module = ModuleType(name)
    vars(module).update(members)
    monkeypatch.setitem(sys.modules, name, module)


@pytest.fixture
def job_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a job whose preparation and worker are fakes."""
    case.make_job(tmp_path)
    path = tmp_path / "job.toml"
    path.write_text(case.JOB + case.TURNTABLES + case.RENDER)

    def prepare_job(path: Path) -> SimpleNamespace:
        job = load_job(path)
        return SimpleNamespace(job=job, plan=case.make_plan(job), notes=("city: 3 texels repaired",))

    provide(monkeypatch, "lookdev.batch.prepare", prepare_job=prepare_job)
    fake = partial(run_plan, worker_command=case.command(tmp_path))
    monkeypatch.setattr("lookdev.batch.run.run_plan", fake)
    return path


def test_render_from_nothing_and_again(run_cli: Command, job_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_cli("render", job_file) == 0
    output, errors = capsys.readouterr()
    assert errors == ""
    assert "\x1b" not in output
    lines = output.splitlines()
    assert lines[:2] == ["note: city: 3 texels repaired", "6 frames, 6 to render"]
    assert lines[-1] == "6 of 6 frames are done, 6 of them rendered now."
    assert run_cli("render", job_file) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "6 of 6 frames are done, 0 of them rendered now."
    assert run_cli("render", "--force", job_file) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "6 of 6 frames are done, 6 of them rendered now."


def test_failed_frames_are_exit_code_1_and_a_list_on_stderr(
    run_cli: Command, job_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case.misbehave(tmp_path, lighting_0002=["failed"])
    assert run_cli("render", job_file) == 1
    errors = capsys.readouterr().err.splitlines()
    assert errors[0] == "1 of 6 frames failed:"
    assert errors[1].startswith("gold/city/lighting.0002: no such attribute 'st2' (log: ")


@pytest.mark.parametrize("arguments", [("plan",), ("render", "--dry-run")])
def test_plan_says_what_would_be_rendered_and_renders_nothing(
    run_cli: Command, job_file: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]
) -> None:
    assert run_cli(*arguments, job_file) == 0
    output, errors = capsys.readouterr()
    assert errors == "note: city: 3 texels repaired\n"
    assert "gold/city/element   0001-0004  new    no file" in output
    assert not (job_file.parent / "out").exists()


def test_plan_as_json(run_cli: Command, job_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_cli("plan", "--json", job_file) == 0
    assert json.loads(capsys.readouterr().out)["render"] == 6


@pytest.mark.parametrize("verb", ["render", "plan"])
def test_a_faulty_job_is_exit_code_2_with_every_fault_and_no_traceback(
    run_cli: Command, job_file: Path, capsys: pytest.CaptureFixture[str], verb: str
) -> None:
    job_file.write_text(job_file.read_text().replace("samples", "sampels") + "pgn = true\n")
    assert run_cli(verb, job_file) == 2
    output, errors = capsys.readouterr()
    assert output == ""
    first, *faults = errors.splitlines()
    assert first == "lookdev: 2 faults:"
    assert any("sampels" in fault for fault in faults)
    assert any("pgn" in fault for fault in faults)
    assert "Traceback" not in errors


def test_an_asset_at_fault_is_exit_code_2(
    run_cli: Command, job_file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def prepare_job(path: Path) -> None:
        raise AssetError("ball.usd: no mesh in it")

    provide(monkeypatch, "lookdev.batch.prepare", prepare_job=prepare_job)
    assert run_cli("render", job_file) == 2
    assert capsys.readouterr().err == "lookdev: ball.usd: no mesh in it\n"


def test_a_full_disk_is_exit_code_1_and_no_traceback(
    run_cli: Command, job_file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def prepare_job(path: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", "/cache/assets/1.npz")

    provide(monkeypatch, "lookdev.batch.prepare", prepare_job=prepare_job)
    assert run_cli("plan", job_file) == 1
    said = capsys.readouterr().err
    assert said.startswith("lookdev: /cache/assets/1.npz: No space left on device; 'lookdev doctor'")


def test_a_worker_that_never_starts_is_exit_code_1(
    run_cli: Command, job_file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fake = partial(run_plan, worker_command=(sys.executable, "-c", "raise ImportError('bpy')"))
    monkeypatch.setattr("lookdev.batch.run.run_plan", fake)
    assert run_cli("render", job_file) == 1
    assert "lookdev doctor" in capsys.readouterr().err


def test_ctrl_c_while_preparing_is_exit_code_130(
    run_cli: Command, job_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def prepare_job(path: Path) -> None:
        raise KeyboardInterrupt

    provide(monkeypatch, "lookdev.batch.prepare", prepare_job=prepare_job)
    assert run_cli("render", job_file) == 130


def test_schema_to_stdout_and_to_a_file(run_cli: Command, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_cli("schema") == 0
    assert json.loads(capsys.readouterr().out) == json_schema()
    assert run_cli("schema", "--out", tmp_path / "job.schema.json") == 0
    assert json.loads((tmp_path / "job.schema.json").read_text()) == json_schema()
    assert run_cli("schema", "--out", tmp_path / "nowhere" / "job.schema.json") == 1


@pytest.mark.parametrize(("options", "backend"), [((), "numpy"), (("--backend", "cycles"), "cycles")])
def test_eval_maps_lines_to_lines(
    run_cli: Command,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: tuple[str, ...],
    backend: str,
) -> None:
    def evaluate_lines(lines: Iterator[str], backend: str) -> Iterator[str]:
        return (f"{backend} {line.strip()}" for line in lines)

    provide(monkeypatch, "lookdev.checks.evaluate", evaluate_lines=evaluate_lines)
    monkeypatch.setattr(sys, "stdin", StringIO("a\nb\n"))
    assert run_cli("eval", *options) == 0
    assert capsys.readouterr().out == f"{backend} a\n{backend} b\n"


def test_eval_of_a_bad_line_is_exit_code_2(
    run_cli: Command, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def evaluate_lines(lines: Iterator[str], backend: str) -> Iterator[str]:
        yield "first"
        raise ModelError("line 2: no model 'dysney' (did you mean 'disney'?)")

    provide(monkeypatch, "lookdev.checks.evaluate", evaluate_lines=evaluate_lines)
    assert run_cli("eval") == 2
    assert capsys.readouterr() == ("first\n", "lookdev: line 2: no model 'dysney' (did you mean 'disney'?)\n")


@pytest.mark.parametrize(("good", "code"), [(True, 0), (False, 1)])
def test_doctor(
    run_cli: Command,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    good: bool,
    code: int,
) -> None:
    findings = [Finding("Python", "3.11", good=True), Finding("bpy (Blender)", "4.5", good=good)]
    monkeypatch.setattr("lookdev.batch.doctor.examine", lambda: iter(findings))
    assert run_cli("doctor") == code
    assert "bpy (Blender)  4.5" in capsys.readouterr().out


def test_version_and_help(run_cli: Command, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_cli("--version") == 0
    assert capsys.readouterr().out == f"lookdev {lookdev.__version__}\n"
    assert run_cli("--help") == 0
    shown = capsys.readouterr().out
    assert all(verb in shown for verb in ("render", "plan", "schema", "eval", "doctor"))
    assert run_cli("rendre") == 2


def test_help_loads_nothing_heavy() -> None:
    program = "import sys, lookdev.cli; print(*sys.modules)"
    loaded = subprocess.run((sys.executable, "-c", program), capture_output=True, text=True, check=True)
    assert {"typer", "lookdev.cli"} <= set(loaded.stdout.split())
    assert not {"numpy", "pydantic", "scipy", "pxr", "OpenEXR", "bpy"} & set(loaded.stdout.split())
