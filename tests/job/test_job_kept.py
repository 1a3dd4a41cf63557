"""Refined assets are read from the cache by the next run, whole or not at all."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from lookdev.asset import Asset, Instance, Mesh, Slot, load_asset
from lookdev.asset.mesh import Subdivision
from lookdev.asset.silhouette import outline
from lookdev.asset.store import make_asset
from lookdev.cache import take_notes
from lookdev.job import refinery
from lookdev.job.kept import kept_outline
from lookdev.job.refinery import Refinery
from lookdev.scene import Camera

CAMERA = Camera(40.0, 10.0, (0.0, 0.0, 0.0), 8.0)


@pytest.fixture
def cages(tmp_path, monkeypatch) -> Asset:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path))
    monkey = load_asset(builtin="suzanne").meshes[0]
    cage = replace(monkey, name="/a", subdivision=Subdivision("catmullClark"), default_uv="st")
    made = make_asset("a", [cage], [Instance(0, np.eye(4), "/path")], [Slot("/a", "/red")])
    return replace(made, unit=0.01, notes=("a note",))


@pytest.fixture
def calls(monkeypatch) -> list[str]:
    """The names of what was computed."""
    names: list[str] = []

    def counted(name):
        function = getattr(refinery, name)

        def call(*given):
            names.append(name)
            return function(*given)

        monkeypatch.setattr(refinery, name, call)

    counted("refine_all")
    counted("refinement_levels")
    return names


def same(a: Mesh, b: Mesh) -> bool:
    names = [each.name for each in fields(Mesh) if each.name not in ("uvs", "primvars")]
    maps = [(a.uvs, b.uvs), (a.primvars, b.primvars)]
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in names) and all(
        list(x) == list(y) and all(np.array_equal(x[name], y[name]) for name in x) for x, y in maps
    )


@pytest.mark.parametrize("level", ["auto", 1])
def test_the_next_run_reads_what_was_refined(level, cages, calls) -> None:
    first, notes = Refinery(level, 400).refined(cages, CAMERA)
    assert "refine_all" in calls
    calls.clear()
    second, again = Refinery(level, 400).refined(cages, CAMERA)
    assert calls == []
    assert again == notes
    assert same(first.meshes[0], second.meshes[0])
    for name in ("digest", "center", "radius", "slots", "unit", "notes"):
        assert getattr(first, name) == getattr(second, name)
    assert second.instances[0].path == "/path"


@pytest.mark.parametrize("other", ["camera", "width", "cage", "detailed"])
def test_what_differs_is_made_anew(other, cages, calls) -> None:
    Refinery("auto", 400).refined(cages, CAMERA)
    calls.clear()
    camera, width, detailed = CAMERA, 400, ()
    if other == "camera":
        camera = replace(CAMERA, distance=9.0)
    elif other == "width":
        width = 500
    elif other == "detailed":
        detailed = (0,)
    else:
        mesh = replace(cages.meshes[0], subdivision=Subdivision("bilinear"))
        cages = make_asset("a", [mesh], cages.instances, cages.slots)
    Refinery("auto", width).refined(cages, camera, detailed)
    assert "refinement_levels" in calls


@pytest.mark.parametrize("folder", ["refined", "content"])
@pytest.mark.parametrize("harm", ["cut off", "one number", "not text"])
def test_a_damaged_file_is_made_again_with_a_note(folder, harm, cages, calls, tmp_path) -> None:
    first, notes = Refinery("auto", 400).refined(cages, CAMERA)
    files = list((tmp_path / folder).iterdir())
    for file in files:
        content = file.read_bytes()
        if harm == "cut off":
            file.write_bytes(content[: len(content) // 2])
        elif harm == "not text":
            file.write_bytes(b"\xff" + content[1:])
        else:
            middle = content.index(b": [") + 3 if b"levels" in content else len(content) // 2
            file.write_bytes(content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :])
    calls.clear()
    again, more = Refinery("auto", 400).refined(cages, CAMERA)
    assert "refine_all" in calls
    assert again.digest == first.digest
    assert more == notes
    assert set(take_notes()) == {f"{file}: was damaged, and is made again" for file in files}
    calls.clear()
    assert Refinery("auto", 400).refined(cages, CAMERA)[1] == notes
    assert calls == []


def test_missing_arrays_are_made_again_without_a_note(cages, calls, tmp_path) -> None:
    _, notes = Refinery("auto", 400).refined(cages, CAMERA)
    for file in (tmp_path / "content").iterdir():
        file.unlink()
    calls.clear()
    assert Refinery("auto", 400).refined(cages, CAMERA)[1] == notes
    assert calls == ["refine_all"]


def test_one_flipped_byte_of_the_arrays_is_seen(cages, calls, tmp_path) -> None:
    first, _ = Refinery(1, 400).refined(cages, CAMERA)
    (file,) = (tmp_path / "content").iterdir()
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    again, _ = Refinery(1, 400).refined(cages, CAMERA)
    assert same(first.meshes[0], again.meshes[0])


def test_the_outline_of_several_instances_is_found_once(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path))
    monkey = load_asset(builtin="suzanne").meshes[0]
    turned = np.array([[0.0, -1.0, 0.0, 2.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    pair = make_asset("pair", [monkey], [Instance(0, np.eye(4)), Instance(0, turned)], [])
    expected = outline(pair)
    np.testing.assert_array_equal(kept_outline(pair), expected)
    monkeypatch.delattr("lookdev.job.kept.outline")
    np.testing.assert_array_equal(kept_outline(pair), expected)
