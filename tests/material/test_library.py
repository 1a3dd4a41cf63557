"""Presets are found by name, in the folders that the user or the environment names."""

import os
from pathlib import Path

import pytest
from look_files import faults_of, look, shader, write_preset

from lookdev.errors import LookError
from lookdev.material.library import (
    LIBRARY_VARIABLE,
    SHIPPED_FOLDERS,
    find_preset,
    library_folders,
    library_text,
    read_library,
    read_preset,
)


@pytest.fixture(autouse=True)
def _alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Isolate the test from the user's environment and from the checkout."""
    monkeypatch.delenv(LIBRARY_VARIABLE, raising=False)
    monkeypatch.setattr("lookdev.material.library.shipped_folder", lambda: tmp_path / "checkout")
    monkeypatch.chdir(tmp_path)


def test_a_library_is_a_table_by_category_and_name(tmp_path: Path) -> None:
    write_preset(tmp_path / "gold.usda", doc="Polished gold. It is soft.")
    write_preset(tmp_path / "glass.usda", model="LookdevPixar", category="glass", doc="Clear\n  glass.")
    write_preset(tmp_path / "brass.usda")
    library = read_library([tmp_path])
    assert [preset.name for preset in library.presets] == ["glass", "brass", "gold"]
    assert [preset.doc for preset in library.presets] == ["Clear glass.", "", "Polished gold. It is soft."]
    assert library_text(library).splitlines() == [
        "name   category  model",
        "glass  glass     pixar   Clear glass",
        "brass  metal     disney",
        "gold   metal     disney  Polished gold",
    ]
    assert [preset.name for preset in read_library([tmp_path], "glass").presets] == ["glass"]


def test_a_broken_file_is_reported_and_hides_no_preset(tmp_path: Path) -> None:
    write_preset(tmp_path / "gold.usda")
    (tmp_path / "broken.usda").write_text("#usda 1.0\ndef {")
    (tmp_path / "notes.txt").write_text("not a preset")
    (tmp_path / ".gold.1-abcdef01.usda").write_text("left by a killed edit")
    library = read_library([tmp_path])
    assert [preset.name for preset in library.presets] == ["gold"]
    assert [Path(fault.file).name for fault in library.faults] == ["broken.usda"]


PLAIN = '#usda 1.0\n(defaultPrim = "A")\n'


@pytest.mark.parametrize(
    ("text", "where", "expected_summary"),
    [
        ('#usda 1.0\ndef Shader "A" {}\n', "", "has no default prim"),
        (PLAIN + 'def Material "A" {}\n', "/A", "is a Material"),
        (PLAIN + 'def "A" {}\n', "/A", "is a prim without a type"),
        (PLAIN + 'def Shader "A" {}\n', "/A", "its info:id is ''"),
        (PLAIN + shader("A", "LookdevDisney"), "/A", "has no outputs:layer"),
    ],
)
def test_what_is_no_preset(tmp_path: Path, text: str, where: str, expected_summary: str) -> None:
    file = tmp_path / "a.usda"
    file.write_text(text)
    ((path, summary, hint),) = faults_of(file, lambda _: find_preset("a.usda"))
    assert (path, summary) == (where, expected_summary)
    assert hint


def test_folders_given_named_here_and_shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    local, shipped = tmp_path / SHIPPED_FOLDERS[0], tmp_path / "checkout" / SHIPPED_FOLDERS[0]
    with pytest.raises(LookError, match=r"no folder .*materials/presets or .*classic or .*checkout/materials/presets"):
        library_folders()
    shipped.mkdir(parents=True)
    assert library_folders() == (shipped,)
    local.mkdir(parents=True)
    assert library_folders() == (local, shipped)
    (tmp_path / SHIPPED_FOLDERS[1]).mkdir()
    assert library_folders() == (local, tmp_path / SHIPPED_FOLDERS[1], shipped)
    (tmp_path / "a").mkdir()
    monkeypatch.setenv(LIBRARY_VARIABLE, os.pathsep.join(["a", "", str(local)]))
    assert library_folders() == (tmp_path / "a", local)
    assert library_folders(Path("a")) == (tmp_path / "a",)
    with pytest.raises(LookError, match=r"b: --library names no folder"):
        library_folders(Path("b"))
    monkeypatch.setenv(LIBRARY_VARIABLE, "c")
    with pytest.raises(LookError, match=r"c: \$LOOKDEV_LIBRARY names no folder"):
        library_folders()


def test_the_first_folder_wins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        write_preset(tmp_path / folder / "gold.usda", doc=folder)
    monkeypatch.setenv(LIBRARY_VARIABLE, os.pathsep.join("ba"))
    assert find_preset("Gold").doc == "b"
    assert [preset.doc for preset in read_library(library_folders()).presets] == ["b"]
    assert find_preset("a/gold.usda").doc == "a"


def test_a_look_of_one_constant_layer_is_a_preset(tmp_path: Path) -> None:
    metadata = '(\n doc = "Matte."\n customData = {\n string category = "classic"\n }\n)'
    for name, inputs in (("matte", ""), ("linked", "color3f reflectance <- .a")):
        layer = shader("B", "LookdevLambert", inputs + "\ntoken outputs:layer")
        (tmp_path / f"{name}.usda").write_text(look("float a = 0.3\n" + layer, "</M/B.outputs:layer>", metadata))
    preset = read_preset(tmp_path / "matte.usda")
    assert (preset.prim, preset.model, preset.category, preset.doc) == ("/M/B", "lambert", "classic", "Matte.")
    # A reference to the layer alone would lose what it is connected to.
    with pytest.raises(LookError, match="is a Material"):
        read_preset(tmp_path / "linked.usda")


def test_an_unknown_name_is_reported_with_the_folders_and_the_nearest(tmp_path: Path) -> None:
    write_preset(tmp_path / "gold.usda")
    write_preset(tmp_path / "rust.usda", category="stone")
    with pytest.raises(LookError, match=rf"^library: no preset 'gild' in {tmp_path} \(did you mean 'gold'\?\)$"):
        find_preset("gild", tmp_path)
    with pytest.raises(LookError, match=r"no preset of category 'metall' \(did you mean 'metal'\?\)"):
        read_library([tmp_path], "metall")


def test_an_empty_library(tmp_path: Path) -> None:
    for find in (lambda: read_library([tmp_path]), lambda: find_preset("gold", tmp_path)):
        with pytest.raises(LookError, match=r"put \*\.usda files there"):
            find()
