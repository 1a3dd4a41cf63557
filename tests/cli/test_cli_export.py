"""`lookdev export` on the command line: options, output, exit codes."""

from pathlib import Path
from typing import Any

import pytest

from lookdev.batch.export import Exported
from lookdev.errors import RenderError


@pytest.fixture
def exported(monkeypatch, tmp_path):
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
def test_options_reach_the_export(options, pack, run_cli, exported, tmp_path):
    out = tmp_path / "look.blend"
    code, output, errors = run_cli("export", "blend", "job.toml", "-o", out, *options)
    assert (code, errors) == (0, "note: no view like that\n")
    assert exported == {"job": Path("job.toml"), "out": out, "pack": pack}
    assert output.startswith(f"{out}: 0.0 MB, scenes gold, rigs city")


def test_a_failure_of_blender_leaves_with_1(run_cli, exported, tmp_path):
    exported["error"] = RenderError("look 'gold' has too many layers")
    left = run_cli("export", "blend", "job.toml", "-o", tmp_path / "look.blend")
    assert left == (1, "", "lookdev: look 'gold' has too many layers\n")
