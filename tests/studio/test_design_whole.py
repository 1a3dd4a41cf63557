"""A whole session in a browser: looks are assigned, compared, saved, opened again, and rendered by the job.

``pytest -m proof tests/studio/test_design_whole.py --log-cli-level=INFO`` takes some minutes.
"""

import logging
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from batches import finish, start
from design_page import ASSIGN, DesignPage
from pxr import Sdf, Usd, UsdGeom
from served import start_server

from lookdev.arrays import Floats
from lookdev.asset.builtin import make_sphere
from lookdev.job import load_job
from lookdev.output.exr import read_frame, read_layer

pytestmark = [pytest.mark.proof, pytest.mark.cycles, pytest.mark.mitsuba]

ROOT = Path(__file__).parents[2]
SIZE = (48, 36)
SAMPLES = 512  # of the viewport
JOB = """output = "out"
asset = { usd = "asset.usda" }
camera = { elevation = 20 }

[[look]]
name = "two_looks"
material = "lower.usda"      # until its parts have looks

[[ibl]]
name = "studio"
builtin = "studio"

[[turntable]]                # the light as it is turned on the page
kind = "lighting"
frames = 1
start = 40

[render]
resolution = [48, 36]
samples = 256
bounces = 0                  # a ball reflects nothing of itself, and has no shadow on itself: what the page shows
"""
log = logging.getLogger(__name__)


@pytest.fixture
def job(tmp_path: Path) -> Path:
    """Return a job of a ball of two parts, and looks beside it."""
    (tmp_path / "job.toml").write_text(JOB)
    shutil.copytree(ROOT / "materials" / "textures", tmp_path / "textures")
    shutil.copy(ROOT / "materials" / "car_paint.usda", tmp_path / "upper.usda")
    shutil.copy(ROOT / "materials" / "brushed_metal.usda", tmp_path / "lower.usda")
    stage = Usd.Stage.CreateNew(str(tmp_path / "asset.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/Ball").GetPrim())
    (mesh,) = make_sphere().meshes
    corners = np.split(np.arange(len(mesh.corner_points)), np.cumsum(mesh.face_sizes)[:-1])
    height = np.array([mesh.points[mesh.corner_points[face], 2].mean() for face in corners])
    for name, taken in (("Upper", height >= 0.0), ("Lower", height < 0.0)):
        faces = [face for face, here in zip(corners, taken, strict=True) if here]
        corner_numbers = np.concatenate(faces)
        part = UsdGeom.Mesh.Define(stage, f"/Ball/{name}")
        part.CreatePointsAttr(mesh.points.astype(np.float32))
        part.CreateFaceVertexCountsAttr([len(face) for face in faces])
        part.CreateFaceVertexIndicesAttr(mesh.corner_points[corner_numbers].astype(np.int32))
        part.CreateSubdivisionSchemeAttr("none")
        part.CreateNormalsAttr(mesh.normals[corner_numbers].astype(np.float32))
        part.SetNormalsInterpolation("faceVarying")
        st = UsdGeom.PrimvarsAPI(part).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "faceVarying")
        st.Set(mesh.uvs["st"][corner_numbers].astype(np.float32))
    stage.Save()
    return tmp_path / "job.toml"


def render_viewport(page: DesignPage, seed: int) -> Floats:
    """Return the picture of some samples, (H, W, 4)."""
    pixels = page.js(
        f"viewport.resize({SIZE[0]}, {SIZE[1]}); viewport.set({{seed: given[0], background: false}});"
        f"return [...await viewport.accumulate({SAMPLES})]",
        seed,
    )
    return np.array(pixels).reshape(SIZE[1], SIZE[0], 4)


def load(browser: Any, url: str) -> DesignPage:
    page = DesignPage(browser, url, timeout=400)
    page.js("delete exact.limit; typed(at('lighting'), 40, 'input')")
    return page


def test_what_is_saved_is_rendered_as_it_was_shown(job: Path, tab: Any) -> None:
    with start_server(str(job), verb="design", cwd=job.parent) as server:
        page = load(tab, server.url)
        before = render_viewport(page, 0)
        page.js(
            ASSIGN
            + "await assign('/Ball/Upper', 'this part', 'upper'); await until(() => partLook().startsWith('CarPaint'));"
            "await assign('/Ball/Lower', 'this part', 'lower'); await until(() => partLook().includes('/Ball/Lower'));"
            "const pick = async (name) => { typed(at('part'), name); await until(() => at('layer-0')); };"
            "const add = async (preset) => { const count = layers().length; at('layer-add').click();"
            " await until(() => at('adding').open && at('adding-presets').childElementCount > 60);"
            " typed(at('adding-search'), preset, 'input'); at('adding-presets').querySelector('button').click();"
            " await until(() => layers().length > count); };"
            "await pick('/Ball/Lower'); const slider = document.querySelector('[data-parameter=metallic] input');"
            "for (const event of ['input', 'change']) typed(slider, 0.25, event);"
            "await until(() => at('undo').title.includes('metallic'));"
            "await pick('/Ball/Upper'); await add('dust');"
            "typed(at('mask-kind'), 'expression'); typed(at('mask-expression'), 'smoothstep(dirt, .2, .6)', 'input');"
            "typed(document.querySelector('.mask input[data-name=dirt]'), 'textures/dirt.png', 'input');"
            "at('mask-apply').click();"
            "await until(() => document.querySelector('.tag')?.textContent === 'expression');"
        )
        _, indirect, rest, _ = page.difference()
        page.js("exact.choose('viewport')")
        log.info("beside the page's exact picture: interreflection %+.3f %%, rest %+.3f %%", 100 * indirect, 100 * rest)
        assert abs(indirect) < 1e-3
        assert abs(rest) < 1e-2
        pictures = [render_viewport(page, seed) for seed in (0, 1)]
        page.js("await saved()")
    with start_server(str(job), verb="design", cwd=job.parent) as server:
        again = render_viewport(load(tab, server.url), 0)
    assert [table.prims for table in load_job(job).look[0].assign] == [("/Ball/Upper",), ("/Ball/Lower",)]
    np.testing.assert_allclose(again, pictures[0], rtol=1e-5, atol=1e-6)
    assert np.abs(again - before)[..., :3].mean() > 0.05 * np.abs(before)[..., :3].mean()
    finish(start(job), 0)
    (frame,) = (job.parent / "out" / "two_looks" / "studio").glob("*.exr")
    beauty, alpha = read_frame(frame)
    error = read_layer(frame, "error")
    assert error is not None
    inside = alpha == 1.0
    picture = np.mean(pictures, axis=0)[..., :3]
    noise = np.abs(pictures[0] - pictures[1])[..., :3] / 2.0
    deviation = np.sqrt(np.square(error) + np.square(noise).mean())[inside]
    difference = (picture - beauty)[inside]
    relative = np.abs(difference).mean() / beauty[inside].mean()
    expected = np.sqrt(2.0 / np.pi) * deviation.mean() / beauty[inside].mean()
    log.info("difference %.2f %% of the mean, of which noise is %.2f %%", 100 * relative, 100 * expected)
    log.info("signed difference %.3f %%", 100 * difference.mean() / beauty[inside].mean())
    # The mean of pure noise over n pixels is within four standard errors.
    assert abs(difference.mean()) < 4.0 * np.sqrt(np.square(deviation).sum()) / deviation.size
    assert relative < 1.5 * expected
