"""A job whose cache was damaged, the files of the worker too, gives the same picture, with a note of each file."""

from pathlib import Path

import batches
import numpy as np
import pytest
from looks import quick_among
from usd_text import shader

from lookdev.light.dome.environment import write_exr
from lookdev.output import read_frame
from lookdev.run.events import Noted
from lookdev.run.render import render_job

SURFACE = shader(
    "Surface", "UsdPreviewSurface", "color3f inputs:diffuseColor = (.5, .25, .125)", "token outputs:surface"
)
PREVIEW = f"""#usda 1.0
( defaultPrim = "Paint" )
def Material "Paint"
{{
token outputs:surface.connect = </Paint/Surface.outputs:surface>
{SURFACE}}}
"""


@pytest.mark.cycles
@pytest.mark.parametrize(
    ("of_records", "sky"), quick_among([(False, "grey"), (False, "random"), (True, "random")], [(False, "grey")])
)
def test_a_damaged_cache_gives_the_same_picture_with_notes(
    of_records: bool, sky: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Shaders whose record is damaged are generated and compiled anew: theirs are not read.

    A grey sky needs no tables, of three seconds each time.
    """
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    radiance = np.random.default_rng(1).random((8, 16, 3)) if sky == "random" else np.full((8, 16, 3), 0.5)
    write_exr(tmp_path / "sky.exr", "RGB", radiance)
    job = batches.write_job(
        tmp_path,
        asset='{ builtin = "plane" }',
        look='[{ name = "red", material = "red.usda" }]',
        ibl='[{ name = "sky", file = "sky.exr" }]',
        turntable='[{ kind = "element", frames = 1 }]',
    )
    (tmp_path / "red.usda").write_text(PREVIEW)
    frame = tmp_path / "out/red/sky/element.0001.exr"

    def cached() -> list[Path]:
        return [file for file in (tmp_path / "cache").rglob("*") if file.is_file()]

    assert render_job(job).exit_code == 0
    beauty, _ = read_frame(frame)
    kinds = {".asset", ".exr", ".npy", ".oso", ".txt", ".json"}
    assert {file.suffix for file in cached()} == kinds - ({".npy", ".txt"} if sky == "grey" else set())
    damaged = [file for file in cached() if (file.suffix == ".json") == of_records]
    for file in damaged:
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    events: list[object] = []
    assert render_job(job, force=True, report=events.append).exit_code == 0
    noted = {event.text for event in events if isinstance(event, Noted)}
    assert {f"{file}: was damaged, and is made again" for file in damaged} <= noted
    np.testing.assert_array_equal(read_frame(frame)[0], beauty)
