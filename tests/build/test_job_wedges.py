"""Wedges of a job: the looks and lights that they expand to, the rendered pairs, and every fault of a wedge."""

from pathlib import Path

import numpy as np
import pytest
from usd_text import METRES, card, job_toml, shader

from lookdev.build.faults import Findings
from lookdev.build.scenes import JobScenes, build_scenes
from lookdev.build.wedges import expand_wedges
from lookdev.codegen.source import ShaderSource
from lookdev.errors import Fault, FaultsError
from lookdev.job import parse_job
from lookdev.plan.prepare import plan_job, prepare_job, read_setups

STACK = (
    "token inputs:base.connect = </Paint/Base.outputs:layer>",
    "token inputs:layer1.connect = </Paint/Coat.outputs:layer>",
    "float inputs:layer1Mask.connect = </Paint/Amount.outputs:result>",
    "token outputs:surface",
)
AMOUNT = ('string inputs:expression = "amount * view"', "float inputs:amount = 0.5", "float outputs:result")
LOOK = f"""#usda 1.0
def Material "Paint"
{{
    token outputs:lookdev:surface.connect = </Paint/Stack.outputs:surface>
    {shader("Stack", "LookdevLayers", *STACK)}
    {shader("Base", "LookdevDisney", "float inputs:roughness = 0.5", "token outputs:layer")}
    {shader("Coat", "LookdevDisney", "float inputs:metallic = 1", "token outputs:layer")}
    {shader("Amount", "LookdevExpression", *AMOUNT)}
}}
"""
RIG = '[{ name = "three", builtin = "three_point" }]'
JOB = job_toml("paint = paint.usda, other = paint.usda", rig=RIG, turntable='[{ kind = "element", frames = 1 }]')


def scenes(folder: Path, wedges: str) -> JobScenes:
    (folder / "paint.usda").write_text(LOOK)
    return build_scenes(parse_job(JOB + wedges, folder / "job.toml"))


def wedge(text: str) -> str:
    return f"[[wedge]]\n{text}\n"


ROUGHNESS = wedge('parameter = "Base.roughness"\nvalues = [0.1]')
BASE = [(look, rig) for look in ("paint", "other") for rig in ("white", "three")]


def test_values_of_a_look_are_looks_under_the_lights_of_the_job(tmp_path: Path) -> None:
    result = scenes(tmp_path, wedge('look = "paint"\nparameter = "Base.roughness"\nrange = [0.0, 1.0, 3]'))
    names = [f"paint_Base.roughness_{value}" for value in ("0", "0.5", "1")]
    assert list(result.scenes)[:2] == BASE[:2]
    assert set(result.scenes) == {*BASE, *((name, rig) for name in names for rig in ("white", "three"))}
    for name, value in zip(names, (0.0, 0.5, 1.0), strict=True):
        look = result.scenes[name, "white"].looks[0]
        assert look.layers[0].inputs["roughness"] == value
    sheet, other = result.sheets
    assert (sheet.look, sheet.rig, other.rig) == ("paint", "white", "three")
    assert sheet.cells == tuple((name, "white") for name in names)
    assert (sheet.name, sheet.title) == ("Base.roughness", "paint / white: Base.roughness")
    assert sheet.labels == ("0", "0.5", "1")
    assert sheet.columns is None


def test_expressions_of_masks_are_numbered(tmp_path: Path) -> None:
    result = scenes(tmp_path, wedge('look = "paint"\nparameter = "Coat.mask"\nvalues = ["view", "1 - view", 0.5]'))
    assert {look for look, _ in result.scenes} >= {"paint_Coat.mask_view", "paint_Coat.mask_2", "paint_Coat.mask_0.5"}
    assert result.sheets[0].labels == ("view", "1 - view", "0.5")


def test_two_parameters_make_all_pairs_row_by_row(tmp_path: Path) -> None:
    by = "values = [0, 1]\nby = { parameter = 'exposure', values = [-1, 0.5] }"
    result = scenes(tmp_path, wedge(f'look = "paint"\nrig = "three"\nparameter = "Coat.mask.amount"\n{by}'))
    (sheet,) = result.sheets
    looks, rigs = ("paint_Coat.mask.amount_0", "paint_Coat.mask.amount_1"), ("three_exposure_-1", "three_exposure_0.5")
    assert sheet.cells == tuple((look, rig) for look in looks for rig in rigs)
    assert set(result.scenes) == {*BASE, *sheet.cells}
    assert (sheet.columns, sheet.labels) == (2, ("0, -1", "0, 0.5", "1, -1", "1, 0.5"))
    exposures = {rig.name: rig.exposure for rig in result.job.rigs}
    assert exposures == {"white": 0.0, "three": 0.0, "three_exposure_-1": -1.0, "three_exposure_0.5": 0.5}
    for value, name in enumerate(looks):
        look = result.scenes[name, rigs[0]].looks[0]
        assert look.layers[1].mask.inputs["amount"] == value


def test_values_of_lights_of_a_rig(tmp_path: Path) -> None:
    text = 'rig = "three"\nlook = "paint"\nparameter = "light:key.intensity"\nvalues = [5.0, 10.0]'
    rotated = wedge('look = "paint"\nrig = "white"\nparameter = "rotation"\nvalues = [90]')
    result = scenes(tmp_path, wedge(text) + rotated)
    one, two = (result.scenes["paint", f"three_key.intensity_{value}"].lights for value in (5, 10))
    ratios = [np.divide(b.emission.color, a.emission.color) for a, b in zip(one, two, strict=True)]
    assert sorted(round(float(ratio[0]), 6) for ratio in ratios) == [1.0, 1.0, 2.0]
    assert {rig.name: rig.rotation for rig in result.job.rigs}["white_rotation_90"] == 90.0


def test_looks_of_a_wedge_share_one_program_and_frames_are_planned_once(tmp_path: Path) -> None:
    (tmp_path / "paint.usda").write_text(LOOK)
    wedges = wedge('look = "paint"\nrig = "white"\nparameter = "Base.roughness"\nrange = [0.1, 0.4, 4]')
    prepared = plan_job(parse_job(JOB + wedges, tmp_path / "job.toml"))
    varied = [setup for setup in prepared.setups if setup.look.startswith("paint_")]
    sources = [source for setup in varied for source in setup.task.shaders]
    assert len(varied) == 4
    assert all(isinstance(source, ShaderSource) for source in sources)
    assert len({source.program.osl for source in sources}) == 1
    assert len({source.digest for source in sources}) == 4
    assert len(prepared.plan.frames) == 4 + 4
    assert len(prepared.plan.sheets) == 1


def test_an_export_has_no_wedges(tmp_path: Path) -> None:
    (tmp_path / "paint.usda").write_text(LOOK)
    (tmp_path / "job.toml").write_text(JOB + ROUGHNESS)
    assert len(read_setups(tmp_path / "job.toml").setups) == 4
    assert len(prepare_job(tmp_path / "job.toml").setups) == 8


ONE = 'values = [0.1]\nlook = "paint"\n'
THREE = '\nrig = "three"\nvalues = [1.0]'
BY = '\nby = { parameter = "exposure", values = [1] }'


@pytest.mark.parametrize(
    ("text", "where", "said"),
    [
        ('parameter = "Base.rougness"\n' + ONE, "wedge[0]", "did you mean 'Base.roughness'"),
        ('parameter = "roughness"\n' + ONE, "wedge[0]", "one of Base.roughness, Coat.roughness would be right"),
        ('parameter = "Base.roughness"\nvalues = [2.0]\n', "wedge[0]", "its range is 0 to 1"),
        ('parameter = "Base.roughness"\nvalues = [0.5, 0.5]\n', "wedge[0].values", "0.5 is there twice"),
        ('parameter = "Base.roughness"\n', "wedge[0].range", "exactly one of 'values' and 'range'"),
        ('parameter = "Base.roughness"\nrange = [0, 1, 1]\n', "wedge[0].range[2]", "greater than or equal to 2"),
        (
            'parameter = "Base.roughness"\nlook = "pant"\nvalues = [0.1]',
            "wedge[0].look",
            "the job has no look 'pant' (did you mean 'paint'?)",
        ),
        ('parameter = "exposure"\nrig = "tree"\nvalues = [0.1]', "wedge[0].rig", "did you mean 'three'"),
        ('parameter = "exposure"\nvalues = [99]', "wedge[0]", "exposure cannot be 99"),
        ('parameter = "rotation"\nvalues = ["90"]', "wedge[0]", "rotation cannot be '90'"),
        ('parameter = "light:kye.intensity"' + THREE, "light:kye.intensity", "did you mean 'key'"),
        ('parameter = "light:key.intnsity"' + THREE, "light:", "did you mean 'intensity'"),
        ('parameter = "light:key.color"' + THREE, "light:", "it is a color3f"),
        ('parameter = "light:key.intensity"\nrig = "white"\nvalues = [1.0]', "wedge[0]", "'white' is one image"),
        ('parameter = "exposure"\nvalues = [0]' + BY, "wedge[0].by.parameter", "varies what the wedge varies already"),
    ],
)
def test_faults_name_what_would_be_right(tmp_path: Path, text: str, where: str, said: str) -> None:
    with pytest.raises(FaultsError) as caught:
        scenes(tmp_path, wedge(text))
    messages = [f"{fault.what} ({fault.hint})" for fault in caught.value.faults if fault.where.startswith(where)]
    assert any(said in fault for fault in messages), caught.value


def test_two_wedges_of_one_name(tmp_path: Path) -> None:
    other = ROUGHNESS.replace("0.1", "0.2")
    (tmp_path / "paint.usda").write_text(LOOK)
    job = parse_job(JOB + ROUGHNESS + other, tmp_path / "job.toml")
    expand_wedges(job, findings := Findings(job))
    message, hint = "another wedge is called 'Base.roughness'", "give each wedge its own name"
    assert findings.faults == [Fault(str(tmp_path / "job.toml"), "wedge[1]", message, hint)]
    result = scenes(tmp_path, ROUGHNESS + other.replace("values", 'name = "fine"\nvalues'))
    assert {sheet.name for sheet in result.sheets} == {"Base.roughness", "fine"}


def test_the_frames_of_wedges_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "paint.usda").write_text(LOOK)
    text = JOB.replace("frames = 1", "frames = 3") + ROUGHNESS
    job = parse_job(text, tmp_path / "job.toml")
    monkeypatch.setattr("lookdev.build.scenes.MAX_FRAMES", 24)
    assert len(build_scenes(job).scenes) == 8
    monkeypatch.setattr("lookdev.build.scenes.MAX_FRAMES", 23)
    with pytest.raises(FaultsError, match=r"wedge: wedges make 24 frames of the job; at most 23 .*\(write several"):
        build_scenes(job)


def test_a_look_without_a_material_of_its_own_has_nothing_to_vary(tmp_path: Path) -> None:
    (tmp_path / "asset.usda").write_text(METRES + card("Card"))
    text = JOB.replace('builtin = "plane"', 'usd = "asset.usda"').replace(', material = "paint.usda"', "")
    with pytest.raises(FaultsError, match="has no 'material' of its own"):
        build_scenes(parse_job(text + ROUGHNESS, tmp_path / "job.toml"))
