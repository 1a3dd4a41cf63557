"""What a job names, read and planned: every fault at once, and who wears which look."""

from __future__ import annotations

from pathlib import Path

import pytest

from lookdev.batch.prepare import prepare_job
from lookdev.errors import FaultsError

LOOK = """#usda 1.0
def Material "Paint"
{{
    token outputs:lookdev:surface.connect = </Paint/Base.outputs:layer>
    def Shader "Base"
    {{
        uniform token info:id = "LookdevDisney"
        float inputs:roughness = {roughness}
        token outputs:layer
    }}
}}
"""
CARD = """#usda 1.0
( upAxis = "Z" )
def Mesh "{name}"
{{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)]
}}
"""
JOB = """
output = "out"
[asset]
usd = "asset.usda"
[[look]]
name = "good"
material = "good.usda"
{parts}
[[look]]
name = "other"
material = "other.usda"
[[ibl]]
name = "white"
builtin = "white"
[[ibl]]
name = "file"
file = "light.hdr"
[[turntable]]
kind = "element"
frames = 3
[render]
resolution = [8, 8]
"""


@pytest.fixture
def job(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a job without a fault but that its second light is none."""
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    for name in ("good", "other"):
        (tmp_path / f"{name}.usda").write_text(LOOK.format(roughness=0.5))
    two = CARD.format(name="Left") + CARD.format(name="Right").partition(")\n")[2]
    (tmp_path / "asset.usda").write_text(two)
    (tmp_path / "light.hdr").write_text("dark")
    path = tmp_path / "job.toml"
    path.write_text(JOB.format(parts=""))
    return path


def without_the_file(job: Path) -> None:
    job.write_text(job.read_text().replace('[[ibl]]\nname = "file"\nfile = "light.hdr"\n', ""))


def test_faults_of_asset_looks_and_lights_are_told_at_once_with_their_places(job: Path) -> None:
    (job.parent / "asset.usda").write_text("no USD")
    (job.parent / "good.usda").write_text("no USD either")
    (job.parent / "other.usda").write_text(LOOK.format(roughness=7))
    with pytest.raises(FaultsError) as caught:
        prepare_job(job)
    asset, light, good, other = map(str, caught.value.faults)
    assert asset.startswith(f"{job}: asset: {job.parent}/asset.usda: cannot be opened as USD: ")
    assert "pxrInternal" not in asset
    assert light.startswith(f"{job}: ibl[1]: {job.parent}/light.hdr: not a readable HDR image")
    assert good.startswith(f"{job.parent}/good.usda: USD cannot open it")
    assert other.startswith(f"{job.parent}/other.usda: /Paint/Base.inputs:roughness: 7")
    assert not (job.parent / "out").exists()


def test_a_part_that_is_none_is_told_with_those_there_are(job: Path) -> None:
    job.write_text(JOB.format(parts='parts = ["/Left", "/Wrong*"]'))
    without_the_file(job)
    with pytest.raises(FaultsError) as caught:
        prepare_job(job)
    (fault,) = caught.value.faults
    assert str(fault) == f"{job}: look[0].parts: '/Wrong*' fits no part (known: /Left, /Right)"


def test_a_part_that_no_look_covers_is_neutral_and_noted(job: Path) -> None:
    job.write_text(JOB.format(parts='parts = ["/Left"]'))
    without_the_file(job)
    prepared = prepare_job(job)
    assert prepared.notes == ("look 'good': nothing covers /Right; it is rendered neutral grey",)
    assert len(prepared.plan.pending()) == 6
    left, right = prepared.plan.pending()[0].scene.shaders
    assert (left.name, right.name) == ("good", "neutral")
