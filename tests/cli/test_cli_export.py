"""`lookdev export` on the command line: options, output, exit codes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lookdev.batch.export import Exported
from lookdev.errors import RenderError

ROOT = Path(__file__).parents[2]
Command = Callable[..., tuple[int, str, str]]


@pytest.fixture
def exported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, Any]:
    """Let the export write one byte; return its arguments."""
    arguments: dict[str, Any] = {}

    def export_blend(job: Path, out: Path, **options: Any) -> Exported:
        arguments.update(job=job, out=out, **options)
        if "error" in arguments:
            raise arguments["error"]
        out.write_bytes(b"B")
        return Exported(out, (), ("gold",), ("city",), ("no view like that",))

    monkeypatch.setattr("lookdev.batch.export.export_blend", export_blend)
    return arguments


@pytest.mark.parametrize(("options", "pack"), [((), False), (("--pack",), True)])
def test_options_reach_the_export(
    options: tuple[str, ...], pack: bool, run_cli: Command, exported: dict[str, Any], tmp_path: Path
) -> None:
    out = tmp_path / "look.blend"
    code, output, errors = run_cli("export", "blend", "job.toml", "-o", out, *options)
    assert (code, errors) == (0, "note: no view like that\n")
    assert exported == {"job": Path("job.toml"), "out": out, "pack": pack}
    assert output.startswith(f"{out}: 0.0 MB, scenes gold, rigs city")


def test_a_failure_of_blender_leaves_with_1(run_cli: Command, exported: dict[str, Any], tmp_path: Path) -> None:
    exported["error"] = RenderError("look 'gold' has too many layers")
    left = run_cli("export", "blend", "job.toml", "-o", tmp_path / "look.blend")
    assert left == (1, "", "lookdev: look 'gold' has too many layers\n")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("blend", ROOT / "jobs" / "suzanne.toml"), "Missing option '-o' / '--out'"),
        (("blend", ROOT / "jobs" / "suzanne.toml", "-o", "look.usd"), "look.blend would be right"),
        (("blend", ROOT / "jobs" / "none.toml", "-o", "look.blend"), "none.toml"),
        (("mitsuba", ROOT / "jobs" / "none.toml", "-o", "scenes"), "none.toml"),
        (("blnd", ROOT / "jobs" / "suzanne.toml", "-o", "look.blend"), "No such command 'blnd'"),
        (("blend", ROOT / "jobs" / "suzanne.toml", "-o", "look.blend", "--packed"), "No such option: --packed"),
    ],
)
def test_wrong_arguments_leave_with_2(
    arguments: tuple[object, ...], message: str, run_cli: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, errors = run_cli("export", *arguments)
    assert code == 2
    assert message in " ".join(errors.replace("│", " ").split())
    assert list(tmp_path.iterdir()) == []
