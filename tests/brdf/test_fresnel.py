"""The exact Fresnel equations against complex arithmetic, an independent implementation, and closed forms."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from film_reference import Floats

from lookdev.brdf.fresnel import conductor_absorptance, conductor_fresnel

ORACLE = Path(__file__).parents[1] / "oracles" / "fresnel.jsonl"


def _oracle() -> tuple[Floats, Floats]:
    """Return the arguments, (5, n), and the reflectances, (n,), of the oracle's cases."""
    cases: list[dict[str, Any]] = [json.loads(line) for line in ORACLE.read_text().splitlines()]
    names = ("eta", "k", "externalIor", "polarisation")
    arguments = [[case["cosTheta"], *(case["params"][name] for name in names)] for case in cases]
    return np.array(arguments).T, np.array([case["F"] for case in cases])


def test_fresnel_agrees_with_the_oracle() -> None:
    arguments, expected = _oracle()
    assert len(expected) == 200
    np.testing.assert_allclose(conductor_fresnel(*arguments), expected, rtol=1e-9, atol=1e-12)


def test_fresnel_survives_float32() -> None:
    arguments = _oracle()[0].astype(np.float32)
    exact = arguments.astype(np.float64)
    got, expected = conductor_fresnel(*arguments), conductor_fresnel(*exact)
    assert got.dtype == np.float32
    # The change by rounding the inputs; it is large at Brewster's angle and at the critical angle.
    rng, change = np.random.default_rng(1), 2.0**-24 * expected
    for _ in range(16):
        moved = exact * (1.0 + 2.0**-24 * rng.choice([-1.0, 1.0], exact.shape))
        change = np.maximum(change, np.abs(conductor_fresnel(*moved) - expected))
    assert (np.abs(got - expected) <= 8.0 * change).all()
    # Total reflection.
    assert (np.asarray(got)[expected == 1.0] == 1.0).all()
    assert np.count_nonzero(expected == 1.0) > 5


def test_fresnel_stays_within_bounds() -> None:
    etas = [1e-6, 0.5, 1.0, 1.0 + 1e-15, 20.0]
    cos_theta, eta, k = np.meshgrid([0.0, 1e-300, 1e-9, 0.5, 1.0], etas, [0.0, 1e-9, 1.0, 20.0])
    reflectance = conductor_fresnel(cos_theta, eta, k)
    assert np.all((reflectance >= 0.0) & (reflectance <= 1.0 + 1e-15))
    np.testing.assert_allclose(reflectance[(cos_theta == 0.0) & (eta != 1.0)], 1.0, rtol=1e-14)
    assert np.all(conductor_fresnel(np.array([0.0, 0.3, 1.0]), 1.0, 0.0) == 0.0)  # air in air


def test_what_is_not_reflected_is_exact_where_it_is_little() -> None:
    rng = np.random.default_rng(2)
    cos_theta, eta, k = rng.uniform(0.0, 1.0, 1000), rng.uniform(0.05, 10.0, 1000), rng.uniform(0.0, 20.0, 1000)
    k[:300] = 0.0
    absorptance = np.asarray(conductor_absorptance(cos_theta, eta, k))
    np.testing.assert_allclose(absorptance, 1.0 - np.asarray(conductor_fresnel(cos_theta, eta, k)), atol=1e-14)
    single = conductor_absorptance(*(values.astype(np.float32) for values in (cos_theta, eta, k)))
    moved = conductor_absorptance(*(values.astype(np.float32).astype(np.float64) for values in (cos_theta, eta, k)))
    beyond = absorptance == 0.0
    assert np.count_nonzero(beyond) > 10  # of total reflection
    np.testing.assert_allclose(single[~beyond], moved[~beyond], rtol=1e-4)
    np.testing.assert_array_equal(np.asarray(single)[beyond], 0.0)
