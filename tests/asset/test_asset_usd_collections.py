"""Which parts a collection includes, by USD's rules, and what a wrong path of one is reported as."""

import pytest
from pxr import Sdf, Usd

from lookdev.asset.usd.collections import collection_members, is_collection
from lookdev.errors import AssetError

pytestmark = pytest.mark.both_pythons
STAGE = """#usda 1.0
def Xform "Car" (
    prepend apiSchemas = ["CollectionAPI:all", "CollectionAPI:named", "CollectionAPI:nested", "CollectionAPI:none",
        "CollectionAPI:glob", "CollectionAPI:self", "CollectionAPI:off:hand"]
)
{
    rel collection:all:includes = </Car>
    rel collection:all:excludes = </Car/Tires/FL>
    uniform token collection:named:expansionRule = "explicitOnly"
    rel collection:named:includes = [</Car/Body>, </Car/Tires>]
    rel collection:nested:includes = [</Car.collection:named>, </Car/Tires/FL>]
    uniform pathExpression collection:glob:membershipExpression = "/Car/Tires/*R //Hood"
    rel collection:self:includes = [</Car.collection:self>, </Car/Body>]
    rel collection:off:hand:includes = </Car/Tires/FL/Hub>
    def Mesh "Body" {
        def GeomSubset "Hood" { }
    }
    def Xform "Tires"
    {
        def Xform "FL" (instanceable = true; references = </Tire>) { }
        def Xform "FR" (instanceable = true; references = </Tire>) { }
    }
}
class Xform "Tire" {
    def Mesh "Hub" { }
}
"""
PARTS = ["/Car/Body", "/Car/Body/Hood", "/Car/Tires/FL/Hub", "/Car/Tires/FR/Hub"]


@pytest.fixture
def stage() -> Usd.Stage:
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(STAGE)
    return Usd.Stage.Open(layer)


@pytest.mark.parametrize(
    ("name", "members"),
    [
        ("all", {"/Car/Body", "/Car/Body/Hood", "/Car/Tires/FR/Hub"}),
        ("named", {"/Car/Body"}),
        ("nested", {"/Car/Body", "/Car/Tires/FL/Hub"}),
        ("none", set()),
        ("glob", {"/Car/Body/Hood"}),
        ("off:hand", {"/Car/Tires/FL/Hub"}),
    ],
)
def test_members_are_those_of_usd(stage: Usd.Stage, name: str, members: set[str]) -> None:
    assert collection_members(stage, f"/Car.collection:{name}", PARTS) == members


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("/Car.collection:al", r"/Car has no 'al' \(did you mean 'all'\?\)"),
        ("/Car/Body.collection:all", r"/Car/Body has no 'all' \(it has none\)"),
        ("/Cat.collection:all", "it has no prim /Cat"),
        ("Car.collection:all", "it has no prim Car"),
        ("/Car//.collection:all", "it has no prim /Car//"),
        (".collection:all", "it has no prim "),
        ("/Car.collection:", "/Car has no ''"),
        ("/Car.collection:self", "'/Car.collection:self' is not a valid collection: .*circular"),
    ],
)
def test_a_wrong_path_is_reported(stage: Usd.Stage, path: str, message: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert is_collection(path)
    with pytest.raises(AssetError, match=message):
        collection_members(stage, path, PARTS)
    assert capfd.readouterr().err == ""
