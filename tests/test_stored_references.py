"""References as data: what their digest is of, what a missing or stale file says, and pictures of a failure."""

import contextlib
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
import stored_references
from agreement import scene_pixels, shape_pixels
from frames import POSE, orbit_camera
from light_rigs import textured
from looks import LOOKS
from painted import painted
from stored_references import RENEW, StoredReference, digest_of

from lookdev.asset import load_asset
from lookdev.light import SphereLight
from lookdev.material import Look
from lookdev.scene import Scene

EXAMPLE = """
import numpy as np
from failed_pictures import comparison

def ramp(count):
    return {"value": np.arange(count, dtype=np.float64) / FACTOR}

def test_ramp(stored_reference):
    frame, values = np.ones((4, 4, 3)), stored_reference("a ramp", ramp, count=COUNT)["value"]
    with comparison(frame, np.tile(values[:3], (2, 1)), np.array([[0, 1], [3, 2]])):
        assert frame.sum() < LIMIT
"""


def test_a_reference_is_written_compared_and_found_stale(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stored_references, "FOLDER", tmp_path / "stored")
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = proof")
    runs = iter(range(10))

    def run(*options: str, factor: float = 2.0, limit: float = 99.0, count: int = 3) -> str:
        test = tmp_path / f"test_ramp_{next(runs)}.py"
        test.write_text(f"FACTOR, LIMIT, COUNT = {factor}, {limit}, {count}\n{EXAMPLE}")
        # The last one collects garbage several times in each run, of all that this process has loaded.
        unwanted = ("cacheprovider", "xdist", "faulthandler", "unraisableexception")
        without = [word for name in unwanted for word in ("-p", f"no:{name}")]
        plugins = [word for name in ("stored_references", "failed_pictures") for word in ("-p", name)]
        place = [f"--rootdir={tmp_path}", f"--basetemp={tmp_path / 'kept'}"]
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            pytest.main(["-q", *plugins, *without, *place, *options, str(test)])
        return printed.getvalue()

    assert "there is no reference a-ramp-" in run()
    assert "1 passed" in run(RENEW)
    (file,) = (tmp_path / "stored").iterdir()
    written = file.stat()
    assert "1 passed" in run()
    assert "1 passed" in run(RENEW)
    assert file.stat().st_mtime_ns == written.st_mtime_ns
    # Another model: only what computes the reference sees it.
    assert "1 passed" in run(factor=3.0)
    assert "1 passed" in run("-m", "proof")
    assert f"value of {file.name} is stale" in run("-m", "proof", factor=3.0)
    failed = run(limit=1.0)
    assert f"tests/references/{file.name}" in failed
    assert RENEW in failed
    pictures = {picture.name: picture for picture in (tmp_path / "kept").rglob("*.*")}
    shown, expected, difference = (
        oiio.ImageBuf(str(pictures[f"{name}.exr"])).get_pixels(oiio.FLOAT)
        for name in ("shown", "expected", "difference")
    )
    np.testing.assert_array_equal(expected[1, 0], [0.0, 0.5, 1.0])
    np.testing.assert_array_equal(shown - expected, difference)
    assert shown.sum() == 6.0
    assert "compared.png" in pictures
    assert f"with other inputs: {file.name}" in run(count=4)


def scene_of(folder: Path, width: float = 2.0) -> Scene:
    folder.mkdir(exist_ok=True)
    asset, look = load_asset(builtin="plane"), Look("look", painted(folder))
    return Scene.of_look(asset, look, replace(textured(), width=width), (8, 8), orbit_camera(asset.center, 1.0))


def test_a_digest_is_of_what_defines_a_case(tmp_path: Path) -> None:
    scene = scene_of(tmp_path / "here")
    digest = digest_of("scene", {"scene": scene, "count": 3})
    # Neither of the folder, nor of last digits.
    same = scene_of(tmp_path / "there", width=2.0 + 1e-12)
    assert digest_of("scene", {"scene": same, "count": 3}) == digest
    spheres = replace(scene, lights=(SphereLight(radius=0.2),)), replace(scene, lights=(SphereLight(radius=0.3),))
    (tmp_path / "there" / "color.png").write_bytes((tmp_path / "there" / "grain.png").read_bytes())
    wider, nearer = scene_of(tmp_path / "here", width=2.001), replace(scene, camera=orbit_camera((0.0,) * 3, 2.0))
    others = [*spheres, same, wider, nearer]
    digests = [digest, digest_of("scene", {"scene": scene, "count": 4}), digest_of("shape", {"scene": scene})]
    digests += [digest_of("scene", {"scene": other, "count": 3}) for other in others]
    assert len(set(digests)) == len(digests)
    with pytest.raises(TypeError, match="function is no input of a stored reference"):
        digest_of("scene", {"alter": scene_of})


def test_some_references_are_what_code_computes(stored_reference: StoredReference, tmp_path: Path, light_of) -> None:
    options = {"pose": POSE, "count": 6, "samples": 64, "bounces": 1}
    stored_reference("cheap scene", scene_pixels, scene=scene_of(tmp_path / "s"), recompute=True, **options)
    case = {"shape": "sphere", "layers": LOOKS["lacquered"], "light": light_of("white"), "side": 16, "least": 0.5}
    stored_reference("cheap shape", shape_pixels, recompute=True, **case, **options)
