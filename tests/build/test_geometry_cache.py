"""The next run reads refined assets from the cache, complete or not at all."""

from dataclasses import fields, replace

import numpy as np
import pytest

from lookdev.asset import Asset, Instance, Mesh, Slot, load_asset
from lookdev.asset.mesh import Subdivision
from lookdev.asset.silhouette import hull_points
from lookdev.asset.store import make_asset
from lookdev.build import refine as refinery
from lookdev.build.refine import Refiner, cached_outline, geometry_key
from lookdev.cache import take_notes
from lookdev.scene import Camera

CAMERA = Camera(40.0, 10.0, (0.0, 0.0, 0.0), 8.0, axis=(1.0, 2.0))


@pytest.fixture
def cages(tmp_path, monkeypatch) -> Asset:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path))
    monkey = load_asset(builtin="suzanne").meshes[0]
    cage = replace(monkey, name="/a", subdivision=Subdivision("catmullClark"), default_uv="st")
    asset = make_asset("a", [cage], [Instance(0, np.eye(4), "/path")], [Slot("/a", "/red")])
    return replace(asset, unit=0.01, notes=("a note",))


@pytest.fixture
def calls(monkeypatch) -> list[str]:
    """The names of the computations that ran."""
    names: list[str] = []

    for name in ("refine_all", "refinement_levels"):
        function = getattr(refinery, name)
        record = lambda *rest, name=name, function=function: (names.append(name), function(*rest))[1]  # noqa: E731
        monkeypatch.setattr(refinery, name, record)
    return names


def same(a: Mesh, b: Mesh) -> bool:
    names = [field.name for field in fields(Mesh) if field.name not in ("uvs", "primvars")]
    maps = [(a.uvs, b.uvs), (a.primvars, b.primvars)]
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in names) and all(
        list(x) == list(y) and all(np.array_equal(x[name], y[name]) for name in x) for x, y in maps
    )


def test_the_geometry_key_an_asset_without_a_digest_is_by_its_arrays(cages) -> None:
    mesh = cages.meshes[0]
    moved = replace(cages, meshes=(replace(mesh, points=mesh.points + np.float32(1.0)),), digest="")
    assert geometry_key(replace(cages, digest=""), [], []) != geometry_key(moved, [], [])


@pytest.mark.parametrize("level", ["auto", 1])
def test_the_next_run_reads_what_was_refined(level, cages, calls) -> None:
    first, notes = Refiner(level, 64).refine(cages, CAMERA)
    assert "refine_all" in calls
    calls.clear()
    second, again = Refiner(level, 64).refine(cages, CAMERA)
    assert calls == []
    assert again == notes
    assert same(first.meshes[0], second.meshes[0])
    for name in ("digest", "center", "radius", "slots", "unit", "notes"):
        assert getattr(first, name) == getattr(second, name)
    assert second.instances[0].path == "/path"


def test_a_mesh_without_subdivision_stays_as_it_is(cages, monkeypatch) -> None:
    monkeypatch.setattr(refinery, "_MAX_CORNERS", (4 + 1) * len(cages.meshes[0].corner_points))
    plain = replace(cages.meshes[0], name="/b", subdivision=None)
    both = make_asset("a", [cages.meshes[0], plain], [Instance(0, np.eye(4)), Instance(1, np.eye(4))], cages.slots)
    refined, _ = Refiner(1, 64).refine(both, CAMERA)
    assert same(refined.meshes[1], plain)
    assert not same(refined.meshes[0], plain)


@pytest.mark.parametrize("other", ["camera", "axis", "width", "cage", "detailed"])
def test_what_differs_is_made_anew(other, cages, calls) -> None:
    Refiner("auto", 64).refine(cages, CAMERA)
    calls.clear()
    if other == "cage":
        mesh = replace(cages.meshes[0], subdivision=Subdivision("bilinear"))
        cages = make_asset("a", [mesh], cages.instances, cages.slots)
    camera = {"camera": replace(CAMERA, distance=9.0), "axis": replace(CAMERA, axis=(2.0, 1.0))}.get(other, CAMERA)
    Refiner("auto", 80 if other == "width" else 64).refine(cages, camera, (0,) if other == "detailed" else ())
    assert "refinement_levels" in calls


@pytest.mark.parametrize("folder", ["refined", "content"])
@pytest.mark.parametrize("harm", ["cut off", "one number"])
def test_a_damaged_file_is_made_again_with_a_note(folder, harm, cages, calls, tmp_path) -> None:
    first, notes = Refiner("auto", 64).refine(cages, CAMERA)
    files = list((tmp_path / folder).iterdir())
    for file in files:
        content = file.read_bytes()
        if harm == "cut off":
            file.write_bytes(content[: len(content) // 2])
        else:
            middle = content.index(b": [") + 3 if b"levels" in content else len(content) // 2
            file.write_bytes(content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :])
    calls.clear()
    again, more = Refiner("auto", 64).refine(cages, CAMERA)
    assert "refine_all" in calls
    assert again.digest == first.digest
    assert same(again.meshes[0], first.meshes[0])
    assert more == notes
    assert set(take_notes()) == {f"{file}: was damaged, and is made again" for file in files}
    calls.clear()
    assert Refiner("auto", 64).refine(cages, CAMERA)[1] == notes
    assert calls == []
    # A file that is missing is not damaged.
    for file in (tmp_path / "content").iterdir():
        file.unlink()
    assert Refiner("auto", 64).refine(cages, CAMERA)[1] == notes
    assert calls == ["refine_all"]
    assert take_notes() == ()


def test_the_outline_of_several_instances_is_found_once(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path))
    monkey = load_asset(builtin="suzanne").meshes[0]
    turned = np.array([[0.0, -1.0, 0.0, 2.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    pair = make_asset("pair", [monkey], [Instance(0, np.eye(4)), Instance(0, turned)], [])
    expected = hull_points(pair.meshes, pair.instances)
    np.testing.assert_array_equal(cached_outline(pair), expected)
    monkeypatch.delattr("lookdev.build.refine.hull_points")
    np.testing.assert_array_equal(cached_outline(pair), expected)
