"""Parameters that have the value of another parameter where they are not given."""

import numpy as np
import pytest

from lookdev.brdf import MODELS, complete_parameters
from lookdev.brdf.parameters import add_followers

FOLLOWERS = [
    (model, parameter.name, parameter.follows)
    for model, record in MODELS.items()
    for parameter in record.parameters.values()
    if parameter.follows
]


@pytest.mark.parametrize(("model", "name", "followed"), FOLLOWERS)
def test_a_follower_is_as_what_it_follows(model: str, name: str, followed: str) -> None:
    parameters = MODELS[model].parameters
    for shared in ("kind", "default", "hard", "choices"):
        assert getattr(parameters[name], shared) == getattr(parameters[followed], shared)
    # The follower comes later, as sockets of node groups need.
    assert list(parameters).index(name) > list(parameters).index(followed)
    inputs = 0.5 if parameters[name].kind == "float" else (0.5, 0.25, 0.75)
    np.testing.assert_array_equal(complete_parameters(model, {followed: inputs})[name], inputs)
    usual = complete_parameters(model, {name: inputs})
    np.testing.assert_array_equal(usual[name], inputs)
    np.testing.assert_array_equal(usual[followed], parameters[followed].default)


def test_what_is_given_is_kept() -> None:
    parameters = MODELS["pixar"].parameters
    assert add_followers(parameters, {"ior": 2.0}) == {"ior": 2.0}
    inputs = {"specularConeScale": "a", "refractionConeScale": "b"}
    assert add_followers(parameters, inputs) == inputs | {"specularTransmissionConeScale": "a"}
