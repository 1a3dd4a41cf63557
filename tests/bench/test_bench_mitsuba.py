"""What Mitsuba gets of a scene; that it renders the same scene is in test_bench_real."""

from dataclasses import replace

import numpy as np
import pytest

from lookdev.asset import Asset, load_asset
from lookdev.bench import mitsuba_worker
from lookdev.bench.mitsuba_worker import check_mitsuba, corner_meshes, principled_bsdf
from lookdev.bench.subjects import LOOKS, make_boulder
from lookdev.codegen.principled import generate_principled
from lookdev.errors import RenderError
from lookdev.rendering.backends import BACKENDS

unlike_principled = BACKENDS["mitsuba-principled"].look_gap


@pytest.mark.parametrize("look", [name for name, entry in LOOKS.items() if not unlike_principled(entry.make())])
def test_every_look_has_something_like_it(look: str) -> None:
    surface = LOOKS[look].make()
    inputs = surface.layers[0].inputs
    bsdf = principled_bsdf(generate_principled(surface).inputs)
    assert bsdf["type"] == "principled"
    assert bsdf["roughness"] == inputs["roughness"]
    assert bsdf["base_color"]["value"] == list(inputs["baseColor"])
    assert bsdf.get("clearcoat", 0.0) == inputs.get("clearcoat", 0.0)
    if "clearcoat" in inputs:
        assert bsdf["clearcoat_gloss"] == pytest.approx(inputs["clearcoatGloss"])


def test_a_socket_without_a_counterpart_is_refused() -> None:
    with pytest.raises(RenderError, match=r"'Sheen Weight' = 1\.0"):
        principled_bsdf({"Sheen Weight": 1.0})


@pytest.mark.parametrize("asset", [make_boulder(2000), load_asset(builtin="suzanne")], ids=lambda asset: asset.name)
def test_triangles_cover_the_polygons(asset: Asset) -> None:
    for (positions, normals, uvs), instance in zip(corner_meshes(asset), asset.instances, strict=True):
        sizes = asset.meshes[instance.mesh].face_sizes
        assert len(positions) == len(normals) == len(uvs) == 3 * int((sizes - 2).sum())
        a, b, c = positions.reshape(-1, 3, 3).swapaxes(0, 1).astype(np.float64)
        facing = np.cross(b - a, c - a)
        # Wound like the polygons: the shading normals are on that side, but at creases of the monkey's eyes and mouth.
        agree = (facing * normals.reshape(-1, 3, 3).mean(axis=1)).sum(axis=1) > 0
        assert agree.mean() > 0.99
        assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0, abs=1e-6)


def test_a_mesh_without_uvs_has_those_of_the_origin() -> None:
    asset = make_boulder(200)
    bare = replace(asset, meshes=tuple(replace(mesh, uvs={}) for mesh in asset.meshes))
    for (positions, normals, uvs), whole in zip(corner_meshes(bare), corner_meshes(asset), strict=True):
        np.testing.assert_array_equal(positions, whole[0])
        np.testing.assert_array_equal(normals, whole[1])
        assert uvs.shape == (len(positions), 2)
        assert not uvs.any()


def test_an_llvm_that_does_not_fit_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mitsuba_worker, "find_llvm", lambda: "/lib/libLLVM-99.so")
    monkeypatch.setattr(mitsuba_worker.sys, "executable", "false")
    with pytest.raises(RenderError, match=r"not render with /lib/libLLVM-99\.so; set DRJIT_LIBLLVM_PATH"):
        check_mitsuba()
