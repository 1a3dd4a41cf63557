"""Presets are found by name, in the folders that the user or the environment names."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from look_files import write_preset

from lookdev.errors import LookError
from lookdev.material.library import (
    LIBRARY_VARIABLE,
    SHIPPED,
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


@pytest.mark.parametrize(
    ("text", "where", "what"),
    [
        ('#usda 1.0\ndef Shader "A" {}\n', "", "has no default prim"),
        ('#usda 1.0\n(defaultPrim = "A")\ndef Material "A" {}\n', "/A", "is a Material"),
        ('#usda 1.0\n(defaultPrim = "A")\ndef "A" {}\n', "/A", "is a prim without a type"),
        ('#usda 1.0\n(defaultPrim = "A")\ndef Shader "A" {}\n', "/A", "its info:id is ''"),
        (
            '#usda 1.0\n(defaultPrim = "A")\ndef Shader "A" {\n uniform token info:id = "LookdevDisney"\n}\n',
            "/A",
            "has no outputs:layer",
        ),
    ],
)
def test_what_is_no_preset(tmp_path: Path, text: str, where: str, what: str) -> None:
    (tmp_path / "a.usda").write_text(text)
    with pytest.raises(LookError) as caught:
        find_preset("a.usda")
    (fault,) = caught.value.faults
    assert (fault.where, fault.what) == (where, what)
    assert fault.hint


def test_folders_given_named_here_and_shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here, shipped = tmp_path / SHIPPED[0], tmp_path / "checkout" / SHIPPED[0]
    with pytest.raises(LookError, match=r"no folder .*materials/presets or .*classic or .*checkout/materials/presets"):
        library_folders()
    shipped.mkdir(parents=True)
    assert library_folders() == (shipped,)
    here.mkdir(parents=True)
    assert library_folders() == (here, shipped)
    (tmp_path / SHIPPED[1]).mkdir()
    assert library_folders() == (here, tmp_path / SHIPPED[1], shipped)
    (tmp_path / "a").mkdir()
    monkeypatch.setenv(LIBRARY_VARIABLE, os.pathsep.join(["a", "", str(here)]))
    assert library_folders() == (tmp_path / "a", here)
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
    look = """#usda 1.0
(defaultPrim = "M")
def Material "M" (
    doc = "Matte."
    customData = {
        string category = "classic"
    }
) {
    float inputs:a = 0.3
    token outputs:lookdev:surface.connect = </M/B.outputs:layer>
    def Shader "B" {
        uniform token info:id = "LookdevLambert"
        %s
        token outputs:layer
    }
}
"""
    (tmp_path / "matte.usda").write_text(look % "")
    preset = read_preset(tmp_path / "matte.usda")
    assert (preset.prim, preset.model, preset.category, preset.doc) == ("/M/B", "lambert", "classic", "Matte.")
    # A reference to the layer alone would lose what it is connected to.
    (tmp_path / "linked.usda").write_text(look % "color3f inputs:reflectance.connect = </M.inputs:a>")
    with pytest.raises(LookError, match="is a Material"):
        read_preset(tmp_path / "linked.usda")


def test_an_unknown_name_is_reported_with_the_folders_and_the_nearest(tmp_path: Path) -> None:
    write_preset(tmp_path / "gold.usda")
    write_preset(tmp_path / "rust.usda", category="stone")
    with pytest.raises(LookError) as caught:
        find_preset("gild", tmp_path)
    assert str(caught.value) == f"library: no preset 'gild' in {tmp_path} (did you mean 'gold'?)"
    with pytest.raises(LookError, match=r"no preset of category 'metall' \(did you mean 'metal'\?\)"):
        read_library([tmp_path], "metall")


def test_an_empty_library(tmp_path: Path) -> None:
    for look in (lambda: read_library([tmp_path]), lambda: find_preset("gold", tmp_path)):
        with pytest.raises(LookError, match=r"put \*\.usda files there"):
            look()


def test_the_shipped_library_reads_without_a_fault() -> None:
    library = read_library([Path(__file__).parents[2] / folder for folder in SHIPPED])
    assert library.faults == ()
    assert len(library.presets) >= 32
    assert all(preset.category and preset.doc for preset in library.presets)
