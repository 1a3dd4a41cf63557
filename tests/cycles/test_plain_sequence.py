"""The plain script of the benchmark; that it shows what the batch runner does is in test_bench_real."""

import json
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from lookdev.asset import make_asset, save_asset
from lookdev.asset.builtin import make_sphere
from lookdev.bench.sequence import PLAIN_COMMAND

# Blender is started, but no frame is asked for.
pytestmark = pytest.mark.cycles


@pytest.mark.parametrize("names", [("map1", "map2"), ()])
def test_it_builds_meshes_with_and_without_uvs(names: tuple[str, ...], tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    sphere = make_sphere(8, 4)
    meshes = [replace(mesh, uvs=dict.fromkeys(names, mesh.uvs["st"])) for mesh in sphere.meshes]
    asset = make_asset("sphere", meshes, sphere.instances, sphere.slots)
    camera = {"fov": 30.0, "distance": 5.0, "elevation": 10.0, "target": [0.0, 0.0, 0.0]}
    request = {"asset": str(save_asset(asset)), "principled": {"Roughness": 0.5}, "camera": camera, "frames": []}
    request |= {"resolution": [8, 8], "samples": 2, "bounces": 0, "seed": 0}
    file = tmp_path / "request.json"
    file.write_text(json.dumps(request))
    done = subprocess.run((*PLAIN_COMMAND, str(file)), capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
