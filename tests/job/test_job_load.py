"""Reading job files: values, defaults, and the config, displays and views of pictures."""

from pathlib import Path

import PyOpenColorIO as ocio
import pytest
from minimal_job import MINIMAL, faults, parse, touch_files

from lookdev.errors import JobError
from lookdev.job import load_job, parse_job
from lookdev.job.outputs import JobOutputs
from lookdev.job.schema import JobRender
from lookdev.output.color import SHIPPED, DisplayView
from lookdev.rendering.backends import Backend, job_backends
from lookdev.scene import Sampling

ACES = "ocio://studio-config-v2.2.0_aces-v1.3_ocio-v2.4"
USD = 'usd = "ball.usdc"'


def test_a_minimal_job_is_read(tmp_path: Path) -> None:
    """Defaults are those of the tables of docs/jobs.md, which test_docs.py compares."""
    touch_files(tmp_path)
    (tmp_path / "job.toml").write_text(MINIMAL)
    job = load_job(tmp_path / "job.toml")
    assert (job.file, job.output) == (tmp_path / "job.toml", tmp_path / "out")
    assert (job.look[0].material, job.look[0].parts, job.look[0].layer) == (tmp_path / "paint.usda", None, None)
    assert (job.asset.prim, job.asset.time, job.render.error, job.outputs.overview_columns) == (None,) * 4
    assert (job.render.samples, job.render.brdf_samples, job.render.ibl_samples) == (64, None, None)
    assert job.camera.horizontal_fov == pytest.approx(39.5977527)  # 2 atan(18 / 50)


def test_every_key_is_read(tmp_path: Path) -> None:
    touch_files(tmp_path)
    (tmp_path / "jobs").mkdir()
    text = """
    output = "/somewhere/else"
    camera = { fov = 30, elevation = -5.5, azimuth = 90, margin = 1.25 }
    outputs = { png = false, sheet = false, overview = true, overview_columns = 11, view = "Raw" }
    ibl = [{ name = "sky", file = "../sky.exr", exposure = -1, rotation = 45 }]
    turntable = [{ name = "half", kind = "lighting", frames = 12, start = 90, degrees = -180 }]
    render = { resolution = [640, 360], error = 1e-3, ibl_samples = 0, background = [0.18, 0.18, 1] }
    [asset]
    usd = "../ball.usdc"
    prim = "/World/Ball"
    time = 12
    variants = { modelingVariant = "hero" }
    purposes = ["render", "proxy"]
    subdivision = 3
    missing = "warn"
    [[look]]
    name = "dirty-paint_2.0"
    material = "../paint.usda"
    prim = "/Paint"
    variants = { wear = "dirty" }
    parts = ["*/body"]
    layer = "../paint.usda"
    [[look.assign]]
    prims = ["/World/Tire*", "/World.collection:trim"]
    material = "../paint.usda"
    prim = "/Rubber"
    variants = { wear = "new" }
    """
    job = parse_job(text, tmp_path / "jobs" / "job.toml")
    assert job.output == Path("/somewhere/else")
    assert (job.asset.usd, job.asset.prim) == (tmp_path / "ball.usdc", "/World/Ball")
    assert (job.asset.time, job.asset.variants, job.asset.missing) == (12.0, {"modelingVariant": "hero"}, "warn")
    assert (job.asset.purposes, job.asset.subdivision) == (("render", "proxy"), 3)
    assert job.look[0].layer == tmp_path / "paint.usda"
    (assign,) = job.look[0].assign
    assert assign.prims == ("/World/Tire*", "/World.collection:trim")
    assert (assign.material, assign.prim, assign.variants) == (tmp_path / "paint.usda", "/Rubber", {"wear": "new"})
    assert (job.look[0].variants, job.look[0].parts) == ({"wear": "dirty"}, ("*/body",))
    assert (job.ibl[0].file, job.ibl[0].exposure) == (tmp_path / "sky.exr", -1.0)
    assert (job.turntable[0].name, job.turntable[0].degrees) == ("half", -180.0)
    assert job.camera.horizontal_fov == 30.0
    assert job.render.samples == 4096  # with a target error, samples is the cap
    assert job.render.background == (0.18, 0.18, 1.0)
    assert not job.outputs.png
    assert job.outputs.overview_columns == 11


def test_sampling_is_that_of_the_job(tmp_path: Path) -> None:
    expected = Sampling(4096, 0.01, brdf_samples=3, ibl_samples=5, bounces=7, seed=11)
    numbers = "error = 0.01\nbrdf_samples = 3\nibl_samples = 5\nbounces = 7\nseed = 11\n"
    assert parse(f"{MINIMAL}[render]\n{numbers}", tmp_path).render.sampling == expected
    assert parse(MINIMAL, tmp_path).render.sampling == Sampling()


@pytest.mark.parametrize("backend", job_backends().values(), ids=lambda backend: backend.name)
def test_a_backend_runs_on_its_devices(backend: Backend, tmp_path: Path) -> None:
    for device in backend.devices:
        render = parse(f'{MINIMAL}[render]\nbackend = "{backend.name}"\ndevice = "{device}"\n', tmp_path).render
        assert (render.backend, render.device) == (backend.name, device)


def test_passes_are_in_one_order_and_the_space_is_named(tmp_path: Path) -> None:
    def render(lines: str) -> JobRender:
        return parse(f"{MINIMAL}[render]\n{lines}\n", tmp_path).render

    assert render('passes = ["uv", "depth", "uv"]').passes == ("depth", "uv")
    # What every frame has may be named, and changes nothing.
    assert render('passes = ["lights", "beauty", "error", "alpha"]').passes == ("lights",)
    assert render('passes = ["error"]') == render("")
    assert render("").space == "rec709"
    assert render('space = "acescg"\nbackend = "mitsuba"').space == "acescg"


def test_a_look_without_material_has_what_the_asset_binds(tmp_path: Path) -> None:
    text = MINIMAL.replace('builtin = "sphere"', USD).replace('material = "paint.usda"\n', "")
    assert parse(text, tmp_path).look[0].material is None
    reported = faults(text.replace('"paint"\n', '"paint"\nprim = "/Paint"\nparts = ["/Ball"]\n'), tmp_path)
    fault = ("has no meaning without 'material'", "a look without 'material' has what the asset binds")
    assert reported == {f"look[0].{key}": fault for key in ("prim", "parts")}


def test_a_built_in_asset_can_have_assigned_materials_and_a_turntable_has_the_name_of_its_kind(tmp_path: Path) -> None:
    look = parse(MINIMAL.replace("material", '[[look.assign]]\nprims = ["/Ball"]\nmaterial'), tmp_path).look[0]
    assert (look.material, look.assign[0].prims) == (None, ("/Ball",))
    job = parse(MINIMAL + '[[turntable]]\nkind = "element"\nframes = 8\nname = "fine"\n', tmp_path)
    assert [turntable.name for turntable in job.turntable] == ["element", "fine"]


def test_a_missing_job_file_is_a_job_error(tmp_path: Path) -> None:
    with pytest.raises(JobError, match=r"job\.toml: cannot be read: No such file"):
        load_job(tmp_path / "job.toml")


def parse_outputs(folder: Path, lines: str = "") -> JobOutputs:
    return parse(f"{MINIMAL}[outputs]\n{lines}", folder).outputs


def test_by_default_pictures_are_in_the_shipped_view(tmp_path: Path) -> None:
    assert (
        parse_outputs(tmp_path).display_view("png")
        == DisplayView()
        == DisplayView("lookdev", "sRGB - Display", SHIPPED)
    )


def test_the_config_of_the_environment_is_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OCIO", ACES)
    studio = parse_outputs(tmp_path).display_view()
    assert (studio.config, studio.view) == (ACES, "ACES 1.0 - SDR Video")
    assert parse_outputs(tmp_path, 'ocio = "lookdev"').display_view() == DisplayView()
    config = ocio.Config.CreateFromBuiltinConfig(ACES.removeprefix("ocio://"))
    (tmp_path / "studio.ocio").write_text(config.serialize())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("OCIO", "studio.ocio")
    assert parse_outputs(tmp_path).display_view().config == str(tmp_path / "studio.ocio")
    monkeypatch.delenv("OCIO")
    monkeypatch.chdir("/")
    assert parse_outputs(tmp_path, 'ocio = "studio.ocio"').display_view().config == str(tmp_path / "studio.ocio")


def test_each_output_can_have_another_display_and_view(tmp_path: Path) -> None:
    video = "Rec.1886 Rec.709 - Display"
    lines = f'view = "Raw"\ndisplays = {{ overview = "{video}" }}\nviews = {{ png = "Un-tone-mapped" }}'
    outputs = parse_outputs(tmp_path, lines)
    views = {
        name: (outputs.display_view(name).view, outputs.display_view(name).display)
        for name in ("png", "sheet", "overview")
    }
    srgb = "sRGB - Display"
    assert views == {"png": ("Un-tone-mapped", srgb), "sheet": ("Raw", srgb), "overview": ("Raw", video)}


def test_a_studio_s_config_that_is_missing_is_a_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OCIO", "/nowhere/config.ocio")
    for outputs in ("", "png = false"):
        ((key, (problem, _)),) = faults(f"{MINIMAL}[outputs]\n{outputs}", tmp_path).items()
        assert key == "outputs.ocio"
        assert problem.startswith("$OCIO: OpenColorIO cannot read the config /nowhere/config.ocio")
