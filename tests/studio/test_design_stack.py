"""The Designer's document, without a page: parameters, layers, one history of all edits, files, and unsaved work."""

import itertools
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from usd_text import job_toml

from lookdev.errors import LookdevError, ModelError
from lookdev.material import Formula, Primvar, Texture
from lookdev.material.library import find_preset
from lookdev.material.usd import read_look
from lookdev.studio.designer.document import Document
from lookdev.studio.designer.edits import Edit, parse_edit
from lookdev.studio.designer.history import MAX_STEPS, EditState, History
from lookdev.studio.designer.open_document import open_document
from lookdev.studio.designer.recovery import Recovery, UnsavedWork
from lookdev.studio.designer.snapshots import Snapshots
from lookdev.studio.designer.sources import ConflictError
from lookdev.studio.designer.thumbnails import SIZE, thumbnail

ROOT = Path(__file__).parents[2]


@pytest.fixture
def records(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of the Designer's records of unsaved work."""
    monkeypatch.setenv("LOOKDEV_STATE", str(tmp_path / "state"))
    return tmp_path / "state" / "designer"


@pytest.fixture
def look(tmp_path: Path, car_paint: Callable[[Path], Path]) -> Path:
    (tmp_path / "looks").mkdir()
    return car_paint(tmp_path / "looks")


@pytest.fixture
def document(look: Path) -> Document:
    return open_document(None, "plane", look, recovers=True)


def names(document: Document) -> list[str]:
    return [layer["name"] for layer in document.stacks()[0]["layers"]]


def do(document: Document, op: str, **body: Any) -> bool:
    return document.edit_stack(0, {"op": op, **body})


def test_a_stated_constant_is_a_uniform(document: Document) -> None:
    """Its slider changes no shader; a constant that the look does not state yet changes one."""
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
            parse_edit(body)


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


STEPS: dict[str, Callable[[Document], Any]] = {
    "mask": lambda d: do(d, "mask", layer=1, mask="0.25", inputs={}),
    "mute": lambda d: do(d, "enable", layer=1, enabled=False),
    "add": lambda d: do(d, "add", preset="rust"),
    "remove": lambda d: do(d, "remove", layer=1),
    "duplicate": lambda d: do(d, "duplicate", layer=1),
    "rename": lambda d: do(d, "rename", layer=2, name="Grime"),
    "move": lambda d: do(d, "move", layer=2, to=1),
    "variant": lambda d: do(d, "variant", set="wear", choice="dusty"),
    "paste": lambda d: do(d, "paste", text=d.copy(0, 1)),
    "slider": lambda d: d.edit(Edit(0, 0, "roughness", 0.75)),
}


def test_everything_is_one_history(document: Document, look: Path) -> None:
    text, states = look.read_text(), [document.stacks()]
    for step in STEPS.values():
        step(document)
        states.append(document.stacks())
    assert [a == b for a, b in itertools.pairwise(states)] == [False] * len(STEPS)
    for state in reversed(states[:-1]):
        document.undo()
        assert document.stacks() == state
    assert document.status()["undoes"] is None
    for state in states[1:]:
        document.undo(1)
        assert document.stacks() == state
    assert look.read_text() == text
    document.save()
    assert read_look(look).layers == document.looks[0].layers
    assert sorted(entry.name for entry in look.parent.iterdir()) == ["car_paint.usda", "textures"]


@pytest.mark.parametrize("name", STEPS)
def test_a_step_compiles_where_shaders_differ_and_only_there(name: str, document: Document) -> None:
    before = document.view().data["looks"][0]
    compiles = STEPS[name](document)
    after = document.view().data["looks"][0]
    assert compiles == (after["relight"] != before["relight"])
    assert compiles == (name not in ("rename", "slider", "move"))  # the layers that move here are not both shown


def test_a_gesture_is_one_step(document: Document) -> None:
    for value in (0.5, 0.6, 0.7):
        document.edit(Edit(0, 0, "roughness", value, gesture="drag"))
    document.edit(Edit(0, 0, "roughness", 0.8, gesture="another"))
    document.undo()
    assert document.looks[0].layers[0].inputs["roughness"] == pytest.approx(0.7)
    document.undo()
    assert document.status()["undoes"] is None


def test_solo_is_of_the_view_alone(document: Document, look: Path) -> None:
    document.solo(0, 1)
    (look_of_part,) = document.scene.look_of_slot.values()
    assert [(layer.name, layer.mask) for layer in look_of_part.layers] == [("Flakes", 1.0)]
    assert (document.status()["undoes"], document.is_unsaved(0)) == (None, False)
    (row,) = [row for row in document.stacks()[0]["layers"][1]["parameters"] if row["name"] == "roughness"]
    assert row["uniform"] == "layer0_roughness"
    assert document.view().data["looks"][0]["numbers"]["layer0_roughness"] == [row["value"]]
    with pytest.raises(LookdevError, match="muted"):
        document.solo(0, 2)
    document.solo(0, None)
    assert len(document.scene.looks[0].layers) == 2


def test_masks_are_given_and_shown_as_they_are_typed(document: Document) -> None:
    for mask, inputs, kind in (
        ("textures/dirt.png:g", {}, Texture),
        ("primvar:wear", {}, Primvar),
        ("smoothstep(dirt, edge, .7)", {"dirt": "textures/dirt.png:r", "edge": "0.25"}, Formula),
    ):
        do(document, "mask", layer=1, mask=mask, inputs=inputs)
        assert isinstance(document.looks[0].layers[1].mask, kind)
        row = document.stacks()[0]["layers"][1]["mask"]
        assert (row["text"], row["inputs"]) == (mask, inputs)


def test_the_numbers_of_an_expression_are_parameters(document: Document) -> None:
    do(document, "mask", layer=1, mask="dirt * edge", inputs={"dirt": "textures/dirt.png", "edge": "0.25"})
    assert document.edit(Edit(0, 1, "mask.edge", 0.5))
    rows = {row["name"]: row["value"] for row in document.stacks()[0]["layers"][1]["parameters"]}
    assert rows["mask.edge"] == 0.5
    # A name that is not typed anew keeps its source.
    do(document, "mask", layer=1, mask="1 - dirt", inputs={})
    assert document.stacks()[0]["layers"][1]["mask"]["inputs"] == {"dirt": "textures/dirt.png:r"}


REFUSED = [
    ({"op": "mask", "layer": 1, "mask": "/etc/hosts.png", "inputs": {}}, "no such image file"),
    ({"op": "mask", "layer": 1, "mask": "../secret.png", "inputs": {}}, "reads only images in"),
    ({"op": "mask", "layer": 1, "mask": "smothstep(a)", "inputs": {}}, "did you mean 'smoothstep'"),
    ({"op": "mask", "layer": 1, "mask": "dirt", "inputs": {}}, "'dirt' in the expression has no source"),
    ({"op": "mask", "layer": 0, "mask": "0.5", "inputs": {}}, "is the base"),
    ({"op": "mask", "layer": 1, "mask": "part:/Car", "inputs": {}}, "assign a look of its own to the part"),
    ({"op": "add", "preset": "rsut"}, "did you mean 'rust'"),
    ({"op": "add", "preset": "../../secret.usda"}, "no preset 'secret'"),
    ({"op": "remove", "layer": 9}, "has no layer 9"),
    ({"op": "move", "layer": 1, "to": 0}, "the base stays beneath"),
    ({"op": "mode", "layer": 1, "mode": "transmit"}, "cannot be 'transmit'"),
    ({"op": "variant", "set": "wear", "choice": "dirty"}, "did you mean 'dusty'"),
    ({"op": "paste", "text": "roughness"}, "no layer of a look"),
    ({"op": "erase"}, "an edit of the stack has"),
    ({"op": "add", "preset": "rust"}, "the scene is too large"),
]


def test_what_cannot_be_done_changes_nothing(
    document: Document, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fail = Mock(side_effect=LookdevError("the scene is too large"))
    monkeypatch.setattr("lookdev.studio.designer.document.view_scene", fail)
    (tmp_path / "secret.usda").touch()
    shutil.copy(ROOT / "materials" / "textures" / "dirt.png", tmp_path / "secret.png")
    before = document.status()
    for body, message in REFUSED:
        with pytest.raises(LookdevError, match=message):
            document.edit_stack(0, body)
        assert document.status() == before, body


def test_a_file_that_others_changed_is_not_written_over(document: Document, look: Path) -> None:
    document.edit(Edit(0, 0, "roughness", 0.75))
    theirs = look.read_text().replace("inputs:specular = 0.5", "inputs:specular = 0.25")
    look.write_text(theirs)
    assert document.revision_status()["changed"] == [str(look)]
    with pytest.raises(ConflictError):
        document.save()
    assert look.read_text() == theirs
    document.reload()
    assert (document.revision_status()["changed"], document.is_unsaved(0)) == ([], False)
    assert document.looks[0].layers[0].inputs["specular"] == 0.25
    document.undo()
    assert document.looks[0].layers[0].inputs["roughness"] == pytest.approx(0.75)
    assert document.is_unsaved(0)
    document.save()
    assert "specular = 0.5" in look.read_text()


def test_ones_own_edits_are_kept_or_saved_over(document: Document, look: Path) -> None:
    document.edit(Edit(0, 0, "roughness", 0.75))
    look.write_text(look.read_text() + "# theirs\n")
    document.keep_edits()
    document.save()
    assert "theirs" not in look.read_text()
    look.unlink()
    with pytest.raises(ConflictError):
        document.save(0)
    document.save(0, overwrite=True)
    assert read_look(look).layers == document.looks[0].layers


def test_unsaved_work_is_offered_and_taken_by_the_next(document: Document, look: Path) -> None:
    do(document, "rename", layer=2, name="Grime")
    second = open_document(None, "plane", look, recovers=True)
    assert second.status()["recovery"] is None  # the first one is still there
    document.close()
    third = open_document(None, "plane", look, recovers=True)
    assert [entry["file"] for entry in third.status()["recovery"]["files"]] == [str(look)]
    assert names(third)[2] == "Dust"
    third.recover(restore=True)
    assert (names(third)[2], third.status()["recovery"]) == ("Grime", None)
    third.undo()
    assert names(third)[2] == "Dust"
    third.undo(1)
    third.save()
    third.close()
    assert open_document(None, "plane", look, recovers=True).status()["recovery"] is None


def test_unsaved_work_on_a_file_that_changed_since_warns(document: Document, look: Path) -> None:
    do(document, "rename", layer=2, name="Grime")
    document.close()
    look.write_text(look.read_text() + "# theirs\n")
    second = open_document(None, "plane", look, recovers=True)
    assert second.status()["recovery"]["files"][0]["changed"]
    second.recover(restore=True)
    with pytest.raises(ConflictError):
        second.save()


def test_discarded_work_is_gone(records: Path, document: Document, look: Path) -> None:
    do(document, "rename", layer=2, name="Grime")
    document.close()
    second = open_document(None, "plane", look, recovers=True)
    second.recover(restore=False)
    second.close()
    assert list(records.iterdir()) == []
    with pytest.raises(LookdevError, match="no unsaved work"):
        second.recover(restore=True)


@pytest.mark.parametrize("text", ["", "{}", '{"files": 3}', "[" * 10000])
def test_a_damaged_record_is_passed_over(text: str, records: Path) -> None:
    recovery = Recovery("job")
    recovery.store(UnsavedWork({Path("a.usda"): (b"a", "")}, {}, 1.0))
    (record,) = records.glob("*.json")
    recovery.close()
    record.write_text(text)
    assert Recovery("job").work is None


def test_a_folder_that_cannot_be_written_is_an_error_in_words(look: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    document = open_document(None, "plane", look)
    monkeypatch.setattr(Path, "write_bytes", Mock(side_effect=PermissionError(13, "Permission denied")))
    with pytest.raises(LookdevError, match="copy the look to a folder of your own"):
        do(document, "add", preset="rust")


def test_snapshots_are_gone_back_to(document: Document) -> None:
    document.store_snapshot(b"\x89PNG\r\n\x1a\n")
    do(document, "add", preset="rust")
    assert [entry["name"] for entry in document.status()["snapshots"]] == ["snapshot 1"]
    assert document.show_snapshot(1)
    assert names(document) == ["Base", "Flakes", "Dust"]
    document.undo()
    assert names(document)[-1] == "Rust"
    with pytest.raises(LookdevError, match="no snapshot 7"):
        document.show_snapshot(7)
    with pytest.raises(LookdevError, match="is a PNG"):
        document.store_snapshot(b"GIF89a")


def test_histories_and_snapshots_have_an_end() -> None:
    history, snapshots = History(), Snapshots()
    for number in range(MAX_STEPS + 50):
        history.push(str(number), EditState())
        snapshots.store(b"\x89PNG\r\n\x1a\n", EditState(), ("", ""))
    assert len(list(iter(lambda: history.step(-1), None))) == MAX_STEPS
    assert len(snapshots.describe()) == 24


def test_a_variant_that_the_job_chooses_is_only_shown(look: Path) -> None:
    job = look.with_name("job.toml")
    job.write_text(job_toml(f"worn = {look}").replace('.usda" }', '.usda", variants = { wear = "dusty" } }'))
    document = open_document(job)
    (row,) = document.stacks()[0]["variants"]
    assert (row["chosen"], row["by_job"]) == ("dusty", True)
    assert do(document, "variant", set="wear", choice="clean")
    assert (len(document.looks[0].layers), document.is_unsaved(0)) == (2, False)
    document.undo()
    assert len(document.looks[0].layers) == 3


def test_a_layer_is_saved_as_a_preset(document: Document, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    library = tmp_path / "library"
    library.mkdir()
    monkeypatch.setenv("LOOKDEV_LIBRARY", str(library))
    file = document.save_preset(0, 1, "blue_flakes", "paint")
    preset = find_preset("blue_flakes")
    assert (preset.file, preset.category, preset.doc) == (file, "paint", "Blue flakes.")
    do(document, "add", preset="blue_flakes")
    layers = document.looks[0].layers
    assert (layers[-1].name, layers[-1].inputs) == ("BlueFlakes", layers[1].inputs)
    assert document.save_preset(0, 0, "base_coat", "").is_file()  # with the value of the interface
    for name, message in (("blue_flakes", "exists already"), ("../blue", "not a name of a preset"), ("", "not a name")):
        with pytest.raises(LookdevError, match=message):
            document.save_preset(0, 1, name, "paint")
    textured = open_document(None, "plane", ROOT / "materials" / "brushed_metal.usda")
    with pytest.raises(LookdevError, match="only constants"):
        textured.save_preset(0, 0, "brushed", "metal")
    assert len(list(library.iterdir())) == 2


def test_pictures_of_presets_are_spheres_on_nothing() -> None:
    from matplotlib.image import imread

    pixels = imread(thumbnail(find_preset("dust", ROOT / "materials" / "presets")))
    assert (pixels.shape, pixels[0, 0, 3], pixels[SIZE // 2, SIZE // 2, 3]) == ((SIZE, SIZE, 4), 0.0, 1.0)
    # Lit from above.
    assert pixels[SIZE // 4, SIZE // 2, :3].mean() > pixels[-SIZE // 8, SIZE // 2, :3].mean() > 0.0
