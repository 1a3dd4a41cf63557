"""From assigned looks to rendered assets: refined cages, displaced surfaces, and the cameras."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from usd_text import METRES, image, job_toml, material, shader

from lookdev.asset import load_asset
from lookdev.asset.silhouette import hull_points
from lookdev.build.assign import NEUTRAL_LOOK, AssignedAsset
from lookdev.build.faults import Findings
from lookdev.build.frame import refine_and_frame
from lookdev.build.scenes import JobScenes, build_scenes
from lookdev.errors import FaultsError
from lookdev.job import parse_job
from lookdev.scene import Pose, Scene

CUBE = f"""{METRES}
def Mesh "Cube"
{{
    uniform token subdivisionScheme = "SCHEME"
    int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
    int[] faceVertexIndices = [0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3]
    point3f[] points = [(0, 0, 0), (0, 0, 1), (0, 1, 0), (0, 1, 1), (1, 0, 0), (1, 0, 1), (1, 1, 0), (1, 1, 1)]
    texCoord2f[] primvars:map1 = [(0, 0)] ( interpolation = "constant" )
}}
"""


def displaced(height: str, *shaders: str) -> str:
    """Return a material with displacement; `height` is an input of LookdevDisplacement."""
    moved = shader("Moved", "LookdevDisplacement", f"float inputs:height{height}", "token outputs:displacement")
    lines = "token outputs:lookdev:displacement.connect = </Paint/Moved.outputs:displacement>\n"
    return "#usda 1.0\n" + material(more=lines + moved + "".join(shaders))


WAVES = 'string inputs:expression = "0.5 + st[0]"', "float2 inputs:st.connect = </Paint/St.outputs:result>"
MATERIALS = {
    "paint": "#usda 1.0\n" + material(),
    "swollen": displaced(" = 0.5"),
    "wavy": displaced(
        ".connect = </Paint/Waves.outputs:result>",
        shader("Waves", "LookdevExpression", *WAVES, "float outputs:result"),
        image("Paint"),
    ),
}
SECOND = '    texCoord2f[] primvars:map2 = [(0, 0)] ( interpolation = "constant" )\n'

Make = Callable[..., JobScenes]


def job_text(look: str = "", asset: str = "", width: int = 16, file: str = "cube.usda") -> str:
    keys = {"asset": f'{{ usd = "{file}"{asset} }}', "render": f"{{ resolution = [{width}, {width}] }}"}
    return f'{job_toml(**keys)}[[look]]\nname = "one"\n{look}\n'


@pytest.fixture
def make(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """Return a function that makes the scenes of a job, of a cube with a subdivision scheme."""
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    for name, text in MATERIALS.items():
        (tmp_path / f"{name}.usda").write_text(text)

    def prepared(look: str = "", asset: str = "", width: int = 64, scheme: str = "catmullClark") -> JobScenes:
        (tmp_path / "cube.usda").write_text(CUBE.replace("SCHEME", scheme))
        return build_scenes(parse_job(job_text(look, asset, width), tmp_path / "job.toml"))

    return prepared


def scene_of(prepared: JobScenes, look: str = "one") -> Scene:
    return prepared.scenes[look, "white"]


def faces(scene: Scene) -> int:
    return sum(len(mesh.face_sizes) for mesh in scene.asset.meshes)


@pytest.mark.parametrize("level", [0, 1, 3])
def test_the_job_can_say_how_often_a_cage_is_refined(make: Make, level: int) -> None:
    scene = scene_of(make(asset=f", subdivision = {level}"))
    assert faces(scene) == 6 * 4**level
    assert scene.asset.meshes[0].subdivision is None
    # The limit of a cube's corners is known: each coordinate moves 5/18 of the way to the middle of the cube.
    corner = scene.asset.meshes[0].points.min(axis=0)
    assert (corner > 0.05).all() == (level > 0)


def test_a_cage_is_refined_by_its_size_in_the_frame(make: Make) -> None:
    assert 6 < faces(scene_of(make(width=16))) < faces(scene_of(make(width=512)))


def test_a_mesh_that_is_not_a_cage_stays_as_it_is(make: Make) -> None:
    assert faces(scene_of(make(asset=", subdivision = 3", scheme="none"))) == 6
    assert faces(scene_of(make(scheme="none"))) == 6


def test_the_camera_frames_the_limit_surface(make: Make) -> None:
    """At fill 0.7, the widest pose covers 70 % of the frame."""
    scene = scene_of(make('[[look]]\nname = "two"', width=256))
    points = hull_points(scene.asset.meshes, scene.asset.instances)
    camera = scene.camera
    extents = []
    for angle in np.linspace(0.0, 360.0, 360, endpoint=False):
        right, up, back = camera.orbit(-Pose(float(angle), 0.0).element).frame
        seen = points - camera.orbit(-angle).position
        depth = -(seen @ back)
        extents.append(np.abs(np.stack([seen @ right, seen @ up]) / depth).max(axis=1) / camera.half_width)
    # Points of the refined level; between two poses the extent differs by less than the square of half a degree.
    assert np.max(extents) == pytest.approx(0.7, abs=1e-4)


def test_a_displaced_look_has_a_surface_of_its_own(make: Make) -> None:
    third = '\n[[look]]\nname = "three"\n'
    prepared = make('material = "paint.usda"\n[[look]]\nname = "two"\nmaterial = "swollen.usda"' + third)
    plain, swollen, bare = (scene_of(prepared, name) for name in ("one", "two", "three"))
    assert plain.asset is bare.asset  # looks share the refined asset
    assert swollen.asset.radius == pytest.approx(plain.asset.radius + 0.5, rel=0.05)
    assert plain.camera == swollen.camera  # it frames both assets
    alone = scene_of(make('material = "swollen.usda"'))
    assert alone.asset.digest == swollen.asset.digest
    assert alone.camera == swollen.camera


def test_a_displaced_polygon_mesh_is_refined_first(make: Make) -> None:
    plain = scene_of(make('material = "paint.usda"', scheme="none"))
    swollen = scene_of(make('material = "swollen.usda"', scheme="none"))
    assert faces(plain) == 6
    assert faces(swollen) > 6
    assert faces(scene_of(make('material = "swollen.usda"', ", subdivision = 2", scheme="none"))) == 6 * 4**2


def test_a_displacement_reads_a_uv_set_of_another_name(make: Make) -> None:
    prepared = make('material = "wavy.usda"')
    assert prepared.notes == ("/Cube has no UV set 'st', which looks ask for: 'map1' is read",)
    swollen = scene_of(make('material = "swollen.usda"'))
    assert scene_of(prepared).asset.radius == pytest.approx(swollen.asset.radius, rel=1e-3)


def test_faults_of_what_is_rendered_have_the_place_of_their_look(make: Make, tmp_path: Path) -> None:
    many = CUBE.replace("SCHEME", "none").replace("    texCoord2f", f"{SECOND}    texCoord2f")
    (tmp_path / "many.usda").write_text(many)
    text = job_text('[[look]]\nname = "two"\nmaterial = "wavy.usda"', file="many.usda")
    with pytest.raises(FaultsError) as caught:
        build_scenes(parse_job(text, tmp_path / "job.toml"))
    (fault,) = caught.value.faults
    assert (fault.file, fault.where) == (str(tmp_path / "job.toml"), "look[1]")
    assert "'st'; it has: map1, map2" in fault.what


def test_an_asset_that_no_camera_frames_is_a_fault_of_the_camera(make: Make, tmp_path: Path) -> None:
    job = parse_job(f"{job_toml('paint = paint.usda')}camera.margin = 1.1\n", tmp_path / "job.toml")
    point = replace(load_asset(builtin="plane"), radius=0.0)
    looks = dict.fromkeys([slot.path for slot in point.slots], NEUTRAL_LOOK)
    assigned = {"paint": AssignedAsset(point, looks, frozenset())}
    with pytest.raises(FaultsError, match=r"job\.toml: camera: the asset's bounding radius is 0\.0 m"):
        refine_and_frame(job, assigned, None, {"paint": "look[0]"}, Findings(job))


def test_a_level_that_makes_too_many_faces_is_a_fault(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lookdev.build.refine._MAX_CORNERS", 24 * 4**3)
    assert faces(scene_of(make(asset=", subdivision = 3"))) == 6 * 4**3
    with pytest.raises(FaultsError, match=r"look\[0\]: subdivision = 4 makes 6144 corners of faces; at most 1536"):
        make(asset=", subdivision = 4")


def test_a_time_is_noted_where_nothing_is_animated(make: Make, tmp_path: Path) -> None:
    note = make(asset=", time = 12").notes[0]
    assert re.fullmatch(r".*/cube.usda: time = 12 has no effect: nothing in it is animated", note)
    cube = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    high = [(x, y, 3 * z) for x, y, z in cube]
    moving = f"point3f[] points.timeSamples = {{ 0: {cube}, 10: {high} }}"
    text = re.sub(r"point3f\[\] points = .*", moving, CUBE.replace("SCHEME", "none"))
    (tmp_path / "moving.usda").write_text(text)
    tops = {}
    for time in ("", ", time = 5", ", time = 20"):
        prepared = build_scenes(parse_job(job_text(asset=time, file="moving.usda"), tmp_path / "job.toml"))
        assert not [note for note in prepared.notes if "animated" in note]
        tops[time] = float(scene_of(prepared).asset.meshes[0].points[:, 2].max())
    assert tops == {"": 1.0, ", time = 5": 2.0, ", time = 20": 3.0}
