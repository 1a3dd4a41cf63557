"""The tables of fits, and of `lookdev.brdf.reflectance`, agree with the scripts that make them, without poles."""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lookdev.brdf.rational import Rational, polynomial
from lookdev.brdf.reflectance import FITS_FILE
from lookdev.closures.fits import closure_fit, closure_table
from lookdev.closures.fitting import FitGoal, make_fits, make_table
from lookdev.closures.rational import Degree, RationalProblem, fit_rational
from lookdev.closures.reflectance import make_table as make_reflectance
from lookdev.closures.setups import FULL, LobeGrid, LobeSetup, coat_setups, highlight_setups, mix_distance

FITS = closure_table()["fits"]
REFLECTANCE = json.loads(FITS_FILE.read_text())
ANY = np.linspace(0.0, 1.0, 101)
# Alpha, and the cosine of a refracted view; of all others, roughness or an alpha from 0.001.
HIGHLIGHTS = np.sin(np.radians(np.linspace(0.25, 54.0, 101))) / np.sqrt(np.log(10.0))
DOMAINS = {"highlight": HIGHLIGHTS, "highlight_cosine": HIGHLIGHTS, "transmitted": HIGHLIGHTS, "clearcoat": 0.1 * ANY}


def test_a_rational_is_recovered() -> None:
    x, y = (values.ravel() for values in np.meshgrid(np.linspace(0, 1, 12), np.linspace(0, 1, 9)))
    expected = Rational([[1.0, -0.5], [0.25]], [[1.0, 0.8], [0.6]])
    problem = RationalProblem(x, y, expected(x, y), np.full(x.size, 0.01))
    fitted = fit_rational(problem, Degree(1, 1, 1), Degree(1, 1, 1))
    np.testing.assert_allclose(fitted(x, y), expected(x, y), rtol=1e-6)


def test_a_step_never_crosses_a_pole() -> None:
    # 1 / (x - 0.5) would fit the target; its pole is within.
    x = np.linspace(0.0, 1.0, 50)
    problem = RationalProblem(x, np.zeros_like(x), 1.0 / (x - 0.5), np.ones_like(x))
    fitted = fit_rational(problem, Degree(1, 0, 1), Degree(1, 0, 1))
    denominator = polynomial(fitted.denominator, x, 0.0)
    assert denominator.min() > 0.0 or denominator.max() < 0.0


@pytest.mark.parametrize("name", FITS)
def test_no_pole_and_no_rounding_in_the_whole_domain(name: str) -> None:
    x, y = np.meshgrid(ANY, DOMAINS.get(name, np.maximum(ANY, 0.001)))
    rational = closure_fit(name)
    wide, narrow = rational(x, y), rational(x.astype(np.float32), y.astype(np.float32))
    assert np.isfinite(wide).all()
    denominator = polynomial(rational.denominator, x, y)
    assert (denominator > 0.0).all()
    assert narrow.dtype == np.float32
    # A tenth of the error of the fits.
    inside = x >= np.cos(np.radians(85.0))
    np.testing.assert_allclose(narrow[inside], wide[inside], rtol=1e-3, atol=1e-5)


@pytest.fixture(scope="module")
def goals() -> dict[str, FitGoal]:
    """Return the goals of the fits of the file, at a few points."""
    grid = LobeGrid(
        FULL.angles[[0, 6, 12, 20]], FULL.roughness[1::5], FULL.gloss[::5], FULL.cones[::4], FULL.iors_minus_one[[1, 3]]
    )
    fits = make_fits(closure_table()["shapes"], grid, load_fit=closure_fit)
    return {name: goal for name, (_, goal) in fits.items()}


@pytest.mark.parametrize("name", FITS)
def test_residuals_are_those_of_the_coefficients(name: str, goals: dict[str, FitGoal]) -> None:
    goal = goals[name]
    error = goal.error(closure_fit(name)(goal.problem.x, goal.problem.y))
    stored = FITS[name]["residual"]
    # These points are a subset of those of the residual.
    assert error.max() <= 1.001 * stored["largest"] + 1e-6
    assert 0.2 * stored["rms"] <= np.sqrt(np.mean(error * error)) <= 3.0 * stored["rms"]


def test_every_fit_is_within_a_hundredth() -> None:
    # Exceptions are wide cones in a refracted view, and smooth surfaces of 2012 at grazing views (docs/models.md).
    largest = {name: entry["residual"]["largest"] for name, entry in FITS.items()}
    assert largest.pop("transmitted_tilt") < 0.02
    assert largest.pop("specular_2012") < 0.012
    assert {name: value for name, value in largest.items() if value > 0.01} == {}


@pytest.mark.parametrize(("name", "setups"), [("clearcoat", coat_setups), ("highlight", highlight_setups)])
def test_the_distances_of_the_table_are_those_of_its_shapes(
    name: str, setups: Callable[[Mapping[str, Any], LobeGrid], list[LobeSetup]]
) -> None:
    shape = closure_table()["shapes"][name]
    grid = replace(FULL, angles=np.array([0.0, 50.0]), gloss=np.array([0.0, 1.0]), cones=np.array([1.0, 10.0, 35.0]))
    distances = [mix_distance(setup) for setup in setups(shape, grid=grid)]
    assert max(distances) <= 1.001 * shape["distance"]["largest"]
    assert 0.3 * shape["distance"]["mean"] <= np.mean(distances) <= 3.0 * shape["distance"]["mean"]


@pytest.mark.proof
def test_the_script_makes_the_table_again() -> None:
    new = make_table()
    assert new["shapes"] == closure_table()["shapes"]
    for name, entry in new["fits"].items():
        # Coefficients differ by the rounding of the linear algebra library.
        np.testing.assert_allclose(entry["residual"]["rms"], FITS[name]["residual"]["rms"], rtol=0.1)


def test_the_reflectance_is_that_of_the_script() -> None:
    for name, new in make_reflectance().items():
        stored_entry = REFLECTANCE[name]
        assert new["residual"]["largest"] == pytest.approx(stored_entry["residual"]["largest"], rel=0.02)
        x, y = np.meshgrid(np.linspace(0.0, 1.0, 33), np.linspace(0.001, 1.0, 33))
        stored, again = (Rational(entry["numerator"], entry["denominator"])(x, y) for entry in (stored_entry, new))
        assert np.isfinite(np.asarray(stored)).all()
        np.testing.assert_allclose(stored, again, atol=1e-4, err_msg=name)
