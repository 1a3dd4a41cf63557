"""What `lookdev inspect` lists of an asset."""

import json
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from usd_text import card, shader, translate, variant_set

from lookdev.arrays import Bytes
from lookdev.errors import AssetError, StageError
from lookdev.inspect.assets import MAX_PARTS_LISTED, Inspection, inspect_file
from lookdev.inspect.pictures import group_names
from lookdev.output.sheet import write_legend
from lookdev.stage import Composition

ROBOT = """#usda 1.0
( defaultPrim = "Robot"
  metersPerUnit = 0.01
  upAxis = "Z" )
def Xform "Robot" ( variants = { string size = "small" }; prepend variantSets = "size" ) {
    SIZES
    def Mesh "Body" (prepend apiSchemas = ["MaterialBindingAPI"]) {
        point3f[] points = [(0, 0, 0), (100, 0, 0), (100, 100, 0), (0, 100, 50)]
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        int[] creaseIndices = [0, 1]
        int[] creaseLengths = [2]
        float[] creaseSharpnesses = [3]
        texCoord2f[] primvars:map1 = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "faceVarying")
        rel material:binding = </Robot/Looks/Lamp>
    }
    def Mesh "Lid" {
        uniform token subdivisionScheme = "none"
        point3f[] points = [(0, 0, 10), (100, 0, 10), (100, 100, 10), (0, 100, 10)]
        int[] faceVertexCounts = [3, 3]
        int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]
        float[] primvars:wear = [0, 1, 0, 1] (interpolation = "vertex")
    }
    GUIDE
    def Volume "Smoke" {}
    def Scope "Looks" {
        def Material "Lamp" {
            token outputs:surface.connect = </Robot/Looks/Lamp/Shader.outputs:surface>
            LAMP
        }
    }
}
"""
SCALED = 'double3 xformOp:scale = ({0}, {0}, {0})\nuniform token[] xformOpOrder = ["xformOp:scale"]'
LAMP = shader("Shader", "UsdPreviewSurface", "color3f inputs:emissiveColor = (1, 1, 1)", "token outputs:surface")
ROBOT = ROBOT.replace("LAMP", LAMP).replace("GUIDE", card("Guide", 'uniform token purpose = "guide"'))
ROBOT = ROBOT.replace("SIZES", variant_set("size", small=SCALED.format(1), large=SCALED.format(2)))


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    file = tmp_path / "robot.usda"
    file.write_text(ROBOT, encoding="utf-8")
    return file


def inspect_one(file: Path, **options: object) -> Inspection:
    return inspect_file(Composition(file, **options))[0]  # type: ignore[arg-type]


def test_parts_counts_and_bounds_are_data_and_a_tree(robot: Path) -> None:
    inspection = inspect_one(robot)
    counts = (inspection.meshes, inspection.instances, inspection.points, inspection.faces, inspection.faces_shown)
    assert counts == (2, 2, 8, 3, 3)
    np.testing.assert_allclose([inspection.minimum, inspection.maximum], [[0, 0, 0], [1, 1, 0.5]], atol=1e-7)
    body, lid = inspection.parts
    assert (body.path, body.faces, body.subdivision) == ("/Robot/Body", 1, "catmullClark (1 crease)")
    assert (body.uv_sets, body.material) == (("map1",), "/Robot/Looks/Lamp")
    assert (lid.subdivision, lid.uv_sets, lid.primvars, lid.material) == ("", (), ("wear",), "")
    lines = inspection.text().splitlines()
    assert lines[0].endswith("1 x 1 x 0.5 m, 2 meshes, 2 instances, 8 points, 3 faces")
    assert lines[2:5] == [
        "Robot",
        "  Body  1 face   catmullClark (1 crease)  uv map1                 /Robot/Looks/Lamp",
        "  Lid   2 faces                           no uv    primvars wear  no material",
    ]
    data = json.loads(json.dumps(inspection.data()))
    assert data["parts"][0]["path"] == "/Robot/Body"
    assert data["materials"][0]["lost"] == list(inspection.materials[0].lost)


def test_what_is_not_rendered_is_listed(robot: Path) -> None:
    inspection = inspect_one(robot)
    assert "/Robot/Smoke" in " ".join(inspection.notes)
    (lamp,) = inspection.materials
    assert lamp.layers == ("UsdPreviewSurface as Disney",)
    (lost,) = lamp.lost
    assert all("emissiveColor" in text for text in (lost, inspection.text()))
    assert "/Robot/Smoke" in inspection.text()


def test_subsets_are_listed_below_their_mesh(robot: Path) -> None:
    subset = """def GeomSubset "part" (prepend apiSchemas = ["MaterialBindingAPI"])
        {
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [1]
            rel material:binding = </Robot/Looks/Lamp>
        }
        float[] primvars:wear"""
    robot.write_text(ROBOT.replace("float[] primvars:wear", subset))
    lines = inspect_one(robot).text().splitlines()[2:6]
    assert [line.partition(" 1 face")[0].rstrip() for line in lines] == ["Robot", "  Body", "  Lid", "    part"]


def test_a_part_has_the_path_of_each_prim_that_shows_it(tmp_path: Path) -> None:
    file = tmp_path / "wheels.usda"
    wheel = """def "{}" ( instanceable = true
        inherits = </Wheel> ) {{
        {}
    }}
    """
    wheels = wheel.format("Left", translate(0, 0, 0)) + wheel.format("Right", translate(200, 0, 0))
    file.write_text(f'#usda 1.0\nclass Xform "Wheel"\n{{\n{card("Lid")}\n}}\n{wheels}')
    (part,) = inspect_one(file).parts
    assert (part.path, part.instances, part.paths) == ("/Left/Lid", 2, ("/Left/Lid", "/Right/Lid"))


def test_variants_and_purposes_decide_what_is_there(robot: Path) -> None:
    assert inspect_one(robot, variants=(("size", "large"),)).maximum == pytest.approx((2.0, 2.0, 1.0))
    inspection, _ = inspect_file(Composition(robot), purposes=("default", "guide"))
    assert [part.path for part in inspection.parts] == ["/Robot/Body", "/Robot/Lid", "/Robot/Guide"]
    with pytest.raises(StageError, match="no variant 'huge'"):
        inspect_one(robot, variants=(("size", "huge"),))
    with pytest.raises(AssetError, match="no surface"):
        inspect_one(robot, prim="/Robot/Looks")


def test_a_part_without_material_shows_its_colour(robot: Path) -> None:
    color = "color3f[] primvars:displayColor = [(1, 0, 0)]\nfloat[] primvars:wear"
    robot.write_text(ROBOT.replace("float[] primvars:wear", color))
    assert inspect_one(robot).text().splitlines()[4].endswith("  displayColor")


def test_a_long_list_is_cut_in_text_only(tmp_path: Path) -> None:
    cards = "".join(card(f"m{i}") for i in range(MAX_PARTS_LISTED + 2))
    file = tmp_path / "many.usda"
    file.write_text(f"#usda 1.0\n{cards}\n", encoding="utf-8")
    inspection = inspect_one(file)
    assert len(inspection.parts) == MAX_PARTS_LISTED + 2
    assert "... and 2 more parts" in inspection.text()


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        (["/Car/Body", "/Car/Wheels/FL"], ["Body", "Wheels/FL"]),
        (["/Car"], ["Car"]),
        ([f"/Car/Bolts/b{i}" for i in range(30)] + ["/Car/Body"], ["Bolts"] * 30 + ["Body"]),
        ([f"/b{i}" for i in range(30)], ["all"] * 30),
    ],
)
def test_parts_of_many_share_colours_by_group(paths: list[str], names: list[str]) -> None:
    assert group_names(paths) == names


def test_a_legend_is_beside_the_picture(tmp_path: Path) -> None:
    picture = np.full((40, 60, 3), 7, np.uint8)

    def render_legend(title: str, *names: str) -> Bytes:
        file = tmp_path / "legend.png"
        write_legend(file, picture, title, [(name, (0.5, 0.0, 0.0)) for name in names], "Raw")
        return np.asarray(oiio.ImageBuf(str(file)).get_pixels(oiio.UINT8))

    names = [f"part {number}" for number in range(4)]
    pixels = render_legend("robot", *names)
    assert (pixels[:40, :60] == 7).all()
    assert pixels.shape[0] > 40  # the list is longer than the picture
    squares = (pixels == (128, 0, 0)).all(axis=-1)
    assert squares[:, 60:].any(axis=1).sum() == 4 * 14
    right = 60 + np.flatnonzero(squares[:, 60:].any(axis=0)).max()
    tops = np.flatnonzero(np.diff(squares.any(axis=1).astype(int)) == 1) + 1

    def changed_region(other: Bytes) -> tuple[int, int, int]:
        """Return the first and last row, and the first column, in which pictures differ."""
        rows, columns = np.nonzero((other != pixels).any(axis=-1))
        return rows.min(), rows.max(), columns.min()

    # The title is above the list, and each name beside its square.
    first, last, left = changed_region(render_legend("lamp", *names))
    assert 0 < first < last < tops[0]
    assert left > 60
    for number, top in enumerate(tops):
        first, last, left = changed_region(render_legend("robot", *names[:number], "gqX", *names[number + 1 :]))
        assert top - 4 <= first < last <= top + 18
        assert left > right
    # A name that is too long is cut, and stays in the picture.
    pixels_of_long_names = render_legend("robot" * 20, "part" * 40, *names[1:])
    assert pixels_of_long_names.shape == pixels.shape
    assert (pixels_of_long_names[:, -4:] == pixels_of_long_names[0, -1]).all()
