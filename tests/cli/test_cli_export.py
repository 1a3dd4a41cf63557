"""`lookdev export` on the command line: options, output, exit codes."""

from pathlib import Path
from typing import Any

import pytest

from lookdev.export import ExportResult


@pytest.mark.parametrize(("options", "pack"), [((), False), (("--pack",), True)])
def test_options_reach_the_export(options, pack, run_cli, monkeypatch, tmp_path):
    arguments: dict[str, Any] = {}

    def export_blend(job: Path, out: Path, **options: Any) -> ExportResult:
        arguments.update(job=job, out=out, **options)
        out.write_bytes(b"B")
        return ExportResult((out,), f"{out}: written", ("no view like that",))

    monkeypatch.setattr("lookdev.export.blend.export_blend", export_blend)
    out = tmp_path / "look.blend"
    code, output, errors = run_cli("export", "blend", "job.toml", "-o", out, *options)
    assert (code, errors) == (0, "note: no view like that\n")
    assert arguments == {"job": Path("job.toml"), "out": out, "pack": pack}
    assert output == f"{out}: written\n"
