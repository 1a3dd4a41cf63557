"""What the Designer edits and saves, without a page."""

from pathlib import Path

import pytest

from lookdev.errors import LookdevError, ModelError
from lookdev.material.usd import read_look
from lookdev.studio.designer.document import Document
from lookdev.studio.designer.edits import Edit, parsed


def test_a_stated_constant_is_a_uniform(document: Document) -> None:
    """So a slider of it changes no shader; stating what the look does not state does."""
    before = document.view().data["looks"][0]
    assert not document.edit(Edit(0, 0, "roughness", 0.9))
    after = document.view().data["looks"][0]
    assert [after[key] for key in ("visible", "relight")] == [before[key] for key in ("visible", "relight")]
    assert after["numbers"]["layer0_roughness"] == pytest.approx([0.9])
    assert document.edit(Edit(0, 0, "sheen", 0.5))
    assert document.view().data["looks"][0]["numbers"]["layer0_sheen"] == [0.5]
    assert not document.edit(Edit(0, 0, "sheen", 0.7))
    assert not document.undo()
    assert document.undo()
    assert document.view().data["looks"][0]["relight"] == before["relight"]
    assert document.edit(Edit(0, 0, "sheenTint", 0.5))


def test_rows_have_the_names_ranges_and_help_of_the_models(document: Document) -> None:
    base, flakes, dust = document.stacks()[0]["layers"]
    assert (dust["name"], dust["enabled"]) == ("Dust", False)
    rows = {row["name"]: row for row in base["parameters"]}
    assert (rows["roughness"]["soft"], rows["roughness"]["uniform"]) == ((0.0, 1.0), "layer0_roughness")
    assert rows["roughness"]["help"]
    assert (rows["sheen"]["value"], rows["sheen"]["uniform"]) == (None, "")
    assert "mask" not in rows
    mask = flakes["parameters"][0]
    assert (mask["name"], mask["varies"]) == ("mask", "texture flakes.png, r")


def test_an_edit_that_cannot_be_is_refused(document: Document) -> None:
    looks = document.looks
    for edit, message in (
        (Edit(3, 0, "roughness", 0.5), "there are 1 looks"),
        (Edit(0, 9, "roughness", 0.5), "none of number 9"),
        (Edit(0, 0, "rougness", 0.5), "did you mean 'roughness'"),
        (Edit(0, 0, "roughness", 7.0), "roughness"),
        (Edit(0, 0, "roughness", (0.1, 0.2, 0.3)), "roughness"),
        (Edit(0, 0, "variant", "2012"), "variant"),
        (Edit(0, 0, "mask", 0.5), "the base has no mask"),
        (Edit(0, 1, "mask", 0.5), "texture or an expression"),
    ):
        with pytest.raises(LookdevError, match=message):
            document.edit(edit)
        assert document.looks == looks, edit
    whole = {"look": 0, "layer": 0}
    for body in ({}, {"look": 0}, *(whole | {"parameter": "sheen", "value": value} for value in ([1, 2], None))):
        with pytest.raises(ModelError, match="an edit has"):
            parsed(body)


def test_what_is_saved_is_what_was_shown(document: Document, look: Path) -> None:
    text = look.read_text()
    document.edit(Edit(0, 0, "roughness", 0.25))
    document.edit(Edit(0, 1, "baseColor", (0.5, 0.25, 0.125)))
    (copy,) = document.save(0, "other.usda")
    assert look.read_text() == text
    assert document.stacks()[0]["unsaved"]
    assert document.save() == [look]
    assert not document.stacks()[0]["unsaved"]
    for file in (copy, look):
        assert read_look(file).layers == document.looks[0].layers
    changed = [pair for pair in zip(text.splitlines(), look.read_text().splitlines(), strict=True) if len({*pair}) > 1]
    assert [new.strip() for _, new in changed] == [
        "float inputs:roughness = 0.25",
        "color3f inputs:baseColor = (0.5, 0.25, 0.125)",
    ]


def test_a_copy_is_a_new_file_beside_the_look(document: Document, look: Path) -> None:
    before = sorted(look.parent.parent.rglob("*"))
    for name in ("../other.usda", "car_paint.usda", "other.txt", "", "/tmp/other.usda"):
        with pytest.raises(LookdevError):
            document.save(0, name)
        assert sorted(look.parent.parent.rglob("*")) == before, name
