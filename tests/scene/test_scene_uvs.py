"""UV sets that looks read, and their replacement where a mesh has another set, or none."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hand_made import asset_of, look, squares

from lookdev.asset import Asset, Mesh, Slot
from lookdev.material import Bump, Coordinates, Displacement, Formula, Layer, Look, Primvar, Texture
from lookdev.material.expression import parse
from lookdev.scene.uvs import add_missing_uvs, look_uvs, missing_primvar_notes


def texture(st: str, channel: str = "rgb") -> Texture:
    return Texture(Path("map.png"), channel, "raw", st=st)  # type: ignore[arg-type]


def one(mesh: Mesh) -> Asset:
    return asset_of([mesh], [(0, "/A")], [Slot("/A")])


def three(meshes: list[Mesh]) -> Asset:
    return asset_of(meshes, [(0, "/A"), (1, "/B"), (2, "/C")], [Slot("/A"), Slot("/B"), Slot("/C")])


def test_the_sets_of_a_look_are_those_of_all_that_varies_in_it() -> None:
    formula = Formula(parse("a * b[0]"), {"a": texture("e", "r"), "b": Coordinates("f")}, {"a": "float", "b": "color"})
    inputs = {"baseColor": texture("a"), "roughness": texture("b", "r"), "normal": Bump(texture("c", "r"))}
    layers = (Layer("Base", "disney", inputs), Layer("Top", "disney", {"metallic": formula}, texture("d", "r")))
    displaced = Look("all", layers, displacement=Displacement(texture("g", "r")))
    assert look_uvs(displaced) == ("a", "b", "c", "e", "f", "d", "g")
    assert look_uvs(look("plain", roughness=0.5)) == ()


def test_a_set_that_is_there_is_read_without_a_note() -> None:
    asset = one(squares("/A", uvs=("st", "map1"), default_uv="st"))
    assert add_missing_uvs(asset, {"/A": look("x", baseColor=texture("map1"))}) == (asset, ())


@pytest.mark.parametrize(("sets", "default"), [(("map1",), "map1"), (("st", "map2"), "st")])
def test_the_default_set_stands_for_one_that_is_not_there(sets: tuple[str, ...], default: str) -> None:
    mesh = squares("/A", uvs=sets, default_uv=default)
    asset = one(mesh)
    result, notes = add_missing_uvs(asset, {"/A": look("x", baseColor=texture("uv"))})
    assert notes == (f"/A has no UV set 'uv', which looks ask for: '{default}' is read",)
    assert list(result.meshes[0].uvs) == [*sets, "uv"]
    assert result.meshes[0].uvs["uv"] is mesh.uvs[default]
    assert result.meshes[0].points is mesh.points
    assert result.digest != asset.digest


def test_a_note_counts_the_meshes() -> None:
    asset = three([squares(f"/{name}", [slot], ("map1",), "map1") for slot, name in enumerate("ABC")])
    x, y = look("x", baseColor=texture("st")), look("y", baseColor=texture("st"))
    _, notes = add_missing_uvs(asset, {"/A": x, "/B": y, "/C": x})
    assert notes == ("/A and 2 more have no UV set 'st', which looks ask for: 'map1' is read",)


@pytest.mark.parametrize("sets", [(), ("map1", "map2")])
def test_a_set_that_nothing_can_stand_for_stays_missing(sets: tuple[str, ...]) -> None:
    asset = one(squares("/A", uvs=sets))
    assert add_missing_uvs(asset, {"/A": look("x", baseColor=texture("st"))}) == (asset, ())


def test_the_assets_own_look_reads_zero_on_a_mesh_without_any() -> None:
    looks = {"/A": look("x", baseColor=texture("st"))}
    result, notes = add_missing_uvs(one(squares("/A", uvs=())), looks, bound=["/A"])
    assert notes == ("/A has no UV set 'st', which looks ask for: nor another; textures are read at (0, 0)",)
    np.testing.assert_array_equal(result.meshes[0].uvs["st"], np.zeros((4, 2), np.float32))
    candidates = one(squares("/A", uvs=("map1", "map2")))
    assert add_missing_uvs(candidates, {"/A": look("x", baseColor=texture("st"))}, bound=["/A"]) == (candidates, ())


def test_a_look_of_the_job_beside_it_is_not_given_zero() -> None:
    asset = asset_of([squares("/A", [0, 1], uvs=())], [(0, "/A")], [Slot("/A"), Slot("/A/part")])
    asking, plain = look("x", baseColor=texture("st")), look("y", roughness=0.25)
    assert add_missing_uvs(asset, {"/A": asking, "/A/part": asking}, bound=["/A"]) == (asset, ())
    assert add_missing_uvs(asset, {"/A": asking, "/A/part": plain}, bound=["/A"])[1]


def test_primvars_that_meshes_lack_are_noted_once() -> None:
    wear, hue = Primvar("worn", 0.5), Primvar("hue", (1.0, 0.0, 0.0))
    formula = Formula(parse("a"), {"a": wear}, {"a": "float"})
    meshes = [replace(squares(f"/{name}", [slot]), primvars={}) for slot, name in enumerate("ABC")]
    meshes[1] = replace(meshes[1], primvars={"worn": np.zeros(meshes[1].corner_points.shape, np.float32)})
    asset = three(meshes)
    reads = look("x", baseColor=hue, roughness=formula)
    assert missing_primvar_notes(asset, {"/A": reads, "/B": look("y", roughness=wear), "/C": reads}) == (
        "/A and 1 more have no primvar 'hue', which looks ask for: its fallback is read",
        "/A and 1 more have no primvar 'worn', which looks ask for: its fallback is read",
    )
    assert missing_primvar_notes(asset, dict.fromkeys(("/A", "/B", "/C"), look("plain", roughness=0.5))) == ()
