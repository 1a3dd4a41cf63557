"""Reading job files: values, defaults, and the report of every fault."""

from __future__ import annotations

from pathlib import Path

import pytest

from lookdev.errors import JobError
from lookdev.job import Job, load_job, parse_job
from lookdev.render.backends import Backend, job_backends
from lookdev.scene import Sampling

MINIMAL = """
output = "out"
[asset]
builtin = "sphere"
[[look]]
name = "paint"
material = "paint.usda"
[[ibl]]
name = "city"
builtin = "city"
[[turntable]]
kind = "element"
frames = 4
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("paint.usda", "ball.usdc", "sky.exr"):
        (tmp_path / name).touch()
    return tmp_path


def parse(text: str, folder: Path) -> Job:
    return parse_job(text, folder / "job.toml")


def faults(text: str, folder: Path) -> dict[str, tuple[str, str]]:
    """Return (what, hint) by place."""
    with pytest.raises(JobError) as caught:
        parse(text, folder)
    assert {fault.file for fault in caught.value.faults} == {str(folder / "job.toml")}
    return {fault.where: (fault.what, fault.hint) for fault in caught.value.faults}


def test_minimal_job_has_the_documented_defaults(folder: Path) -> None:
    (folder / "job.toml").write_text(MINIMAL)
    job = load_job(folder / "job.toml")
    assert job.file == folder / "job.toml"
    assert job.output == folder / "out"
    assert (job.asset.prim, job.asset.time, job.asset.variants, job.asset.missing) == (None, None, {}, "error")
    assert (job.asset.purposes, job.asset.subdivision) == (("default", "render"), "auto")
    assert job.look[0].material == folder / "paint.usda"
    assert (job.look[0].parts, job.look[0].layer, job.look[0].assign) == (None, None, ())
    assert (job.ibl[0].exposure, job.ibl[0].rotation) == (0.0, 0.0)
    table = job.turntable[0]
    assert (table.name, table.start, table.degrees) == ("element", 0.0, 360.0)
    assert job.camera.horizontal_fov == pytest.approx(39.5977527)  # 2 atan(18 / 50)
    render = job.render
    assert (render.resolution, render.backend, render.device) == ((512, 512), "exact", "cpu")
    assert (render.samples, render.error, render.bounces, render.seed) == (64, None, 2, 0)
    assert (render.brdf_samples, render.ibl_samples, render.background) == (None, None, "black")
    outputs = job.outputs
    assert (outputs.exr, outputs.png, outputs.sheet, outputs.view) == (True, True, True, None)
    assert (outputs.overview, outputs.overview_columns) == (False, None)


def test_every_key_is_read(folder: Path) -> None:
    (folder / "jobs").mkdir()
    text = """
    output = "/somewhere/else"
    [asset]
    usd = "../ball.usdc"
    prim = "/World/Ball"
    time = 12
    variants = { modelingVariant = "hero" }
    purposes = ["render", "proxy"]
    subdivision = 3
    missing = "warn"
    [camera]
    fov = 30
    elevation = -5.5
    azimuth = 90
    margin = 1.25
    [outputs]
    png = false
    sheet = false
    overview = true
    overview_columns = 11
    view = "Raw"
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
    [[ibl]]
    name = "sky"
    file = "../sky.exr"
    exposure = -1
    rotation = 45
    [[turntable]]
    name = "half"
    kind = "lighting"
    frames = 12
    start = 90
    degrees = -180
    [render]
    resolution = [640, 360]
    error = 1e-3
    ibl_samples = 0
    background = [0.18, 0.18, 1]
    """
    job = parse_job(text, folder / "jobs" / "job.toml")
    assert job.output == Path("/somewhere/else")
    assert (job.asset.usd, job.asset.prim) == (folder / "ball.usdc", "/World/Ball")
    assert (job.asset.time, job.asset.variants, job.asset.missing) == (12.0, {"modelingVariant": "hero"}, "warn")
    assert (job.asset.purposes, job.asset.subdivision) == (("render", "proxy"), 3)
    assert job.look[0].layer == folder / "paint.usda"
    (assign,) = job.look[0].assign
    assert assign.prims == ("/World/Tire*", "/World.collection:trim")
    assert (assign.material, assign.prim, assign.variants) == (folder / "paint.usda", "/Rubber", {"wear": "new"})
    assert (job.look[0].variants, job.look[0].parts) == ({"wear": "dirty"}, ("*/body",))
    assert (job.ibl[0].file, job.ibl[0].exposure) == (folder / "sky.exr", -1.0)
    assert (job.turntable[0].name, job.turntable[0].degrees) == ("half", -180.0)
    assert job.camera.horizontal_fov == 30.0
    assert job.render.samples == 4096  # with a target error, samples is the cap
    assert job.render.background == (0.18, 0.18, 1.0)
    assert not job.outputs.png
    assert job.outputs.overview_columns == 11


def test_sampling_is_that_of_the_job(folder: Path) -> None:
    expected = Sampling(4096, 0.01, brdf_samples=3, ibl_samples=5, bounces=7, seed=11)
    numbers = "error = 0.01\nbrdf_samples = 3\nibl_samples = 5\nbounces = 7\nseed = 11\n"
    assert parse(f"{MINIMAL}[render]\n{numbers}", folder).render.sampling == expected
    assert parse(MINIMAL, folder).render.sampling == Sampling()


@pytest.mark.parametrize("backend", job_backends().values(), ids=lambda backend: backend.name)
def test_a_backend_runs_on_its_devices(backend: Backend, folder: Path) -> None:
    for device in backend.devices:
        render = parse(f'{MINIMAL}[render]\nbackend = "{backend.name}"\ndevice = "{device}"\n', folder).render
        assert (render.backend, render.device) == (backend.name, device)


def test_passes_are_named_and_made_by_the_backend(folder: Path) -> None:
    assert parse(f'{MINIMAL}[render]\npasses = ["uv", "depth", "uv"]\n', folder).render.passes == ("depth", "uv")
    assert faults(f'{MINIMAL}[render]\npasses = ["dept"]\n', folder) == {
        "render.passes[0]": ("unknown value 'dept'", "did you mean 'depth'?")
    }
    text = f'{MINIMAL}[render]\nbackend = "nodes"\npasses = ["samples", "lobes", "direct"]\n'
    assert faults(text, folder) == {
        "render.passes": (
            "backend 'nodes' makes no lobes and no direct; "
            "it makes depth, position, normal, uv, albedo, samples, cryptomatte",
            'backend = "exact" or "mitsuba"',
        )
    }


def test_faults_of_every_table_are_reported_at_once(folder: Path) -> None:
    text = """
    output = "out"
    looks = 1
    [asset]
    usd = "nope.usda"
    [[look]]
    name = "Gold"
    material = "paint.usda"
    prin = "/X"
    [[look]]
    name = "gold"
    material = "gone.usda"
    [[ibl]]
    name = "c"
    builtin = "citty"
    exposure = nan
    [[ibl]]
    name = "c"
    [[turntable]]
    kind = "elemental"
    frames = 0
    [camera]
    fov = 50
    sensor_width = 24
    [render]
    resolution = [0, 10.5]
    samples = 3
    background = [1, 2]
    """
    assert faults(text, folder) == {
        "looks": ("unknown key", "did you mean 'look'?"),
        "asset.usd": (f"no readable file {folder / 'nope.usda'}", "paths are relative to the job file"),
        "look[0].prin": ("unknown key", "did you mean 'prim'?"),
        "look[1].name": ("'gold' is already the name of look[0]", "give each its own name"),
        "look[1].material": (f"no readable file {folder / 'gone.usda'}", "paths are relative to the job file"),
        "ibl[0].builtin": ("unknown value 'citty'", "did you mean 'city'?"),
        "ibl[0].exposure": ("should be a finite number, not nan", ""),
        "ibl[1].name": ("'c' is already the name of ibl[0]", "give each its own name"),
        "ibl[1].builtin": ("give exactly one of 'file' and 'builtin'", ""),
        "turntable[0].kind": ("unknown value 'elemental'", "did you mean 'element'?"),
        "turntable[0].frames": ("should be greater than or equal to 1, not 0", ""),
        "camera.sensor_width": ("has no meaning beside 'fov'", "give either 'fov' or 'focal_length'"),
        "render.resolution[0]": ("should be greater than or equal to 4, not 0", ""),
        "render.resolution[1]": ("should be a valid integer, not 10.5", ""),
        "render.samples": ("should be a multiple of 2, not 3", ""),
        "render.background[2]": ("is missing", ""),
    }


USD = 'usd = "ball.usdc"'
ASSIGN = '"paint.usda"\n[[look.assign]]\nprims = ["/Ball"]\nmaterial = "paint.usda"'


@pytest.mark.parametrize(
    ("old", "new", "place", "what", "hint"),
    [
        *(
            ('builtin = "sphere"', f'builtin = "sphere"\n{key} = {value}', f"asset.{key}", "a built-in asset", "'usd'")
            for key, value in {
                "prim": '"/X"',
                "time": 12.0,
                "variants": '{ a = "b" }',
                "purposes": '["proxy"]',
                "subdivision": 2,
                "missing": '"warn"',
            }.items()
        ),
        ('builtin = "sphere"', f"{USD}\ntiem = 3", "asset.tiem", "unknown key", "did you mean 'time'?"),
        ('builtin = "sphere"', f'{USD}\ntime = "12"', "asset.time", "valid number", ""),
        ('builtin = "sphere"', f"{USD}\ntime = nan", "asset.time", "finite", ""),
        ('builtin = "sphere"', f"{USD}\nvariants = {{ a = 3 }}", "asset.variants.a", "valid string", ""),
        ('builtin = "sphere"', f'{USD}\nvariants = {{ a = "*" }}', "asset.variants", "'a' is '*'", "[[look]]"),
        ('builtin = "sphere"', f"{USD}\npurposes = []", "asset.purposes", "at least 1", ""),
        (
            'builtin = "sphere"',
            f'{USD}\npurposes = "render"',
            "asset.purposes",
            "should be a list",
            'write purposes = ["render"]',
        ),
        ('builtin = "sphere"', f'{USD}\npurposes = ["rendr"]', "asset.purposes[0]", "unknown value", "'render'"),
        ('builtin = "sphere"', f"{USD}\nsubdivision = -1", "asset.subdivision", "equal to 0, not -1", ""),
        ('builtin = "sphere"', f"{USD}\nsubdivision = 7", "asset.subdivision", "equal to 6, not 7", ""),
        ('builtin = "sphere"', f"{USD}\nsubdivision = 1.5", "asset.subdivision", "valid integer", ""),
        ('builtin = "sphere"', f'{USD}\nsubdivision = "atuo"', "asset.subdivision", "unknown value", "'auto'"),
        ('builtin = "sphere"', f'{USD}\nmissing = "wran"', "asset.missing", "unknown value", "'warn'"),
        ('material = "paint.usda"', "", "look[0].material", "is missing", "nothing is bound to a built-in asset"),
        ('"paint.usda"', '"paint.usda"\nlayer = "paint.usda"', "look[0].layer", "a built-in asset", "over 'usd'"),
        ('"paint.usda"', '"paint.usda"\nassign = 3', "look[0].assign", "should be a list", ""),
        ('"paint.usda"', '"paint.usda"\n[look.assign]', "look[0].assign", "should be a list", "write [[look.assign]]"),
        ('"paint.usda"', ASSIGN.replace("prims", "prim"), "look[0].assign[0].prims", "is missing", "paths, globs"),
        ('"paint.usda"', ASSIGN.replace('["/Ball"]', "[]"), "look[0].assign[0].prims", "at least 1", ""),
        ('"paint.usda"', ASSIGN.replace('["/Ball"]', '"/B"'), "look[0].assign[0].prims", "should be a list", ""),
        (
            '"paint.usda"',
            ASSIGN.replace("\nmaterial", "\nmateril"),
            "look[0].assign[0].materil",
            "unknown key",
            "mater",
        ),
        ('"paint.usda"', ASSIGN[:-7] + '.glb"', "look[0].assign[0].material", "'pain.glb' is of no known", ".mtlx"),
        ('"paint.usda"', '"paint.usda"\nlayer = "a.mtlx"', "look[0].layer", "'a.mtlx' is of no known", ".usdz"),
        ('"paint.usda"', ASSIGN + '\nvariants = { a = "*" }', "look[0].assign[0].variants", "'a' is '*'", "[[look]]"),
    ],
)
def test_a_fault_of_the_asset_or_its_parts_is_reported_with_its_place(
    folder: Path, old: str, new: str, place: str, what: str, hint: str
) -> None:
    found = faults(MINIMAL.replace(old, new, 1), folder)
    assert place in found
    assert what in found[place][0]
    assert hint in found[place][1]
    # Beside it, only what one misspelt key leaves out.
    assert len(found) <= 1 + ("unknown key" in what) + ("is missing" in what)


def test_a_look_without_material_wears_what_the_asset_binds(folder: Path) -> None:
    text = MINIMAL.replace('builtin = "sphere"', USD).replace('material = "paint.usda"\n', "")
    assert parse(text, folder).look[0].material is None
    found = faults(text.replace('"paint"\n', '"paint"\nprim = "/Paint"\nparts = ["/Ball"]\n'), folder)
    assert found == {
        f"look[0].{key}": ("has no meaning without 'material'", "a look without 'material' wears what the asset binds")
        for key in ("prim", "parts")
    }


def test_assigned_materials_dress_a_built_in_asset(folder: Path) -> None:
    look = parse(MINIMAL.replace('material = "paint.usda"', ASSIGN.partition("\n")[2]), folder).look[0]
    assert (look.material, look.assign[0].prims) == (None, ("/Ball",))


MORE_TURNTABLES = "".join(f'\n[[turntable]]\nkind = "element"\nname = "t{i}"\nframes = 9999' for i in range(25))


@pytest.mark.parametrize(
    ("old", "new", "place", "what"),
    [
        ('"out"', '"job.toml/../paint.usda"', "output", "is not a folder"),
        ('"out"', '"paint.usda/deep/out"', "output", "paint.usda is not a folder"),
        ('"out"', "3", "output", "should be a path in quotes"),
        ('builtin = "sphere"', "", "asset.builtin", "exactly one of 'usd' and 'builtin'"),
        ('builtin = "sphere"', 'builtin = "sphere"\nusd = "ball.usdc"', "asset.builtin", "exactly one of"),
        ('builtin = "sphere"', 'builtin = "sphere"\nprim = "/X"', "asset.prim", "has no meaning with a built-in"),
        ('builtin = "sphere"', 'usd = "sky.exr"', "asset.usd", "'sky.exr' is of no known kind"),
        ('builtin = "sphere"', 'usd = "ball.usdc"\nprim = "X"', "asset.prim", "'X' is not allowed"),
        ("[asset]", "[[asset]]", "asset", "should be a table"),
        ("[[look]]", "[look]", "look", "should be a list"),
        ('"paint"', '"../paint"', "look[0].name", "is not allowed"),
        ('"paint"', '".."', "look[0].name", "is not allowed"),
        ('"paint"', '""', "look[0].name", "is not allowed"),
        ('"paint.usda"', '"paint.usda"\nparts = []', "look[0].parts", "at least 1"),
        ('builtin = "city"', 'file = "paint.usda"', "ibl[0].file", "'paint.usda' is of no known kind"),
        ('builtin = "city"', 'builtin = "city"\nrotation = true', "ibl[0].rotation", "valid number"),
        ('builtin = "city"', 'builtin = "city"\nexposure = inf', "ibl[0].exposure", "finite"),
        ("frames = 4", 'frames = "4"', "turntable[0].frames", 'valid integer, not "4"'),
        ("frames = 4", "frames = 10000", "turntable[0].frames", "9999"),
        ("frames = 4", "", "turntable[0].frames", "is missing"),
        ("frames = 4", "frames = 9999" + MORE_TURNTABLES, "turntable", "make 259974 frames; at most 250000"),
        ("frames = 4", "frames = 4\n[camera]\nfov = 180", "camera.fov", "170"),
        ("frames = 4", "frames = 4\n[camera]\nfov = 9\nfocal_length = 9", "camera.focal_length", "'fov'"),
        ("frames = 4", "frames = 4\n[camera]\nmargin = 0.9", "camera.margin", "greater than or equal to 1"),
        ("frames = 4", "frames = 4\n[camera]\nfill = 0.04", "camera.fill", "greater than or equal to 0.05"),
        ("frames = 4", "frames = 4\n[camera]\nfill = 1.01", "camera.fill", "less than or equal to 1"),
        ("frames = 4", "frames = 4\n[camera]\nmargin = 1.1\nfill = 0.7", "camera.margin", "beside 'fill'"),
        ("frames = 4", 'frames = 4\n[camera]\nframing = "look"', "camera.framing", "unknown value 'look'"),
        ("frames = 4", 'frames = 4\n[camera]\nusd = "Shot"', "camera.usd", "'Shot' is not allowed here"),
        ("frames = 4", 'frames = 4\n[camera]\nusd = "/Shot"', "camera", "a built-in asset has no camera"),
        ("frames = 4", 'frames = 4\n[camera]\nfile = "ball.usdc"', "camera.file", "without 'usd'"),
        *(
            ("frames = 4", f'frames = 4\n[camera]\nusd = "/Shot"\nfile = "ball.usdc"\n{key}', place, "beside 'usd'")
            for key in ("fov = 9", "focal_length = 9", "elevation = 1", "azimuth = 1", "fill = 0.5", "margin = 2")
            for place in ("camera." + key.split()[0],)
        ),
        ("frames = 4", 'frames = 4\n[render]\ndevice = "cuda"', "render.device", "on 'cuda'"),
        ("frames = 4", 'frames = 4\n[render]\nbackend = "node"', "render.backend", "unknown value"),
        *(
            ("frames = 4", f'frames = 4\n[render]\nbackend = "{name}"\n{key} = 4', f"render.{key}", f"backend '{name}'")
            for name, record in job_backends().items()
            if not record.directions
            for key in ("brdf_samples", "ibl_samples")
        ),
        ("frames = 4", "frames = 4\n[render]\nerror = 0.0", "render.error", "greater than 0"),
        ("frames = 4", "frames = 4\n[render]\nsamples = 0", "render.samples", "equal to 2"),
        ("frames = 4", 'frames = 4\n[render]\nbackground = "red"', "render.background", "unknown value"),
        ("frames = 4", "frames = 4\n[render]\nresolution = [1, 2, 3]", "render.resolution", "at most 2"),
        ("frames = 4", "frames = 4\n[render]\nbrdf_samples = 0", "render.brdf_samples", "equal to 1"),
        ("frames = 4", "frames = 4\n[render]\nseed = 262144", "render.seed", "equal to 262143"),
        ("frames = 4", "frames = 4\n[outputs]\nexr = false", "outputs.exr", "cannot be left out"),
        ("frames = 4", "frames = 4\n[outputs]\noverview_columns = 2", "outputs.overview_columns", "without 'overview'"),
        ("frames = 4", "frames = 4\n[outputs]\noverview = 3", "outputs.overview", "boolean"),
        ("4", "4\n[outputs]\noverview = true\noverview_columns = 0", "outputs.overview_columns", "equal to 1"),
    ],
)
def test_one_fault_is_reported_alone_with_its_place(folder: Path, old: str, new: str, place: str, what: str) -> None:
    parse(MINIMAL, folder)
    found = faults(MINIMAL.replace(old, new, 1), folder)
    assert list(found) == [place]
    assert what in found[place][0]


def test_a_wrong_device_is_told_all_that_the_backend_has(folder: Path) -> None:
    render = '[render]\nbackend = "mitsuba"\ndevice = "hip"'
    (fault,) = faults(MINIMAL.replace("frames = 4", f"frames = 4\n{render}", 1), folder)["render.device"][1:]
    assert fault == 'device = "cpu" or "cuda", or backend = "nodes" or "nodes-exact"'


def test_a_turntable_without_name_has_that_of_its_kind(folder: Path) -> None:
    second = '[[turntable]]\nkind = "element"\nframes = 8\n'
    assert list(faults(MINIMAL + second, folder)) == ["turntable[1].name"]
    job = parse(MINIMAL + second + 'name = "fine"\n', folder)
    assert [turntable.name for turntable in job.turntable] == ["element", "fine"]


@pytest.mark.parametrize(
    ("content", "where"),
    [
        (b'output = "a"\nlook =\n', "line 2, column 7"),
        (b"look = [", "end of document"),
        (b"# a\n\xff", "line 2, column 1"),
    ],
)
def test_text_that_is_no_toml_is_reported_with_its_line(tmp_path: Path, content: bytes, where: str) -> None:
    (tmp_path / "job.toml").write_bytes(content)
    with pytest.raises(JobError) as caught:
        load_job(tmp_path / "job.toml")
    assert [fault.where for fault in caught.value.faults] == [where]


def test_a_missing_job_file_is_a_job_error(tmp_path: Path) -> None:
    with pytest.raises(JobError, match=r"job\.toml: cannot be read: No such file"):
        load_job(tmp_path / "job.toml")
