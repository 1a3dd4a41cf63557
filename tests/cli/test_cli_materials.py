"""``lookdev materials``: output, exit codes, and a contact sheet from the fake worker."""

from functools import partial
from pathlib import Path

import batch_case as case
import OpenImageIO as oiio
import pytest

from lookdev.material.usd import read_look
from lookdev.run.render import run_plan

PRESET = """#usda 1.0
( defaultPrim = "Preset" )
def Shader "Preset" (doc = "Like {name}. More of it."; customData = {{ string category = "{category}" }}) {{
    uniform token info:id = "LookdevDisney"
    float inputs:roughness = {roughness}
    token outputs:layer
}}
"""


@pytest.fixture
def materials(tmp_path, monkeypatch, run_cli):
    """Run ``lookdev materials`` in a folder with a library of three; return exit code, stdout and stderr."""
    library = tmp_path / "materials" / "presets"
    library.mkdir(parents=True)
    for name, category, roughness in (("gold", "metal", 0.1), ("rust", "metal", 0.2), ("clay", "stone", 0.3)):
        (library / f"{name}.usda").write_text(PRESET.format(name=name, category=category, roughness=roughness))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("LOOKDEV_LIBRARY", str(library))
    return partial(run_cli, "materials")


@pytest.mark.parametrize("verb", [(), ("list",)])
def test_the_library_is_listed(materials, verb):
    code, output, errors = materials(*verb)
    assert (code, errors) == (0, "")
    assert output.splitlines() == [
        "name  category  model",
        "gold  metal     disney  Like gold",
        "rust  metal     disney  Like rust",
        "clay  stone     disney  Like clay",
    ]
    code, output, _ = materials(*verb, "--category", "stone")
    assert [line.split()[0] for line in output.splitlines()] == ["name", "clay"]


def test_a_broken_preset_is_a_note(materials):
    Path("materials/presets/broken.usda").write_text("not USD")
    code, output, errors = materials()
    assert code == 0
    assert len(output.splitlines()) == 4
    assert errors.startswith("note: ")
    assert "broken.usda" in errors


def test_a_stack_is_made_and_edited(materials):
    assert materials("new", "look.usda", "gold", "--name", "Paint") == (0, "look.usda: /Paint is gold\n", "")
    assert materials("add", "look.usda", "Rust", "--mask", "primvar:wear") == (0, "look.usda: layer 1 is Preset\n", "")
    code, output, _ = materials("add", "look.usda", "materials/presets/clay.usda", "--prim", "/Paint")
    assert (code, output) == (0, "look.usda: layer 2 is Preset2\n")
    assert materials("mask", "look.usda", "2", "0.5") == (0, "look.usda: layer 2, Preset2, has the mask 0.5\n", "")
    assert [layer.mask for layer in read_look(Path("look.usda")).layers][2] == 0.5
    assert materials("remove", "look.usda", "1") == (0, "look.usda: layer 1, Preset, is removed\n", "")
    assert materials("preview", "look.usda") == (0, "look.usda: /Paint/Preview is up to date\n", "")
    assert [layer.inputs["roughness"] for layer in read_look(Path("look.usda")).layers] == pytest.approx([0.1, 0.3])


def test_what_is_wrong_is_exit_code_2_and_no_traceback(materials, tmp_path):
    for arguments, message in (
        (("new", "look.usda", "gild"), f"no preset 'gild' in {tmp_path}/materials/presets (did you mean 'gold'?)"),
        (("add", "none.usda", "gold"), "none.usda: no such file ('lookdev materials new' makes one)"),
        (("list", "--category", "metall"), "no preset of category 'metall' (did you mean 'metal'?)"),
        (("--library", "nowhere"), "nowhere: --library names no folder"),
        (("mask", "look.usda", "1", "a *"), "\n    a *\n       ^"),
    ):
        code, output, errors = materials(*arguments)
        assert (code, output, message in errors) == (2, "", True), arguments
        assert errors.startswith("lookdev: ")
        assert "Traceback" not in errors


def test_a_sheet_is_rendered_once(materials, tmp_path, monkeypatch, tmp_path_factory):
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path_factory.mktemp("cache")))
    for table, size in (("slots.SLOTS", 64), ("points.SIDE", 32), ("bins.COUNT", 4)):
        monkeypatch.setattr(f"lookdev.light.dome.{table}", size)  # tables of the light that take little time
    worker = tmp_path / "worker"
    worker.mkdir()
    monkeypatch.setattr("lookdev.run.render.run_plan", partial(run_plan, worker_command=case.command(worker)))
    code, output, _ = materials("--sheet", "sheet.png")
    assert code == 0
    assert output.splitlines()[-1] == "3 of 3 frames are done, 3 of them rendered now."
    assert "gold/studio/element.0001" in output
    spec = oiio.ImageBuf("sheet.png").spec()
    assert (spec.width > 2 * 128, spec.height > 128) == (True, True)
    Path("sheet.png").unlink()
    assert materials("--sheet", "sheet.png")[1].splitlines()[-1].endswith("0 of them rendered now.")
    assert Path("sheet.png").is_file()
    preset = Path("materials/presets/rust.usda")
    preset.write_text(preset.read_text().replace("0.2", "0.25"))
    assert materials("--sheet", "sheet.png")[1].splitlines()[-1].endswith("1 of them rendered now.")
    Path("sheet.png").unlink()
    preset.write_text(preset.read_text().replace("0.25", "0.4"))
    case.misbehave(worker, element_0001=["failed"])
    code, _, errors = materials("--sheet", "sheet.png")
    assert code == 1
    assert "rust/studio/element.0001: no such attribute" in errors
    assert not Path("sheet.png").exists(), "a sheet that lacks a preset"
