"""Parameters that follow another one where they are not given."""

import numpy as np
import pytest

from lookdev.brdf import MODELS, complete_parameters
from lookdev.brdf.parameters import with_followers

FOLLOWERS = [
    (model, parameter.name, parameter.follows)
    for model, record in MODELS.items()
    for parameter in record.parameters.values()
    if parameter.follows
]


@pytest.mark.parametrize(("model", "name", "followed"), FOLLOWERS)
def test_a_follower_is_as_what_it_follows(model: str, name: str, followed: str) -> None:
    known = MODELS[model].parameters
    for shared in ("kind", "default", "hard", "choices"):
        assert getattr(known[name], shared) == getattr(known[followed], shared)
    # It stands after it, as sockets of node groups need.
    assert list(known).index(name) > list(known).index(followed)
    given = 0.5 if known[name].kind == "float" else (0.5, 0.25, 0.75)
    np.testing.assert_array_equal(complete_parameters(model, {followed: given})[name], given)
    usual = complete_parameters(model, {name: given})
    np.testing.assert_array_equal(usual[name], given)
    np.testing.assert_array_equal(usual[followed], known[followed].default)


def test_what_is_given_is_kept() -> None:
    known = MODELS["pixar"].parameters
    assert with_followers(known, {"ior": 2.0}) == {"ior": 2.0}
    given = {"specularConeScale": "a", "refractionConeScale": "b"}
    assert with_followers(known, given) == given | {"specularTransmissionConeScale": "a"}
