"""Links against USD's own membership query."""

from itertools import product
from pathlib import Path

import pytest
from pxr import Sdf, Usd, UsdLux
from rig_files import rig, write_rig

from lookdev.light.emission import LightLink

PATHS = ("/A", "/A/B", "/A/B/E", "/A/B/C", "/A/B/C/D", "/A/B/C/D/F", "/A/Q", "/AB", "/Z/Y")
COLLECTION = """
def SphereLight "Lamp"
{{
    uniform bool collection:lightLink:includeRoot = {root}
    uniform token collection:lightLink:expansionRule = "{rule}"
    rel collection:lightLink:includes = [</A>, </Rig/Set.collection:some>]
    rel collection:lightLink:excludes = [</A/B/C>, </A/Q.points>]
}}
def "Set" (prepend apiSchemas = ["CollectionAPI:some"])
{{
    uniform token collection:some:expansionRule = "{nested}"
    rel collection:some:includes = [</A/B>, </A/B/C/D>]
}}
"""
RULES = ("expandPrims", "explicitOnly", "expandPrimsAndProperties")


@pytest.mark.parametrize(("root", "rule", "nested"), list(product((0, 1), RULES, RULES)))
def test_a_link_includes_what_usd_includes(tmp_path: Path, root: int, rule: str, nested: str) -> None:
    text = COLLECTION.format(root=root, rule=rule, nested=nested)
    link = rig(tmp_path, text).lights[0].emission.light_link
    assert link is not None
    stage = Usd.Stage.Open(str(write_rig(tmp_path / "again.usda", text)))
    collection = UsdLux.LightAPI(stage.GetPrimAtPath("/Rig/Lamp")).GetLightLinkCollectionAPI()
    query = collection.ComputeMembershipQuery()
    included = [path for path in PATHS if query.IsPathIncluded(Sdf.Path(path))]
    assert [path for path in PATHS if link.includes(path)] == included
    assert 0 < len(included) < len(PATHS)


def test_without_a_rule_nothing_is_included() -> None:
    assert not LightLink(()).includes("/A")
    assert not LightLink((("/", "exclude"), ("/A", "explicitOnly"))).includes("/A/B")
    assert LightLink((("/", "expandPrims"),)).includes("/A")
