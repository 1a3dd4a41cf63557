"""Assignments of looks to parts, edited by the Designer and written into the job."""

import difflib
import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from lookdev.build.scenes import build_scenes
from lookdev.errors import LookdevError
from lookdev.job import load_job
from lookdev.studio.designer.document import Document
from lookdev.studio.designer.edits import Edit
from lookdev.studio.designer.open_document import open_document
from lookdev.studio.designer.sources import ConflictError

ROOT = Path(__file__).parents[2]
WINDOWS = "/Car/Body/Windows"


@pytest.fixture
def folder(tmp_path: Path, toy_car: str) -> Path:
    """Return a copy of the job of parts, with what it needs."""
    shutil.copytree(ROOT / "materials" / "textures", tmp_path / "materials" / "textures")
    for name in ("brushed_metal", "car_paint", "frosted_plastic"):
        shutil.copy(ROOT / "materials" / f"{name}.usda", tmp_path / "materials")
    shutil.copytree(ROOT / "jobs" / "assets", tmp_path / "jobs" / "assets")
    (tmp_path / "jobs" / "assets" / "toy_car.usda").write_text(toy_car)
    shutil.copy(ROOT / "jobs" / "parts.toml", tmp_path / "jobs")
    return tmp_path


@pytest.fixture
def job(folder: Path) -> Path:
    return folder / "jobs" / "parts.toml"


@pytest.fixture
def document(job: Path) -> Document:
    opened = open_document(job)
    opened.choose("workshop", "courtyard")
    return opened


def looks_of_parts(document: Document) -> dict[str, str]:
    """Return the names of the looks of the visible scene, by part."""
    return {path: look.name for path, look in document.scene.look_of_slot.items()}


def assignment(document: Document, part: str) -> Any:
    return document.status()["job"]["assignments"][part]


def test_a_part_has_another_look_and_the_saved_job_shows_it(document: Document, job: Path) -> None:
    before, text = looks_of_parts(document), job.read_text()
    assert assignment(document, WINDOWS)["variants"] == {"metal": "copper"}
    assert assignment(document, "/Car/Wheels/BackLeft/Tire")["by"] == "asset"
    plastic = "../materials/frosted_plastic.usda"
    assert document.assign_look({"part": WINDOWS, "prims": [WINDOWS], "material": plastic})
    assert looks_of_parts(document) == {**before, WINDOWS: "FrostedPlastic"}
    assert assignment(document, WINDOWS) == {
        "paths": [WINDOWS], "by": "assign", "pattern": WINDOWS, "material": plastic, "variants": {},
    }  # fmt: skip
    assert document.status()["undoes"] == f"assign frosted_plastic to {WINDOWS}"
    assert document.status()["job"]["unsaved"]
    number = [stack["name"] for stack in document.stacks()].index("FrostedPlastic")
    document.edit(Edit(number, 0, "roughness", 0.66))
    edited_scene = document.scene
    assert {file.name for file in document.save()} == {"parts.toml", "frosted_plastic.usda"}
    rendered = build_scenes(load_job(job)).scenes["workshop", "courtyard"]
    saved, expected = (
        {path: look.layers for path, look in scene.look_of_slot.items()} for scene in (rendered, edited_scene)
    )
    assert saved == expected
    replaced_lines = [
        line[2:] for line in difflib.ndiff(text.splitlines(), job.read_text().splitlines()) if line[0] == "-"
    ]
    assert replaced_lines == ['prims = ["/Car.collection:trim", "/Car/Body/Windows", "/Car/Wheels/Front*/Tire"]']
    document.undo()
    assert document.undo()
    assert looks_of_parts(document) == before
    document.save()
    assert job.read_text() == text
    assert document.undo(1)
    assert looks_of_parts(document)[WINDOWS] == "FrostedPlastic"


def test_one_of_several_instances_has_a_look_of_its_own(document: Document) -> None:
    hubs = assignment(document, "/Car/Wheels/FrontLeft/Hub")["paths"]
    assert len(hubs) == 4
    paint = "../materials/car_paint.usda"
    document.assign_look({"part": hubs[0], "prims": [hubs[3]], "material": paint, "variants": {"wear": "dusty"}})
    looks = looks_of_parts(document)
    assert looks["/Car/Wheels/FrontLeft/Hub"] == "BrushedMetal"
    assert looks[hubs[3]] == "CarPaint"


def test_everything_else_has_a_look(document: Document) -> None:
    document.assign_look({"part": WINDOWS, "prims": [], "material": "../materials/frosted_plastic.usda"})
    looks = looks_of_parts(document)
    # The look's own material has the look's name.
    assert looks["/Car/Chimney"] == looks["/Car/Wheels/BackLeft/Tire"] == "workshop"
    assert looks["/Car/Body"] == "CarPaint"
    assert assignment(document, "/Car/Chimney")["by"] == "look"


def test_a_look_is_made_of_a_preset(document: Document, job: Path) -> None:
    document.assign_look({"part": WINDOWS, "prims": [WINDOWS], "preset": "red_plastic", "file": "panes.usda"})
    assert looks_of_parts(document)[WINDOWS] == "Panes"
    assert document.location([stack["name"] for stack in document.stacks()].index("Panes"))
    before = sorted(job.parent.iterdir())
    for name in ("panes.usda", "../panes2.usda", "panes.txt"):
        with pytest.raises(LookdevError):
            document.assign_look({"part": WINDOWS, "prims": [WINDOWS], "preset": "red_plastic", "file": name})
    with pytest.raises(LookdevError, match="fits no part"):
        document.assign_look({"part": WINDOWS, "prims": ["/Car/Bdy"], "preset": "red_plastic", "file": "new.usda"})
    assert sorted(job.parent.iterdir()) == before


REFUSED = [
    ({}, "an assignment needs"),
    ({"prims": ["/Car/Bdy"]}, "did you mean"),
    ({"part": "/Car/Wndows"}, "is not a part"),
    ({"prims": [3]}, "an assignment needs"),
    ({"material": "../materials/none.usda"}, "no readable file"),
    ({"material": "/etc/passwd"}, "reads only looks in"),
    ({"material": "assets/toy_car.usda", "prim": "/Car"}, "Car"),
    ({"variants": {"a": "b"}}, "variant"),
    ({"part": "/Car/Wheels/BackLeft/Tire", "unassign": True}, "nothing is assigned"),
]


def test_what_cannot_be_worn_is_refused_and_nothing_changes(document: Document) -> None:
    before = looks_of_parts(document), document.status()["undoes"]
    whole = {"part": WINDOWS, "prims": [WINDOWS], "material": "../materials/car_paint.usda"}
    for body, message in REFUSED:
        with pytest.raises(LookdevError, match=message):
            document.assign_look(whole | body if body else {})
        assert (looks_of_parts(document), document.status()["undoes"]) == before, body


def test_a_job_that_is_changed_on_disk_is_loaded_or_written_over(document: Document, job: Path) -> None:
    document.assign_look({"part": "/Car/Body", "unassign": True})
    job.write_text(job.read_text().replace('prims = ["/Car/Body"]', 'prims = ["/Car/Body", "/Car/Chimney"]'))
    assert document.revision_status()["changed"] == [str(job)]
    with pytest.raises(ConflictError):
        document.save()
    assert document.reload()
    assert looks_of_parts(document)["/Car/Chimney"] == "CarPaint"
    assert not document.status()["job"]["unsaved"]
    job.write_text("look = 3")
    with pytest.raises(LookdevError, match="look"):
        document.reload()
    assert looks_of_parts(document)["/Car/Chimney"] == "CarPaint"


def test_unsaved_assignments_survive_a_crash(job: Path) -> None:
    document = open_document(job, recovers=True)
    document.choose("workshop", "courtyard")
    document.assign_look({"part": "/Car/Body", "unassign": True})
    document.close()  # the lock, as the end of a process frees it; the record stays
    again = open_document(job, recovers=True)
    assert again.status()["recovery"]["files"] == [{"file": str(job), "changed": False}]
    again.recover(restore=True)
    assert again.scene_key == ("workshop", "courtyard")
    assert assignment(again, "/Car/Body")["by"] == "asset"


def test_an_asset_without_a_job_gets_one(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    asset, job_file = Path("jobs/assets/toy_car.usda"), folder / "toy_car.toml"
    document = open_document(asset, recovers=True)
    assert document.status()["job"]["new"]
    assert document.save() == []
    document.assign_look({"part": WINDOWS, "prims": [WINDOWS], "material": "materials/frosted_plastic.usda"})
    document.close()
    assert not job_file.exists()
    again = open_document(asset, recovers=True)
    again.recover(restore=True)
    assert looks_of_parts(again)[WINDOWS] == "FrostedPlastic"
    assert again.save() == [job_file]
    assert not again.status()["job"]["new"]
    assert f'usd = "{os.path.relpath(asset)}"' in job_file.read_text()
    assert build_scenes(load_job(job_file)).scenes["own", "courtyard"].look_of_slot[WINDOWS].name == "FrostedPlastic"
    assert open_document(asset).status()["job"]["file"] == str(folder / "toy_car_2.toml")
    again.assign_look({"part": WINDOWS, "unassign": True})
    again.close()
    third = open_document(asset, recovers=True)
    assert third.recover(restore=True)
    assert looks_of_parts(third)[WINDOWS] != "FrostedPlastic"
    assert third.save() == [job_file]


def test_a_light_that_ships_is_shown_and_not_saved(document: Document, job: Path) -> None:
    text = job.read_text()
    assert document.choices["looks"] == ["own_blue", "own_red", "racing", "workshop"]
    assert {"studio", "three_point"} <= {*document.choices["shipped"]}
    assert "courtyard" not in document.choices["shipped"]
    document.choose("workshop", "three_point")
    assert len(document.scene.lights) > 1
    document.assign_look({"part": "/Car/Body", "unassign": True})
    assert document.scene_key == ("workshop", "three_point")
    assert document.job.rigs[-1].name == "three_point"
    document.save()
    assert "three_point" not in job.read_text() != text


def test_looks_that_cannot_be_edited_say_why(job: Path) -> None:
    document = open_document(job)
    assert "translated from preview_surface" in document.stacks()[0]["locked"]
    with pytest.raises(LookdevError, match="cannot be edited here"):
        document.edit_stack(0, {"op": "add", "preset": "rust"})


def test_what_can_be_worn_is_listed(document: Document) -> None:
    materials = document.list_materials()
    assert {"material": "../materials/car_paint.usda", "prim": None, "variants": {"wear": "dusty"}} in materials["job"]
    assert "../materials/frosted_plastic.usda" in materials["files"]
    assert "parts.toml" not in materials["files"]


def test_a_look_that_was_saved_is_edited_in_another_variant(document: Document) -> None:
    """An assignment reads the job anew, from its present content."""
    number = [stack["name"] for stack in document.stacks()].index("CarPaint")
    document.edit(Edit(number, 0, "roughness", 0.31))
    document.save()
    paint = "../materials/car_paint.usda"
    document.assign_look({"part": WINDOWS, "prims": [WINDOWS], "material": paint, "variants": {"wear": "clean"}})
    stacks = [stack for stack in document.stacks() if stack["name"] == "CarPaint"]
    assert [stack["locked"] for stack in stacks] == ["", ""]
    rows = [row for stack in stacks for row in stack["layers"][0]["parameters"] if row["name"] == "roughness"]
    assert [row["value"] for row in rows] == pytest.approx([0.31, 0.31])
