"""Scenes for Mitsuba's users agree with the backend; what Mitsuba's plug-ins lack is refused by name."""

from pathlib import Path
from typing import Any

import batches
import numpy as np
import pytest
from mitsuba_scenes import RenderSeeds

from lookdev.errors import LookdevError
from lookdev.export.mitsuba import export_mitsuba
from lookdev.plan.prepare import read_setups

pytestmark = pytest.mark.mitsuba

MATERIALS = Path(__file__).parents[2] / "materials"
CITY = 'builtin = "city"'
LAMBERT = MATERIALS / "classic" / "lambert.usda"
FITTED = 'usd = "rig.usda"'


def prim(kind: str, position: tuple[float, ...], turn: tuple[float, ...], *lines: str) -> str:
    order = 'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]'
    moves = f"double3 xformOp:translate = {position}", f"float3 xformOp:rotateXYZ = {turn}", order
    return "\n".join((f"def {kind}", "{", *lines, *moves, "}\n"))


def lamp(kind: str, position: tuple[float, ...], turn: tuple[float, ...], more: str = "", **inputs: float) -> str:
    return prim(kind, position, turn, *(f"float inputs:{name} = {value}" for name, value in inputs.items()), more)


def rig(bulb_input: str) -> str:
    """Return a rig with a camera, whose bulb has a further input."""
    prims = (
        lamp('RectLight "Key"', (1, 2, 4), (-25, 0, 0), "color3f inputs:color = (1, 0.7, 0.4)", intensity=8, width=2),
        lamp('DiskLight "Rim"', (-4, 0, -1), (0, -105, 0), intensity=20, radius=0.7),
        lamp('SphereLight "Bulb"', (0, 4, 1), (0, 0, 0), bulb_input, intensity=30, radius=0.3),
        prim('Camera "Lens"', (0, 0, 6), (0, 0, 0), "float fStop = 2.8", "float focusDistance = 6"),
    )
    return f'#usda 1.0\n( metersPerUnit = 1\n  upAxis = "Y" )\ndef Xform "Rig"\n{{\n{"".join(prims)}}}\n'


def write_job(
    folder: Path, light: str = "ibl", source: str = CITY, bulb_input: str = "", material: str = "car_paint", **keys: str
) -> Path:
    (folder / "rig.usda").write_text(rig(bulb_input))
    defaults = {
        "look": f'[{{ name = "paint", material = "{MATERIALS / material}.usda" }}]',
        "turntable": '[{ kind = "lighting", frames = 4, start = 40.0 }]',
        "camera": "{ azimuth = 30.0 }",
        "render": "{ resolution = [40, 30], samples = 128, bounces = 2 }",
        "ibl": "",
        light: f'[{{ name = "light", exposure = 0.5, rotation = 20.0, {source} }}]',
    }
    return batches.write_job(folder, **defaults | keys)


@pytest.mark.parametrize(
    ("light", "source", "material"), [("ibl", CITY, "car_paint"), ("rig", FITTED, "classic/lambert")]
)
def test_a_scene_shows_what_the_backend_shows(
    light: str, source: str, material: str, drjit: Any, render_seeds: RenderSeeds, tmp_path: Path
) -> None:
    import mitsuba as mi

    import lookdev.mitsuba  # noqa: F401

    mi.set_variant("llvm_ad_rgb")
    job = write_job(tmp_path, light, source, material=material)
    export = export_mitsuba(job, tmp_path / "scenes")
    assert [file.name for file in export.files] == ["paint.light.xml"]
    scene = mi.load_file(str(export.files[0]))
    rendered = np.stack([np.array(mi.render(scene, spp=132, seed=seed)) for seed in range(8)]).astype(float)

    setups = read_setups(job, backend="mitsuba")
    [setup] = setups.setups
    pose = setup.poses(setups.job.turntable[0], setups.job.camera.azimuth)[0]
    frames = render_seeds(setup.task, pose, 4)
    # Workers leave the exposure to the output.
    expected = 2.0**setup.exposure * np.stack([half for frame in frames for half in (frame.a, frame.b)]).astype(float)

    # Both films have box filters, so that a pixel has the same mean in both.
    inside = np.min([frame.alpha for frame in frames], axis=0) == 1.0
    assert inside.sum() > 100
    pixels = [picture[:, inside, :3].mean(axis=-1) for picture in (rendered, expected)]

    def compared(values: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Return the difference of the means of two sets of eight values, and its standard error."""
        errors = (samples.std(axis=0, ddof=1) / np.sqrt(len(samples)) for samples in values)
        return values[0].mean(axis=0) - values[1].mean(axis=0), np.hypot(*errors)

    difference, noise = compared([picture.mean(axis=1) for picture in pixels])
    assert abs(difference) < 4.0 * noise < 0.02 * pixels[1].mean()
    # Student's t of 14 degrees of freedom, of some hundreds of pixels.
    difference, noise = compared(pixels)
    z = np.abs(difference / noise)
    assert np.quantile(z, 0.95) < 2.6
    assert z.max() < 8.0


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"light": "rig", "source": FITTED, "bulb_input": "float inputs:diffuse = 0.5"}, "Bulb.*multiplier"),
        ({"camera": '{ usd = "/Rig/Lens", file = "rig.usda" }'}, "depth of field"),
        ({"material": "none"}, "none.usda"),
        ({"material": "classic/mirror"}, "'paint': scatters along single directions"),
        ({"look": f'[{{ name = "paint", assign = [{{ prims = ["/*"], material = "{LAMBERT}" }}] }}]'}, "on parts"),
    ],
)
def test_what_mitsuba_lacks_is_refused_by_name(parts: dict[str, str], words: str, tmp_path: Path) -> None:
    with pytest.raises(LookdevError, match=words):
        export_mitsuba(write_job(tmp_path, **parts), tmp_path / "scenes")
    assert not list(tmp_path.rglob("*.xml"))
