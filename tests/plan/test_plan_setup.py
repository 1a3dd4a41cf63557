"""Setups: which attributes of meshes the looks can read."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lookdev.asset import load_asset
from lookdev.errors import FaultsError
from lookdev.light import load_environment, prepare_light
from lookdev.material import Layer, Look, Primvar
from lookdev.plan import Setup, make_setup
from lookdev.scene import Sampling, Scene


def setup_of(**inputs: Any) -> Setup:
    """Return the setup of a plane that has a float `wear` and a colour `hue`."""
    plane = load_asset(builtin="plane")
    (mesh,) = plane.meshes
    corners = len(mesh.corner_points)
    primvars = {"wear": np.zeros(corners, np.float32), "hue": np.zeros((corners, 3), np.float32)}
    asset = replace(plane, meshes=(replace(mesh, primvars=primvars),))
    look = Look("gold", (Layer("Base", "disney", inputs),))
    light = prepare_light(load_environment(builtin="white"))
    return make_setup("gold", "white", Scene.of_look(asset, look, light, (8, 8)), Sampling())


def test_primvars_are_read_as_what_they_are_and_absent_ones_as_either() -> None:
    setup = setup_of(roughness=Primvar("wear", 0.5), baseColor=Primvar("hue", (0.5, 0.5, 0.5)))
    assert {binding.attribute for binding in setup.task.shaders[0].attributes} == {"wear", "hue"}
    setup_of(roughness=Primvar("none", 0.5))
    setup_of(baseColor=Primvar("none", (0.5, 0.5, 0.5)))


@pytest.mark.parametrize(
    ("inputs", "fault"),
    [
        ({"roughness": Primvar("hue", 0.5)}, "primvar 'hue' is a colour, the look reads a float"),
        ({"baseColor": Primvar("wear", (0.5, 0.5, 0.5))}, "primvar 'wear' is a float, the look reads a colour"),
    ],
)
def test_a_primvar_of_another_kind_is_a_fault_of_the_part_with_the_look(inputs: dict[str, Primvar], fault: str) -> None:
    with pytest.raises(FaultsError) as caught:
        setup_of(**inputs)
    assert [str(message) for message in caught.value.faults] == [f"plane: /plane, look 'gold': {fault}"]
