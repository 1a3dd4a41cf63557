from collections.abc import Callable

import numpy as np
import pytest

from lookdev.arrays import Floats
from lookdev.light.dome.warp import BilinearWarp, lookup

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
NODES, WEIGHTS = 0.5 + 0.5 * NODES, 0.5 * WEIGHTS


def noise(height: int, width: int) -> Floats:
    return np.random.default_rng([height, width]).uniform(0.5, 1.5, (height, width))


def changed(places: object, factor: float) -> Floats:
    values = noise(8, 16)
    values[places] *= factor  # type: ignore[index]
    return values


MAPS = {
    "even": np.full((8, 16), 3.0),
    "sun": changed((2, 11), 1e3),
    "lone sun": np.eye(8, 16, 5),
    "poles": changed([0, -1], 20.0),
    "seam": changed((slice(None), [0, -1]), 50.0),
    "dark rows": changed([0, 3, 4, -1], 0.0),
    "dark texels": noise(8, 16) * (noise(8, 16) > 1.1),
    "dark columns": changed((slice(None), [0, 5, 6, 7]), 0.0),
    "odd": noise(5, 7),
    "1 x 1": noise(1, 1),
    "2 x 1": noise(2, 1),
    "1 x 2": noise(1, 2),
}


def looked_up(values: Floats, x: Floats, y: Floats) -> Floats:
    x, y = np.broadcast_arrays(x, y)
    return lookup(values[..., None], np.stack([x, 1.0 - y], axis=-1))[..., 0]


def density(values: Floats, x: Floats, y: Floats) -> Floats:
    """Return the look-up times the solid angle of the map's unit square."""
    return looked_up(values, x, y) * 2.0 * np.pi**2 * np.sin(np.pi * y)


def cumulative(function: Callable[[Floats], Floats], knots: int, end: Floats) -> Floats:
    """Integrate a function (..., n) of positions (n,) or (..., n), smooth between its knots, from 0 to `end`."""
    edges = np.arange(knots) / knots
    places = (edges[:, None] + NODES / knots).ravel()
    whole = (function(places).reshape(*function(places).shape[:-1], knots, -1) * WEIGHTS).sum(axis=-1) / knots
    before = np.concatenate([np.zeros((*whole.shape[:-1], 1)), np.cumsum(whole, axis=-1)], axis=-1)
    piece = np.minimum((end * knots).astype(int), knots - 1)
    width = end - piece / knots
    rest = (function((piece / knots)[:, None] + width[:, None] * NODES) * WEIGHTS).sum(axis=-1) * width
    reached = before[piece] if before.ndim == 1 else np.take_along_axis(before, piece[:, None], axis=-1)[:, 0]
    return np.asarray(reached + rest)


def of_rows(values: Floats) -> Callable[[Floats], Floats]:
    """Return the density of y: the mean along each row, which for a linear function is the mean of its texels."""
    x = (np.arange(values.shape[1]) + 0.5) / values.shape[1]
    return lambda y: density(values, x, y[..., None]).mean(axis=-1)


def test_lookup_by_hand() -> None:
    table = np.array([[[1.0], [2.0]], [[3.0], [5.0]]])
    cases = {
        (0.25, 0.75): 1.0,  # the centre of row 0, column 0
        (0.75, 0.25): 5.0,
        (0.5, 0.5): 11 / 4,  # between all four
        (0.0, 0.75): 1.5,  # the seam: half of the last column, half of the first
        (1.0, 0.75): 1.5,
        (0.25, 1.0): 1.0,  # clamped at the zenith
        (0.75, 0.0): 5.0,
        (0.375, 0.75): 1.25,
        (0.25, 0.625): 1.5,
        (1.25, 0.75): 1.0,  # u is periodic
    }
    np.testing.assert_allclose(lookup(table, list(cases))[:, 0], list(cases.values()), atol=1e-15)


@pytest.mark.parametrize("name", MAPS)
def test_places_are_where_the_distribution_reaches_the_points(name: str) -> None:
    values = MAPS[name]
    rng = np.random.default_rng(1)
    # Sobol points come near 0 and 1: near the poles, and near the ends of rows.
    near = 2.0 ** -rng.uniform(1.0, 30.0, (50, 2))
    u = np.concatenate([rng.random((300, 2)), near, 1.0 - near])
    warp = BilinearWarp(values)
    x, y = warp.coordinates(u).T
    height, width = values.shape
    down = cumulative(of_rows(values), 2 * height, y) / warp.integral
    # Newton's first guess is worst where rows are 22 degrees high and one of them is dark.
    np.testing.assert_allclose(down, u[:, 1], atol=1e-8 if "dark" in name else 1e-12)
    # Rows begin and end at the centre of their first texel: 0 and 1 are the same position.
    start = 0.5 / width

    def across(position: Floats) -> Floats:
        return looked_up(values, start + position, y[:, None])

    along = cumulative(across, width, (x - start) % 1.0) / cumulative(across, width, np.ones(len(y)))
    np.testing.assert_allclose((along - u[:, 0] + 0.5) % 1.0, 0.5, atol=1e-12)


@pytest.mark.parametrize("values", MAPS.values(), ids=MAPS)
def test_no_place_is_dark_or_off_the_map(values: Floats) -> None:
    warp, ends = BilinearWarp(values), np.array([0.0, 0.5, 1.0 - 2.0**-53])
    x, y = warp.coordinates(np.random.default_rng(3).random((100_000, 2))).T
    assert (looked_up(values, x, y) > 0.0).all()
    places = warp.coordinates(np.stack(np.meshgrid(ends, ends), axis=-1).reshape(-1, 2))
    assert ((places >= 0.0) & (places <= 1.0)).all()


@pytest.mark.parametrize("shape", [(8, 16), (1, 1)])
def test_a_black_map_is_sampled_evenly(shape: tuple[int, int]) -> None:
    black = BilinearWarp(np.zeros(shape))
    np.testing.assert_allclose(black.integral, 4.0 * np.pi, rtol=1e-14)
    u = np.random.default_rng(4).random((1000, 2))
    u[0, 1] = 0.0  # the pole, where the density of a latitude is 0
    x, y = black.coordinates(u).T
    np.testing.assert_allclose(x, (u[:, 0] + 0.5 / shape[1]) % 1.0, atol=1e-12)
    np.testing.assert_allclose(np.cos(np.pi * y), 1.0 - 2.0 * u[:, 1], atol=1e-12)
