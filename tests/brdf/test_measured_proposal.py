"""The sampling tables of measured data: their contents, and that they omit no direction that reflects."""

import numpy as np
import pytest

from lookdev.brdf import complete_parameters, evaluate, model_named
from lookdev.brdf.lobes import DirectionPair
from lookdev.brdf.measured import proposal
from lookdev.brdf.measured.grids import AnisotropicGrid, IsotropicGrid
from lookdev.brdf.measured.proposal import Proposal, make_proposal
from lookdev.brdf.measured.synthetic import anisotropic_samples
from lookdev.brdf.table import NumberTable
from lookdev.brdf.vectors import reflect

CELLS = 8, 8
ROUND = np.ones((16, 8, 12, 3))


@pytest.fixture(autouse=True)
def _few_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(proposal._HALF_VECTOR_CELLS, False, CELLS)
    monkeypatch.setitem(proposal._VIEW_CELLS, False, (4, 1))


@pytest.mark.parametrize("is_anisotropic", [False, True])
def test_the_views_of_a_row_lie_in_its_cell_and_on_both_sides_of_its_middle(is_anisotropic: bool) -> None:
    empty = NumberTable(np.zeros((1, 1)))
    tables = Proposal(empty, empty, empty, empty, empty, np.zeros((1, 3)), is_anisotropic)
    thetas = proposal._VIEW_CELLS[is_anisotropic][0]
    rows = list(proposal._view_cells(is_anisotropic))
    assert len(rows) == np.prod(proposal._VIEW_CELLS[is_anisotropic])
    for row, views in enumerate(rows):
        wo = np.array(views)
        np.testing.assert_allclose(np.linalg.norm(wo, axis=-1), 1.0)
        assert tables._view(wo).tolist() == [row, row]
        places = np.arccos(wo[:, 2]) * thetas / (0.5 * np.pi) % 1.0
        last = row // proposal._VIEW_CELLS[is_anisotropic][1] == thetas - 1  # it ends above the horizon
        np.testing.assert_allclose(places[: 1 if last else 2], [0.25, 0.75][: 1 if last else 2])


def test_f_and_weight_are_of_the_half_vector_with_the_light_above_the_surface() -> None:
    wm = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [-0.8, 0.0, 0.6], [-1.0, 0.0, 0.0], [0.0, 0.96, 0.28]])
    wo = np.array([0.6, 0.0, 0.8])
    f, weight = proposal._evaluate_views(IsotropicGrid(0.7 * ROUND), [wo], wm)
    wi = reflect(np.broadcast_to(wo, wm.shape), wm)
    # The third half vector has the light below the surface, and the fourth is below the view.
    assert (wi[:, 2] > 0.0).tolist() == [True, True, False, False, False]
    valid = np.array([True, True, False, False, False])
    np.testing.assert_allclose(f[0], np.where(valid[:, None], [0.7] * 3, 0.0))
    np.testing.assert_allclose(weight[0], np.where(valid, wi[:, 2] * 4.0 * (wm @ wo), 0.0))
    # A half vector below the view has the light's direction of the opposite half vector.
    assert proposal._evaluate_views(IsotropicGrid(ROUND), [wo], -wm[:2])[1].tolist() == [[0.0, 0.0]]


def test_a_row_of_shares_becomes_a_distribution_and_an_empty_one_an_even_one() -> None:
    result = proposal._cumulative(np.array([[1.0, 0.0, 3.0, 0.0], [0.0, 0.0, 0.0, 0.0]]))
    np.testing.assert_allclose(result, [[0.0, 0.25, 0.25, 1.0, 1.0], [0.0, 0.25, 0.5, 0.75, 1.0]])


def test_cells_beside_a_bright_one_have_a_tenth_of_its_density_in_azimuth(monkeypatch: pytest.MonkeyPatch) -> None:
    """The horizon may cut these cells, and the samples of a cell may all be below it."""
    samples = np.zeros((7, 5, 12, 8, 3))
    samples[:, :, 3:6, 2:4] = 1.0
    monkeypatch.setitem(proposal._HALF_VECTOR_CELLS, True, (16, 16))
    monkeypatch.setitem(proposal._VIEW_CELLS, True, (4, 4))
    tables = make_proposal(AnisotropicGrid(samples))
    parts = tables.azimuth_factor.values  # (views thetas, phis)
    brightest = parts.argmax(axis=1)[:, None]
    for step in (-1, 1):
        beside = np.take_along_axis(parts, (brightest + step) % parts.shape[1], axis=1)
        assert (beside >= 0.1 * (1.0 - 1e-9) * np.take_along_axis(parts, brightest, axis=1)).all()
    assert ((parts > 0.0).sum(axis=1) < parts.shape[1]).any()  # a row in which a cell farther away has none
    np.testing.assert_allclose(parts.mean(axis=1), 1.0)


def test_the_density_where_cells_meet_is_at_least_a_quarter_of_the_mean_beside() -> None:
    met, solid = np.array([0.0, 0.1, 0.0, 0.0, 0.0]), np.array([1.0, 2.0, 3.0, 4.0])
    result = proposal._edge_density(met, np.array([2.0, 0.0, 0.0, 0.4]), solid)
    # At the ends and between cells, the least density is a quarter of the sum of the means on both sides.
    expected = np.array([1.0, 0.5, 0.0, 0.1, 0.2])
    np.testing.assert_allclose(result, expected / (0.5 * (expected[1:] + expected[:-1]) @ solid))
    assert (result[1:-1] > 0.0).sum() == 2
    none = proposal._edge_density(np.zeros(5), np.zeros(4), solid)
    np.testing.assert_allclose(none, 0.1)  # of a view without any highlight every cell is as good


def test_an_even_surface_has_an_even_density_where_no_cell_is_much_brighter_than_the_next() -> None:
    """Densities are per solid angle of half vectors: seen from above, ``4 cos(theta_d) cos(theta_i)`` of each."""
    grid = IsotropicGrid(ROUND + np.linspace(1.0, 0.0, 16)[:, None, None, None])
    tables = make_proposal(grid)
    squares = np.asarray(proposal._edge_sin2(np.arange(CELLS[0] + 1.0), CELLS[0]))
    view = next(proposal._view_cells(False))
    edges = proposal._half_vectors(squares, 0.0, 64, (1, 1))
    f, weight = proposal._evaluate_views(grid, view, edges)
    density, dark = tables.density.values[0], f.mean(axis=-1)[f.mean(axis=-1) > 0.0].min()
    expected = (np.maximum(f.mean(axis=-1) - dark, 0.0) * weight).mean(axis=(0, 2, 3, 4))
    bright = expected > 0.5 * expected.max()
    ratio = density[bright] / expected[bright]
    assert bright.sum() >= 3
    assert np.ptp(ratio) < 0.1 * ratio.mean()


def test_a_highlight_within_a_cell_lifts_the_density_where_the_cell_begins_and_ends() -> None:
    samples = np.zeros((64, 4, 4, 3))
    samples[:20], samples[36:39] = 1.0, 40.0  # the fifth of the eight cells has samples 32 to 39
    grid = IsotropicGrid(samples)
    density = make_proposal(grid).density.values[0]
    view = next(proposal._view_cells(False))
    squares = np.asarray(proposal._edge_sin2(np.arange(CELLS[0] + 1.0), CELLS[0]))

    def mean(places: np.ndarray) -> float:
        f, weight = proposal._evaluate_views(grid, view, places)
        return float((f.mean(axis=-1) * weight).mean())

    within = mean(proposal._half_vectors(squares[4:5], np.diff(squares)[4:5], 64, (64, 1)))
    below = mean(proposal._half_vectors(squares[1:2], 0.0, 64, (1, 1)))
    assert density[4] / density[1] == pytest.approx(0.25 * within / below, rel=0.15)  # a cell has two places inside
    assert density[7] == 0.0


def test_the_directional_albedo_of_an_even_surface_is_pi_f(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(proposal._HALF_VECTOR_CELLS, False, (32, 16))
    tables = make_proposal(IsotropicGrid(0.25 * ROUND * (1.0, 0.5, 0.0)))
    np.testing.assert_allclose(tables.albedo[0] / np.pi, (0.25, 0.125, 0.0), rtol=0.02)
    assert tables.cosine.values[0, 0] == 0.99  # all of it is below the floor
    wo = np.array([[0.1, 0.2, np.sqrt(0.95)]])
    d = DirectionPair.from_directions(wo, np.array([[0.0, 0.6, 0.8]]))
    assert tables.pdf(d)[0] == pytest.approx(0.99 * 0.8 / np.pi, rel=0.02)


@pytest.mark.parametrize("half", [False, True])
def test_synthetic_samples_are_at_the_centres_of_theta_i_theta_o_phi_d_and_phi_i(half: bool) -> None:
    size, cell = (7, 5, 12, 8), (4, 2, 7, 5)
    bsdf = model_named("disney").bsdf(complete_parameters("disney", {"anisotropic": 0.7, "metallic": 0.8}))
    samples = anisotropic_samples(bsdf, size, half=half)
    theta_i, theta_o, turned, phi_i = ((number + 0.5) / count for number, count in zip(cell, size, strict=True))
    turned *= np.pi if half else 2.0 * np.pi
    wi, wo = (
        np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
        for theta, phi in (
            (theta_i * np.pi / 2.0, 2.0 * np.pi * phi_i),
            (theta_o * np.pi / 2.0, 2.0 * np.pi * phi_i + turned),
        )
    )
    assert samples.shape == (*size, 3)
    np.testing.assert_allclose(samples[cell], evaluate(bsdf, wo, wi), rtol=1e-12)
