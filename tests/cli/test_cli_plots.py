"""``lookdev plot`` and ``lookdev fit``: files, notes, and exit codes."""

import json

import OpenImageIO as oiio
import pytest

from lookdev.material.usd import read_look


def test_a_plot_is_written_and_its_notes_printed(run_cli, tmp_path):
    file = tmp_path / "albedo.png"
    code, out, err = run_cli("plot", "albedo", "lambert", "disney:roughness=.4", "-o", file, "--size", "4")
    assert (code, err) == (0, "")
    assert "integration error at most" in out
    assert oiio.ImageBuf(str(file)).spec().width > 400
    assert tmp_path.joinpath("albedo.png").exists()
    assert len(list(tmp_path.iterdir())) == 1


def test_a_fit_is_written_as_look_and_plot(run_cli, tmp_path):
    look, picture = tmp_path / "fitted.usda", tmp_path / "fitted.png"
    words = "red=disney:roughness=.3,baseColor=.5/.2/.1", "--model", "disney:metallic=0,specularTint=0,variant=2014"
    code, out, err = run_cli("fit", *words, "--starts", "1", "--look", look, "-o", picture)
    assert (code, err) == (0, "")
    assert "Disney: log loss" in out
    (layer,) = read_look(look).layers
    assert layer.inputs["roughness"] == pytest.approx(0.3, rel=0.01)
    assert layer.inputs["baseColor"] == pytest.approx((0.5, 0.2, 0.1), rel=0.01)
    assert picture.stat().st_size > 10_000
    code, out, err = run_cli("fit", *words, "--starts", "1", "--json", "--only", "roughness", "--only", "baseColor")
    assert (code, err) == (0, "")
    assert json.loads(out)["parameters"]["roughness"] == pytest.approx(0.3, rel=0.01)
