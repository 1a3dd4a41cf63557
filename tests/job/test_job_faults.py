"""Faults of job files: each with its key and a hint, alone and all of them at once."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from minimal_job import MINIMAL, faults, parse

from lookdev.errors import JobError
from lookdev.job import load_job
from lookdev.output.color import VIEWS
from lookdev.rendering.backends import BACKENDS, job_backends

USD = 'usd = "ball.usdc"'
ASSIGN = '[[look.assign]]\nprims = ["/Ball"]\nmaterial = "paint.usda"'
MORE_TURNTABLES = "".join(f'\n[[turntable]]\nkind = "element"\nname = "t{i}"\nframes = 9999' for i in range(25))

# The key of a fault and its message, by the line of the job that causes it. " ... " separates parts of the message.
BUILT_IN_LINES = ('prim = "/X"', "time = 12", 'variants = { a = "b" }', 'purposes = ["proxy"]', "subdivision = 2")
OF_BUILT_IN_ASSETS = {
    line: (f"asset.{line.split()[0]}", "a built-in asset ... 'usd'") for line in (*BUILT_IN_LINES, 'missing = "warn"')
} | {USD: ("asset.builtin", "exactly one of")}
OF_USD_ASSETS = {
    'prim = "X"': ("asset.prim", "'X' is not allowed"),
    "tiem = 3": ("asset.tiem", "unknown key ... did you mean 'time'?"),
    'time = "12"': ("asset.time", "valid number"),
    "time = nan": ("asset.time", "finite"),
    "variants = { a = 3 }": ("asset.variants.a", "valid string"),
    'variants = { a = "*" }': ("asset.variants", "'a' is '*' ... [[look]]"),
    "purposes = []": ("asset.purposes", "at least 1"),
    'purposes = "render"': ("asset.purposes", 'should be a list ... write purposes = ["render"]'),
    'purposes = ["rendr"]': ("asset.purposes[0]", "unknown value ... 'render'"),
    "subdivision = -1": ("asset.subdivision", "equal to 0, not -1"),
    "subdivision = 7": ("asset.subdivision", "equal to 6, not 7"),
    "subdivision = 1.5": ("asset.subdivision", "valid integer"),
    'subdivision = "atuo"': ("asset.subdivision", "unknown value ... 'auto'"),
}
OF_LOOKS = {
    'layer = "paint.usda"': ("look[0].layer", "a built-in asset ... over 'usd'"),
    'layer = "a.mtlx"': ("look[0].layer", "'a.mtlx' is of no known ... .usdz"),
    "parts = []": ("look[0].parts", "at least 1"),
    "assign = 3": ("look[0].assign", "should be a list"),
    "[look.assign]": ("look[0].assign", "should be a list ... write [[look.assign]]"),
    ASSIGN.replace('["/Ball"]', "[]"): ("look[0].assign[0].prims", "at least 1"),
    ASSIGN.replace('["/Ball"]', '"/B"'): ("look[0].assign[0].prims", "should be a list"),
    ASSIGN.replace("paint.usda", "pain.glb"): ("look[0].assign[0].material", "'pain.glb' is of no known ... .mtlx"),
    ASSIGN + '\nvariants = { a = "*" }': ("look[0].assign[0].variants", "'a' is '*' ... [[look]]"),
}
OF_OTHER_TABLES = {
    '[[turntable]]\nkind = "element"\nframes = 8': ("turntable[1].name", "'element' is already the name"),
    "[camera]\nfov = 180": ("camera.fov", "170"),
    "[camera]\nfov = 9\nfocal_length = 9": ("camera.focal_length", "'fov'"),
    "[camera]\nmargin = 0.9": ("camera.margin", "greater than or equal to 1"),
    "[camera]\nfill = 0.04": ("camera.fill", "greater than or equal to 0.05"),
    "[camera]\nfill = 1.01": ("camera.fill", "less than or equal to 1"),
    "[camera]\nmargin = 1.1\nfill = 0.7": ("camera.margin", "beside 'fill'"),
    '[camera]\nusd = "Shot"': ("camera.usd", "'Shot' is not allowed here"),
    '[camera]\nusd = "/Shot"': ("camera", "a built-in asset has no camera"),
    '[camera]\nfile = "ball.usdc"': ("camera.file", "without 'usd'"),
    **{
        f'[camera]\nusd = "/Shot"\nfile = "ball.usdc"\n{key} = 1': (f"camera.{key}", "beside 'usd'")
        for key in ("fov", "focal_length", "elevation", "azimuth", "fill", "margin")
    },
    '[render]\ndevice = "cuda"': ("render.device", "on 'cuda'"),
    '[render]\nbackend = "mitsuba"\ndevice = "hip"': (
        "render.device", '(device = "cpu" or "cuda", or backend = "nodes" or "nodes-exact")'
    ),
    **{
        f'[render]\nbackend = "{name}"\n{key} = 4': (f"render.{key}", f"backend '{name}'")
        for name, record in job_backends().items()
        if not record.has_light_integral
        for key in ("brdf_samples", "ibl_samples")
    },
    "[render]\nerror = 0.0": ("render.error", "greater than 0"),
    "[render]\nsamples = 0": ("render.samples", "equal to 2"),
    '[render]\nbackground = "red"': ("render.background", "unknown value"),
    "[render]\nresolution = [1, 2, 3]": ("render.resolution", "at most 2"),
    "[render]\nbrdf_samples = 0": ("render.brdf_samples", "equal to 1"),
    "[render]\nseed = 262144": ("render.seed", "equal to 262143"),
    '[render]\nspace = "acescg"\nbackend = "nodes"': ("render.space", 'Rec.709 alone (backend = "exact" or "mitsuba")'),
    '[render]\npasses = ["dept"]': ("render.passes[0]", "unknown value 'dept' (did you mean 'depth'?)"),
    '[render]\nbackend = "nodes"\npasses = ["samples", "lobes", "direct"]': (
        "render.passes",
        "backend 'nodes' makes no lobes and no direct; it makes depth, position, normal, uv, albedo, samples, "
        'cryptomatte (backend = "exact" or "mitsuba")',
    ),
    '[render]\npasses = ["lights"]\nbackend = "nodes"': ("render.passes", "makes no lights; ... \"exact\""),
    "[outputs]\nexr = false": ("outputs.exr", "cannot be left out"),
    "[outputs]\noverview_columns = 2": ("outputs.overview_columns", "without 'overview'"),
    "[outputs]\noverview = 3": ("outputs.overview", "boolean"),
    "[outputs]\noverview = true\noverview_columns = 0": ("outputs.overview_columns", "equal to 1"),
    '[outputs]\nview = "lookdv"': ("outputs.view", "did you mean 'lookdev'"),
    '[outputs]\nview = "acse"': ("outputs.view", f"known: {', '.join(VIEWS)}"),
    '[outputs]\ndisplay = "sRGB"': ("outputs.display", "has no display called 'sRGB'"),
    '[outputs]\nocio = "none.ocio"': ("outputs.ocio", "cannot read the config"),
    '[outputs]\nocio_space = "Linear Rec.708 (sRGB)"': ("outputs.view", "did you mean 'Linear Rec.709 (sRGB)'"),
    '[outputs]\nviews = { pgn = "Raw" }': ("outputs.views", "no output is called 'pgn'"),
    '[outputs]\nviews = { png = "raw" }': ("outputs.views", "png: ... did you mean 'Raw'"),
    '[outputs]\nview = "ACES 1.0 - SDR Video"\ndisplays = { png = "P3-D65 - Display" }': (
        "outputs.views", "png: ... ACES 1.0"
    ),
    '[outputs]\ndisplays = { png = "P4" }': ("outputs.views", "png: ... no display called 'P4'"),
    "[charts]\n[render]\nresolution = [200, 900]": ("charts", "along the bottom edge, the frame has 200 (size = 0.066"),
    '[charts]\n[render]\nbackend = "nodes"': ("charts", 'lets the props shadow one another (backend = "exact"'),
    "[charts]\nsice = 0.2": ("charts.sice", "unknown key (did you mean 'size'?)"),
    "[charts]\nsize = 0.7": ("charts.size", "equal to 0.5, not 0.7"),
    '[ground]\n[render]\nbackend = "nodes"': (
        "ground",
        'renders no shadow catcher (kind = "plane", or backend = "exact"',
    ),
    '[ground]\n[render]\ndenoise = "measured"': ("ground", "the alpha of a shadow catcher is not denoised"),
    '[ground]\n[render]\npasses = ["uv", "direct", "lobes"]': ("ground", "a shadow catcher has no lobes and no direct"),
    '[ground]\nprim = "/A"': ("ground.prim", "has no meaning without 'material'"),
    '[ground]\nmaterial = "none.usda"': ("ground.material", "no readable file"),
    "[ground]\nsize = 0": ("ground.size", "equal to 1, not 0"),
}  # fmt: skip
REPLACED = [
    ('"out"', '"job.toml/../paint.usda"', "output", "is not a folder"),
    ('"out"', '"paint.usda/deep/out"', "output", "paint.usda is not a folder"),
    ('"out"', "3", "output", "should be a path in quotes"),
    ('output = "out"', 'output = ""', "output", "should be a path in quotes"),
    ('"out"', r'"a\u0000b"', "output", "should be a path in quotes"),
    ('"out"', f'"{"x" * 300}"', "output", "cannot be a folder: File name too long"),
    ('builtin = "sphere"', "", "asset.builtin", "exactly one of 'usd' and 'builtin'"),
    ('builtin = "sphere"', 'usd = "sky.exr"', "asset.usd", "'sky.exr' is of no known kind"),
    ("[asset]", "[[asset]]", "asset", "should be a table"),
    ("[[look]]", "[look]", "look", "should be a list"),
    *(('"paint"', f'"{name}"', "look[0].name", "is not allowed") for name in ("../paint", "..", "")),
    ('material = "paint.usda"', "", "look[0].material", "is missing ... nothing is bound to a built-in asset"),
    ('builtin = "city"', 'file = "paint.usda"', "ibl[0].file", "'paint.usda' is of no known kind"),
    ('builtin = "city"', 'builtin = "city"\nrotation = true', "ibl[0].rotation", "valid number"),
    ('builtin = "city"', 'builtin = "city"\nexposure = inf', "ibl[0].exposure", "finite"),
    ("frames = 4", 'frames = "4"', "turntable[0].frames", 'valid integer, not "4"'),
    ("frames = 4", 'frames = "vierzig Stück"', "turntable[0].frames", 'valid integer, not "vierzig Stück"'),
    ("frames = 4", "frames = 10000", "turntable[0].frames", "9999"),
    ("frames = 4", "", "turntable[0].frames", "is missing"),
    ("frames = 4", "frames = 9999" + MORE_TURNTABLES, "turntable", "make 259974 frames; at most 250000"),
]


def cases(after: str, table: Mapping[str, tuple[str, str]], replacement: str = "") -> list[Any]:
    """Return jobs with a line of `table` after a line, which `replacement` replaces unless it is empty."""
    assert after in MINIMAL
    texts = {line: MINIMAL.replace(after, f"{replacement or after}\n{line}", 1) for line in table}
    return [pytest.param(texts[line], key, message, id=line) for line, (key, message) in table.items()]


@pytest.mark.parametrize(
    ("text", "key", "message"),
    [
        *cases('builtin = "sphere"', OF_BUILT_IN_ASSETS),
        *cases('builtin = "sphere"', OF_USD_ASSETS, replacement=USD),
        *cases('material = "paint.usda"', OF_LOOKS),
        *cases("frames = 4", OF_OTHER_TABLES),
        *(pytest.param(MINIMAL.replace(old, new, 1), *rest, id=new[:40]) for old, new, *rest in REPLACED),
    ],
)
def test_one_fault_is_reported_alone_with_its_key(tmp_path: Path, text: str, key: str, message: str) -> None:
    assert text != MINIMAL
    ((where, (problem, hint)),) = faults(text, tmp_path).items()
    assert where == key
    assert all(part in f"{problem} ({hint})" for part in message.split(" ... "))


def test_a_backend_without_guides_denoises_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(BACKENDS, "nodes", replace(BACKENDS["nodes"], has_denoising_guides=False))
    problem, hint = faults(f'{MINIMAL}[render]\nbackend = "nodes"\ndenoise = "measured"\n', tmp_path)["render.denoise"]
    assert problem == "backend 'nodes' renders no albedos and normals to denoise by"
    assert '"exact"' in hint
    assert '"nodes"' not in hint


def test_an_output_whose_module_is_not_installed_is_a_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lookdev.job.outputs.find_spec", lambda module: None)
    assert not parse(f"{MINIMAL}[outputs]\nmovie = false\n", tmp_path).outputs.movie
    fault = ("needs the module 'av', which is not installed", "pip install 'lookdev[movie]'")
    assert faults(f"{MINIMAL}[outputs]\nmovie = true\n", tmp_path) == {"outputs.movie": fault}


def test_what_a_catcher_cannot_a_plane_can_and_a_job_without_faults_has_none(tmp_path: Path) -> None:
    for line in ("", 'backend = "nodes"', 'denoise = "measured"', 'passes = ["uv", "direct", "lobes"]'):
        parse(f'{MINIMAL}[render]\n{line}\n[ground]\nkind = "plane"\n', tmp_path)
    charts = faults(MINIMAL.replace('"paint"', '"Charts"') + "[charts]\n", tmp_path)
    assert charts["charts"] == ("a look of the job is called 'charts', the name of the frames of [charts]", "rename it")
    assert parse(MINIMAL + '[[turntable]]\nname = "fine"\nkind = "element"\nframes = 8\n', tmp_path).turntable[1].name


@pytest.mark.parametrize(
    ("key", "said", "hint"), [("prims", "a valid string", "paths, globs"), ("material", "unknown key", "")]
)
def test_a_misspelt_key_is_reported_beside_the_missing_one(tmp_path: Path, key: str, said: str, hint: str) -> None:
    text = MINIMAL.replace('"paint.usda"', '"paint.usda"\n' + ASSIGN.replace(key, key[:-1]), 1)
    by_location = faults(text, tmp_path).items()
    reported = {location.removeprefix("look[0].assign[0]."): fault for location, fault in by_location}
    assert reported.keys() == {key, key[:-1]}
    assert said in reported[key[:-1]][0]
    assert reported[key][0] == "is missing"
    assert hint in reported[key][1]


def test_faults_of_every_table_are_reported_at_once(tmp_path: Path) -> None:
    text = """
    output = "out"
    looks = 1
    asset = { usd = "nope.usda" }
    camera = { fov = 50, sensor_width = 24 }
    turntable = [{ kind = "elemental", frames = 0 }]
    render = { resolution = [0, 10.5], samples = 3, background = [1, 2] }
    ibl = [{ name = "c", builtin = "citty", exposure = nan }, { name = "c" }]
    [[look]]
    name = "Gold"
    material = "paint.usda"
    prin = "/X"
    [[look]]
    name = "gold"
    material = "gone.usda"
    """
    assert faults(text, tmp_path) == {
        "looks": ("unknown key", "did you mean 'look'?"),
        "asset.usd": (f"no readable file {tmp_path / 'nope.usda'}", "paths are relative to the job file"),
        "look[0].prin": ("unknown key", "did you mean 'prim'?"),
        "look[1].name": ("'gold' is already the name of look[0]", "give each its own name"),
        "look[1].material": (f"no readable file {tmp_path / 'gone.usda'}", "paths are relative to the job file"),
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


@pytest.mark.parametrize(
    ("content", "where"),
    [
        (b'output = "a"\nlook =\n', "line 2, column 7"),
        (b"look = [", "end of document"),
        (b"# a\n\xff", "line 2, column 1"),
    ],
)
def test_text_that_is_not_toml_is_reported_with_its_line(tmp_path: Path, content: bytes, where: str) -> None:
    (tmp_path / "job.toml").write_bytes(content)
    with pytest.raises(JobError) as caught:
        load_job(tmp_path / "job.toml")
    assert [fault.where for fault in caught.value.faults] == [where]
