"""Parameters of looks found in pictures of them: those of Cycles come back, and what is wrong is said first."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import batches
import numpy as np
import OpenImageIO as oiio
import pytest
from batches import look_text
from lending import lend_workers

from lookdev.errors import LookdevError
from lookdev.fitting.picture.fit import PictureFitRequest, fit_picture
from lookdev.fitting.picture.search import LossPoint, SearchSettings
from lookdev.material.change import constant_named
from lookdev.material.library.constants import write_changed
from lookdev.material.usd import read_look
from lookdev.run.render import render_job

pytestmark = pytest.mark.mitsuba

MATERIALS = Path(__file__).parents[2] / "materials"
FRAME = "paint/light/element.0002"


@dataclass(frozen=True)
class Case:
    """A scene, its look before the fit, and the values in the picture, which the fit has to find."""

    asset: str
    light: str
    look: str
    truth: dict[str, tuple[float, ...]]
    kind: str = "ibl"


CASES = {
    "disney": Case(
        "shaderball", "city", look_text("Disney", baseColor=(0.4, 0.4, 0.4), metallic=0.6, roughness=0.6),
        {"baseColor": (0.7, 0.35, 0.12), "metallic": (0.3,), "roughness": (0.35,)},
    ),
    "pixar": Case(
        "suzanne", "three_point", look_text("Pixar", surfaceColor=(0.5, 0.5, 0.5), metallic=0.2, roughness=0.3),
        {"surfaceColor": (0.3, 0.5, 0.65), "metallic": (0.7,), "roughness": (0.45,)}, "rig",
    ),
    "ward": Case(
        "sphere", "studio", look_text("Ward", diffuse=(0.2, 0.2, 0.2), alphaX=0.3, alphaY=0.3),
        {"diffuse": (0.45, 0.2, 0.3), "alphaX": (0.12,), "alphaY": (0.22,)},
    ),
    "robot_paint": Case(
        "shaderball", "forest", "robot_paint",
        {"Paint.surfaceColor": (0.1, 0.35, 0.5), "Paint.roughness": (0.5,), "Metal.roughness": (0.4,)},
    ),
    "coat": Case(
        "suzanne", "courtyard", look_text("Disney", baseColor=(0.3, 0.3, 0.3), roughness=0.8, clearcoat=0.3, sheen=0.2),
        {"baseColor": (0.55, 0.08, 0.06), "roughness": (0.5,), "clearcoat": (0.85,)},
    ),
    "pixar_plastic": Case(
        "suzanne", "interior", look_text("Pixar", surfaceColor=(0.6, 0.6, 0.6), roughness=0.6),
        {"surfaceColor": (0.25, 0.45, 0.2), "roughness": (0.35,), "specularScale": (0.6,)},
    ),
    "car_paint": Case(
        "shaderball", "three_point", "car_paint",
        {"Base.baseColor": (0.3, 0.03, 0.05), "Base.roughness": (0.3,), "Flakes.roughness": (0.35,)}, "rig",
    ),
    "ashikhmin-shirley": Case(
        "shaderball", "sunset", look_text("AshikhminShirley", diffuse=(0.2, 0.2, 0.2), exponentU=100.0, exponentV=60.0),
        {"diffuse": (0.5, 0.3, 0.1), "specular": (0.1, 0.2, 0.3), "exponentU": (20.0,)},
    ),
}  # fmt: skip


def write_job(folder: Path, case: Case, size: int, samples: int) -> Path:
    """Write a job of a case, with an empty look."""
    folder.mkdir(exist_ok=True)
    return batches.write_job(
        folder,
        asset=f'{{ builtin = "{case.asset}" }}',
        look='[{ name = "paint", material = "paint.usda" }]',
        turntable='[{ kind = "element", frames = 2, start = 15.0 }]',
        camera="{ elevation = 15.0 }",
        render=f"{{ resolution = [{size}, {size}], samples = {samples}, bounces = 2 }}",
        **{"ibl": "", case.kind: f'[{{ name = "light", builtin = "{case.light}", exposure = 0.3, rotation = 20.0 }}]'},
    )


def scene(folder: Path, case: Case, size: int, samples: int) -> tuple[Path, Path]:
    """Write the job, and render its second frame with the true values by Cycles; return the job and the picture."""
    job, true = (write_job(folder / name, case, size, samples) for name in ("before", "truth"))
    before = job.with_name("paint.usda")
    if case.look in ("robot_paint", "car_paint"):
        write_changed(MATERIALS / f"{case.look}.usda", before, [])
    else:
        before.write_text(case.look)
    look = read_look(before)
    changed = [replace(constant_named(look, name), value=value) for name, value in case.truth.items()]
    write_changed(before, true.with_name("paint.usda"), changed)
    assert render_job(true, only=[FRAME]).exit_code == 0
    return job, folder / "truth" / "out" / f"{FRAME}.exr"


@pytest.fixture
def _warm(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    lend_workers(request, monkeypatch)


@pytest.mark.proof
@pytest.mark.cycles
@pytest.mark.usefixtures("_warm")
@pytest.mark.parametrize("name", CASES)
def test_parameters_of_pictures_by_cycles_come_back(name: str, llvm: str, tmp_path: Path) -> None:
    case = CASES[name]
    job, picture = scene(tmp_path, case, 128, 64)
    look, page = tmp_path / "found.usda", tmp_path / "page.html"
    report = fit_picture(PictureFitRequest(picture, job, tuple(case.truth), FRAME, look, page))
    assert not report.result.undetermined
    again = read_look(look)
    for (parameter, value), true in zip(report.result.values.items(), case.truth.values(), strict=True):
        assert value == pytest.approx(true, rel=0.02), report.text()
        assert constant_named(again, parameter).value == pytest.approx(value, rel=1e-6)


TINY = Case("sphere", "city", look_text("Disney", roughness=0.6, metallic=1.0), {"roughness": (0.35,)})
LITTLE = SearchSettings(
    start_count=2, followed_count=1, start_samples=4, samples=8, final_samples=16, derivative_samples=4, rounds=2
)


@pytest.mark.cycles
@pytest.mark.usefixtures("_warm")
def test_a_parameter_comes_back_within_its_error(llvm: str, tmp_path: Path) -> None:
    job, picture = scene(tmp_path, TINY, 32, 16)
    parameters = "clearcoatGloss", "roughness"  # no light comes from the coat, whose weight is 0
    wish = PictureFitRequest(
        picture, job, parameters, FRAME, tmp_path / "found.usda", tmp_path / "page.html", settings=LITTLE
    )
    report = fit_picture(wish)
    assert report.result.without_effect == ("Base.clearcoatGloss",)
    (value,), (error,) = report.result.values["Base.roughness"], report.result.errors["Base.roughness"]
    assert error < 0.02
    assert abs(value - 0.35) < 5.0 * error
    assert " ± " in report.text()
    (layer,) = read_look(tmp_path / "found.usda").layers
    assert layer.inputs["roughness"] == pytest.approx(value)
    assert layer.inputs["metallic"] == 1.0
    text = (tmp_path / "page.html").read_text()
    assert text.count("data:image/png;base64,") == 5
    assert "<script" not in text
    assert "://" not in text
    plain = json.loads(json.dumps(report.data()))
    assert plain["parameters"]["Base.roughness"]["after"] == value
    assert plain["frame"] == FRAME

    # A second run writes over nothing; an interrupted one keeps the best so far.
    with pytest.raises(LookdevError, match="exists already"):
        fit_picture(wish)

    def interrupt(point: LossPoint) -> None:
        if point.stage == "follow" and point.loss < 0.5 * report.result.before:
            raise KeyboardInterrupt

    stopped = fit_picture(replace(wish, parameters=("roughness",), force=True), interrupt)
    assert stopped.result.interrupted
    assert stopped.result.after < stopped.result.before
    (layer,) = read_look(tmp_path / "found.usda").layers
    assert layer.inputs["roughness"] == pytest.approx(stopped.result.values["Base.roughness"][0])
    assert "interrupted" in (tmp_path / "page.html").read_text()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"parameters": ("rougness",)}, "did you mean 'roughness'"),
        ({"parameters": ("roughness", "Base.roughness")}, "named twice"),
        ({"parameters": ("roughness=0.7..0.9",)}, "the look has 0.6"),
        ({"parameters": ()}, "no parameter is to be found"),
        ({"frame": "paint/light/element.0003"}, "has frames 1 to 2, not 3"),
        ({"frame": "gold"}, "has no look 'gold'"),
        ({"frame": "out/paint/light/element.0001"}, "'out/paint/light/element.0001' is not the name of a frame"),
        ({"picture": "small.exr"}, r"is 16 x 8 pixels large, the job renders 32 x 32: .* \[16, 8\] would be right"),
        ({"picture": "shown.png"}, "is png, whose values are encoded for a display"),
        ({"picture": "none.exr"}, "no such image file"),
        ({"mask": "small.exr"}, "the picture's 32 x 32 would be right"),
        ({"look": Path("nowhere/found.usda")}, "its folder does not exist"),
        ({"look": Path("found.txt")}, "is not a file to write a look in"),
    ],
)
def test_what_is_wrong_is_said_before_rendering(
    change: dict[str, Any], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("lookdev.fitting.picture.live_frame.Worker", lambda *args: pytest.fail("a worker is started"))
    write_job(tmp_path, TINY, 32, 16)
    Path("paint.usda").write_text(TINY.look)
    for name, size in (("photo.exr", (32, 32)), ("small.exr", (8, 16)), ("shown.png", (32, 32))):
        assert oiio.ImageBuf(np.full((*size, 3), 0.5, np.float32)).write(name)
    arguments = {"picture": "photo.exr", "parameters": ("roughness",), "look": Path("found.usda"), **change}
    arguments = {name: Path(value) if name in ("picture", "mask") else value for name, value in arguments.items()}
    with pytest.raises(LookdevError, match=words):
        fit_picture(PictureFitRequest(job=Path("job.toml"), **arguments))
    assert not Path("found.usda").exists()
