"""The config, displays and views of a job's pictures."""

from __future__ import annotations

import re
from pathlib import Path

import PyOpenColorIO as ocio
import pytest

from lookdev.errors import JobError
from lookdev.job import Job, parse_job
from lookdev.output.color import SHIPPED, VIEWS, DisplayView

ACES = "ocio://studio-config-v2.2.0_aces-v1.3_ocio-v2.4"


def job(folder: Path, outputs: str = "") -> Job:
    text = 'output = "out"\nasset = { builtin = "sphere" }\nibl = [{ name = "city", builtin = "city" }]\n'
    text += '[[look]]\nname = "gold"\nmaterial = "gold.usda"\n[[turntable]]\nkind = "element"\nframes = 1\n'
    (folder / "gold.usda").touch()
    return parse_job(text + ("[outputs]\n" + outputs if outputs else ""), folder / "job.toml")


def faults(folder: Path, outputs: str = "") -> list[tuple[str, str]]:
    with pytest.raises(JobError) as caught:
        job(folder, outputs)
    return [(fault.where, fault.what) for fault in caught.value.faults]


def test_without_a_word_pictures_are_in_the_shipped_view(tmp_path: Path) -> None:
    assert job(tmp_path).outputs.shown("png") == DisplayView() == DisplayView("lookdev", "sRGB - Display", SHIPPED)


def test_the_studio_s_config_is_obeyed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OCIO", ACES)
    own = job(tmp_path).outputs.shown()
    assert (own.config, own.view) == (ACES, "ACES 1.0 - SDR Video")
    assert job(tmp_path, 'ocio = "lookdev"').outputs.shown() == DisplayView()
    config = ocio.Config.CreateFromBuiltinConfig(ACES.removeprefix("ocio://"))
    (tmp_path / "studio.ocio").write_text(config.serialize())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("OCIO", "studio.ocio")
    assert job(tmp_path).outputs.shown().config == str(tmp_path / "studio.ocio")
    monkeypatch.delenv("OCIO")
    monkeypatch.chdir("/")
    assert job(tmp_path, 'ocio = "studio.ocio"').outputs.shown().config == str(tmp_path / "studio.ocio")


def test_each_output_may_have_its_own(tmp_path: Path) -> None:
    video = "Rec.1886 Rec.709 - Display"
    given = f'view = "Raw"\ndisplays = {{ overview = "{video}" }}\nviews = {{ png = "Un-tone-mapped" }}'
    outputs = job(tmp_path, given).outputs
    shown = {name: (outputs.shown(name).view, outputs.shown(name).display) for name in ("png", "sheet", "overview")}
    srgb = "sRGB - Display"
    assert shown == {"png": ("Un-tone-mapped", srgb), "sheet": ("Raw", srgb), "overview": ("Raw", video)}


@pytest.mark.parametrize(
    ("outputs", "where", "what"),
    [
        ('view = "lookdv"', "outputs.view", "did you mean 'lookdev'"),
        ('view = "acse"', "outputs.view", f"known: {', '.join(VIEWS)}"),
        ('display = "sRGB"', "outputs.display", "has no display called 'sRGB'"),
        ('ocio = "none.ocio"', "outputs.ocio", "cannot read the config"),
        ('ocio_space = "Linear Rec.708 (sRGB)"', "outputs.view", "did you mean 'Linear Rec.709 (sRGB)'"),
        ('views = { pgn = "Raw" }', "outputs.views", "no output is called 'pgn'"),
        ('views = { png = "raw" }', "outputs.views", "png: .*did you mean 'Raw'"),
        ('view = "ACES 1.0 - SDR Video"\ndisplays = { png = "P3-D65 - Display" }', "outputs.views", "png: .*ACES 1.0"),
        ('displays = { png = "P4" }', "outputs.views", "png: .*no display called 'P4'"),
    ],
)
def test_faults_name_the_key_and_what_would_be_right(tmp_path: Path, outputs: str, where: str, what: str) -> None:
    ((key, fault),) = faults(tmp_path, outputs)
    assert key == where
    assert re.search(what, fault) or what in fault


def test_a_studio_s_config_that_is_missing_is_a_fault_of_the_job(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OCIO", "/nowhere/config.ocio")
    for outputs in ("", "png = false"):
        ((key, what),) = faults(tmp_path, outputs)
        assert key == "outputs.ocio"
        assert what.startswith("$OCIO: OpenColorIO cannot read the config /nowhere/config.ocio")
