"""The table of `lookdev.brdf.reflectance` agrees with the script that makes it."""

from __future__ import annotations

import json

import numpy as np
import pytest

from lookdev.brdf.rational import Rational
from lookdev.brdf.reflectance import DATA
from lookdev.closures.reflectance import make_table

TABLE = json.loads(DATA.read_text())


@pytest.mark.parametrize("name", ["whole", "cosine"])
def test_the_table_is_that_of_the_script(name: str) -> None:
    made = make_table()[name]
    assert made["residual"]["largest"] == pytest.approx(TABLE[name]["residual"]["largest"], rel=0.02)
    x, y = np.meshgrid(np.linspace(0.0, 1.0, 33), np.linspace(0.001, 1.0, 33))
    stored, again = (Rational(each["numerator"], each["denominator"])(x, y) for each in (TABLE[name], made))
    assert np.isfinite(np.asarray(stored)).all()
    np.testing.assert_allclose(stored, again, atol=1e-4)
