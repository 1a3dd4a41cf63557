from dataclasses import replace

import numpy as np
import pytest
from asset_arrays import check_asset

from lookdev.asset import Instance, Slot, read_asset, save_asset
from lookdev.asset.builtin import make_sphere
from lookdev.asset.store import asset_digest, make_asset
from lookdev.asset.tangents import tangents_of
from lookdev.cache import cache_dir
from lookdev.errors import AssetError

FLAGS = {"convex": True, "sheet": True, "revolved": True}


@pytest.fixture
def asset():
    sphere = make_sphere(8, 4)
    mesh = sphere.meshes[0]
    mesh = replace(
        mesh,
        uvs={"st": mesh.uvs["st"], "second:set": mesh.uvs["st"] * 2},
        primvars={"wear/../x": mesh.uvs["st"][:, 0].copy(), "displayColor": mesh.normals.copy()},
    )
    return make_asset("thing", [mesh], sphere.instances, [Slot("/thing", "/Looks/Paint")], **FLAGS)


def test_what_is_saved_is_read_back(asset):
    path = save_asset(asset)
    assert path.parent == cache_dir("content")
    again = read_asset(path)
    check_asset(again)
    assert asset_digest(again) == again.digest == asset.digest
    for name in ("name", "slots", "center", "radius", *FLAGS):
        assert getattr(again, name) == getattr(asset, name)
    assert list(again.meshes[0].uvs) == ["st", "second:set"]
    assert list(again.meshes[0].primvars) == ["wear/../x", "displayColor"]
    np.testing.assert_array_equal(again.meshes[0].primvars["displayColor"], asset.meshes[0].normals)
    np.testing.assert_array_equal(again.instances[0].matrix, asset.instances[0].matrix)


def test_small_assets_without_primvars_are_read_back():
    for segments in range(3, 20):
        ball = make_sphere(segments, 4)
        np.testing.assert_array_equal(read_asset(save_asset(ball)).meshes[0].uvs["st"], ball.meshes[0].uvs["st"])


def test_a_saved_asset_is_not_written_again(asset):
    before = save_asset(asset).stat()
    after = save_asset(asset).stat()
    assert (before.st_ino, before.st_mtime_ns) == (after.st_ino, after.st_mtime_ns)
    assert [path.suffix for path in cache_dir("content").iterdir()] == [".asset"]


def test_tangents_are_saved_where_they_are_asked_for(asset):
    bare = replace(asset.meshes[0], tangents=None)
    asset = make_asset("pair", [bare, bare], [Instance(0, np.eye(4)), Instance(1, np.eye(4))], asset.slots)
    plain, directed = save_asset(asset), save_asset(asset, [1])
    assert plain != directed
    assert [mesh.tangents for mesh in read_asset(plain).meshes] == [None, None]
    first, second = read_asset(directed).meshes
    assert first.tangents is None
    np.testing.assert_array_equal(second.tangents, tangents_of([bare])[0])
    np.testing.assert_array_equal(second.normals, bare.normals)
    assert read_asset(directed).digest == asset.digest
    # Those that a mesh has are saved anyway.
    assert save_asset(read_asset(directed), [1]) == save_asset(read_asset(directed))


def test_every_part_is_in_the_digest(asset):
    (mesh,), (instance,) = asset.meshes, asset.instances
    points, (first, second) = mesh.points.copy(), mesh.uvs.values()
    points[3, 1] = np.nextafter(points[3, 1], np.float32(9.0))
    changes = [
        {"meshes": (replace(mesh, points=points),)},
        {"meshes": (replace(mesh, uvs={"map1": first, "second:set": second}),)},
        {"instances": (replace(instance, matrix=instance.matrix * 2),)},
        *({flag: False} for flag in FLAGS),
        {"name": "other"},
        {"slots": (Slot("/thing"),)},
    ]
    assert asset_digest(asset) == asset.digest
    digests = [asset.digest, *(asset_digest(replace(asset, **change)) for change in changes)]
    assert len(set(digests)) == len(digests)


@pytest.mark.parametrize("damage", ["missing", "empty", "cut", "foreign"])
def test_a_damaged_file_is_named(asset, tmp_path, damage):
    path = tmp_path / "damaged.asset"
    whole = save_asset(asset).read_bytes()
    if damage == "foreign":
        np.savez(path, something=np.zeros(3))
    elif damage != "missing":
        path.write_bytes({"empty": b"", "cut": whole[: len(whole) // 2]}[damage])
    with pytest.raises(AssetError, match=r"damaged\.asset: is not an asset"):
        read_asset(path)


def test_an_asset_without_surface_or_extent_is_an_error(asset):
    with pytest.raises(AssetError, match="thing: has no surface to render"):
        make_asset("thing", asset.meshes, [], asset.slots)
    mesh = replace(asset.meshes[0], points=asset.meshes[0].points * 0 + 1)
    with pytest.raises(AssetError, match="all points lie in one place"):
        make_asset("thing", [mesh], asset.instances, asset.slots)
