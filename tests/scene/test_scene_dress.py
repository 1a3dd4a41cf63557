"""Assignment to parts: parts and their paths, patterns, and meshes that are split without copies."""

import time
from collections.abc import Collection, Mapping

import numpy as np
from hand_made import asset_of, squares

from lookdev.asset import Asset, Slot, load_asset
from lookdev.scene.parts import asset_parts, assign_to_parts, fit_patterns, path_hint

CAR = ["/Car", "/Car/Body", "/Car/Body/red", "/Car/Body/Hood", "/Car/Tires/FL", "/Car/Tires/FR"]


def wheels() -> Asset:
    """Two instances of a wheel, which is a tire and a subset for its rim, and a body."""
    meshes = [squares("/A/Wheel", [0, 1, 1]), squares("/Body", [2])]
    slots = [Slot("/A/Wheel", "/A/Rubber"), Slot("/A/Wheel/rim"), Slot("/Body")]
    return asset_of(meshes, [(0, "/A/Wheel"), (1, "/Body"), (0, "/B/Wheel")], slots)


def paths(asset: Asset) -> list[str]:
    return [part.path for parts in asset_parts(asset).values() for part in parts]


def looks_of_parts(asset: Asset, looks: Mapping[str, str]) -> dict[str, str]:
    """Return the look of each part of an asset, by the looks of its slots."""
    return {part.path: looks[part.slot.path] for parts in asset_parts(asset).values() for part in parts}


def test_a_part_has_the_path_of_its_instance() -> None:
    assert paths(wheels()) == ["/A/Wheel", "/A/Wheel/rim", "/Body", "/B/Wheel", "/B/Wheel/rim"]
    assert [part.slot.material for part in asset_parts(wheels())[0, "/B/Wheel"]] == ["/A/Rubber", None]
    assert paths(load_asset(builtin="shaderball")) == ["/shaderball/body", "/shaderball/base"]


def test_a_mesh_that_is_nowhere_has_parts_too() -> None:
    asset = asset_of([squares("/A", [0]), squares("/B", [1])], [(0, "/A")], [Slot("/A"), Slot("/B")])
    assert paths(asset) == ["/A", "/B"]
    assert assign_to_parts(asset, asset_parts(asset), lambda part: part.path)[1] == {"/A": "/A", "/B": "/B"}


def test_instances_with_equal_choices_stay_one_mesh() -> None:
    asset = wheels()
    assigned, choices = assign_to_parts(asset, asset_parts(asset), lambda part: part.path.rpartition("/")[2])
    assert assigned is asset
    assert choices == {"/A/Wheel": "Wheel", "/A/Wheel/rim": "rim", "/Body": "Body"}


def test_a_mesh_of_which_some_instances_wear_something_else_is_split_without_copies() -> None:
    asset = wheels()
    parts = asset_parts(asset)
    assigned, choices = assign_to_parts(asset, parts, lambda part: "gold" if part.path == "/B/Wheel/rim" else "grey")
    assert looks_of_parts(assigned, choices) == dict.fromkeys(paths(asset), "grey") | {"/B/Wheel/rim": "gold"}
    assert set(choices) == {slot.path for slot in assigned.slots}
    assert [instance.mesh for instance in assigned.instances] == [0, 1, 2]
    assert assigned.slots[3:] == (Slot("/B/Wheel", "/A/Rubber"), Slot("/B/Wheel/rim"))
    wheel, body, split = assigned.meshes
    assert (wheel, body) == asset.meshes
    np.testing.assert_array_equal(split.face_slots, [3, 4, 4])
    for name in ("points", "corner_points", "face_sizes", "normals", "uvs"):
        assert getattr(split, name) is getattr(wheel, name)
    assert assigned.digest != asset.digest
    # Other looks that split the parts in the same way give the same asset.
    assert assign_to_parts(asset, parts, lambda part: part.path == "/B/Wheel/rim")[0].digest == assigned.digest


def test_equal_choices_share_one_split() -> None:
    asset = asset_of([squares("/A/Mesh")], [(0, f"/{name}/Mesh") for name in "ABCD"], [Slot("/A/Mesh")])
    assigned, choices = assign_to_parts(asset, asset_parts(asset), lambda part: part.path in ("/B/Mesh", "/D/Mesh"))
    assert [instance.mesh for instance in assigned.instances] == [0, 1, 0, 1]
    assert choices == {"/A/Mesh": False, "/B/Mesh": True}


PATTERNS: dict[str, Collection[str]] = {
    "/Car/Body": {"/Car/Body", "/Car/Body/red", "/Car/Body/Hood"},
    "/Car/Bod": (),
    "/Car": CAR,
    "*": CAR,
    "/": (),
    "/Car/Body/*": {"/Car/Body/red", "/Car/Body/Hood"},
    "/Car/*/F?": {"/Car/Tires/FL", "/Car/Tires/FR"},
    "*/[FG]L": {"/Car/Tires/FL"},
    "*/Tir*": {"/Car/Tires/FL", "/Car/Tires/FR"},
    "/car*": (),
}


def test_a_pattern_fits_prims_and_what_is_below_them() -> None:
    for pattern, paths in PATTERNS.items():
        fit = fit_patterns([pattern], CAR)
        assert (fit.first.keys(), fit.unmatched) == (set(paths), () if paths else (0,)), pattern


def test_the_first_pattern_that_fits_counts() -> None:
    fits = fit_patterns(["/Car/Body/Hood", "/Car/Body", "/Nothing", "/Car/Body/*", "/Car"], CAR)
    assert fits.first == dict(zip(CAR, (4, 1, 1, 0, 4, 4), strict=True))
    assert fits.unmatched == (2,)  # a pattern fits also where an earlier one is first


def test_a_collection_fits_its_members_alone() -> None:
    collections = {"/Car.collection:paint": ["/Car/Body", "/Car/Tires/FL", "/Elsewhere"], "/Car.collection:no": []}
    fits = fit_patterns(["/Car/Tires/*", *collections, "/Car/Body/red"], CAR, collections)
    assert fits.first == {"/Car/Body": 1, "/Car/Body/red": 3, "/Car/Tires/FL": 0, "/Car/Tires/FR": 0}
    assert fits.unmatched == (2,)


HINTS = {
    "/Car/Tire": "/Car/Tires", "/Car/Tyres/FL": "/Car/Tires", "/Cra/Body": "/Car", "Car": "/Car",
    "Hood": "/Car/Body/Hood", "/car/body/RED": "/Car/Body/red", "/Car/Body/": "/Car/Body", "</Car/Body>": "/Car/Body",
    "Car/Tires/FL": "/Car/Tires/FL",
}  # fmt: skip


def test_the_hint_names_the_paths_near_a_pattern() -> None:
    for pattern, path in HINTS.items():
        assert path_hint(pattern, CAR) == f"did you mean '{path}'?", pattern
    assert path_hint("/Car/Tires/Rear*", CAR) == "known: /Car/Tires/FL, /Car/Tires/FR"
    assert path_hint("*wheel", CAR) == path_hint("/", CAR) == "known: /Car"


def test_a_hint_is_short() -> None:
    hint = path_hint("/Car/x", [f"/Car/Part{number:03}" for number in range(500)])
    assert hint == "known: " + ", ".join(f"/Car/Part{number:03}" for number in range(8)) + ", ... (500)"


def test_many_parts_and_patterns_take_little_time() -> None:
    """5,000 parts take an eighth of a second; the limit is ten times that. Quadratic work would take many seconds."""
    paths = [f"/World/Group{number // 25}/Mesh{number}" for number in range(5_000)]
    meshes = [squares(path, [slot]) for slot, path in enumerate(paths)]
    asset = asset_of(meshes, list(enumerate(paths)), [Slot(path) for path in paths])
    start = time.thread_time()
    parts = asset_parts(asset)
    first = fit_patterns([f"/World/Group{number}?" for number in range(0, 50)], paths).first
    assigned, choices = assign_to_parts(asset, parts, lambda part: first.get(part.path))
    assert time.thread_time() - start < 1.5
    assert len(first) == 4_750  # all but the groups 0 to 9
    assert len(choices) == 5_000
    assert assigned is asset
