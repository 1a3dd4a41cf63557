"""A job whose cache was damaged, the files of the worker too, gives the same picture, with a note of each file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lookdev.batch.events import Noted
from lookdev.batch.run import render_job
from lookdev.output import read_frame

JOB = """
output = "out"
asset = { builtin = "sphere" }
look = [{ name = "paint", material = "paint.usda" }]
ibl = [{ name = "city", builtin = "city" }]
turntable = [{ kind = "element", frames = 1 }]
render = { resolution = [16, 16], samples = 4 }
outputs = { sheet = false }
"""
LOOK = """#usda 1.0
(
    defaultPrim = "Paint"
)
def Material "Paint"
{
    token outputs:surface.connect = </Paint/Surface.outputs:surface>
    def Shader "Surface"
    {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = (0.5, 0.25, 0.125)
        token outputs:surface
    }
}
"""


@pytest.mark.cycles
def test_a_damaged_cache_gives_the_same_picture_with_notes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    (tmp_path / "job.toml").write_text(JOB)
    (tmp_path / "paint.usda").write_text(LOOK)
    frame = tmp_path / "out/paint/city/element.0001.exr"
    assert render_job(tmp_path / "job.toml").exit_code == 0
    beauty, _ = read_frame(frame)
    files = [file for file in (tmp_path / "cache").rglob("*") if file.is_file()]
    assert {file.suffix for file in files} == {".asset", ".exr", ".npy", ".oso", ".txt", ".json"}
    for suffix in (".oso", "", ".json"):
        damaged = [file for file in files if suffix in ("", file.suffix) and (suffix or file.suffix != ".json")]
        for file in damaged:
            file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
        events: list[object] = []
        assert render_job(tmp_path / "job.toml", force=True, report=events.append).exit_code == 0
        noted = {event.text for event in events if isinstance(event, Noted)}
        assert {f"{file}: was damaged, and is made again" for file in damaged} <= noted
        np.testing.assert_array_equal(read_frame(frame)[0], beauty)
        files = [file for file in (tmp_path / "cache").rglob("*") if file.is_file()]
