"""Every kind of plot: its figure, and its numbers, which equal those of the models."""

import csv
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from lookdev.brdf import MODELS, evaluate
from lookdev.brdf.angles import half_difference, spherical_direction
from lookdev.brdf.fresnel import conductor_fresnel
from lookdev.errors import LookdevError
from lookdev.plotting import KINDS, Plot, PlotOptions, draw, model_subject
from lookdev.plotting.sampling import chi_square

PLASTIC = model_subject(MODELS["disney"], {"roughness": 0.4, "baseColor": (0.6, 0.2, 0.1)}, "plastic")
WHITE = model_subject(MODELS["lambert"], {"reflectance": (1.0, 1.0, 1.0)}, "white")
GLASS = model_subject(MODELS["glass"], {}, "glass")
SUBJECTS = {"difference": (PLASTIC, WHITE)}


def draw_plot(kind: str, *subjects: object, **options: object) -> Plot:
    return draw(kind, subjects or SUBJECTS.get(kind, (PLASTIC,)), PlotOptions(**options))  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_has_a_figure_and_finite_numbers(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lookdev.plotting.sampling._SAMPLES", 1 << 14)
    plot = draw_plot(kind, size=6 if kind == "albedo" else 16)
    assert isinstance(plot.figure, Figure)
    (length,) = {len(column) for column in plot.columns.values()}
    assert all(np.isfinite(column).all() or name.startswith("difference") for name, column in plot.columns.items())
    plot.write(tmp_path / "plot.csv")
    with (tmp_path / "plot.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == length
    name = next(reversed(plot.columns))
    assert [float(row[name]) for row in rows] == pytest.approx(plot.columns[name].tolist(), nan_ok=True, rel=1e-15)


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_the_same_plot_is_the_same_file(suffix: str, tmp_path: Path) -> None:
    first, second = (tmp_path / f"{name}{suffix}" for name in "ab")
    for file in (first, second):
        draw_plot("retro", size=16).write(file)
    assert first.read_bytes() == second.read_bytes()
    assert first.stat().st_size > 2000


def test_another_suffix_writes_nothing(tmp_path: Path) -> None:
    with pytest.raises(LookdevError, match=r"plot\.gif: .*\.png"):
        draw_plot("retro", size=8).write(tmp_path / "plot.gif")
    assert not list(tmp_path.iterdir())


def test_half_and_difference_angles_are_those_of_the_directions() -> None:
    rng = np.random.default_rng(5)
    h, d, phi = *rng.uniform(0.0, 0.5 * np.pi, (2, 200)), rng.uniform(0.0, np.pi, 200)
    wo, wi = half_difference(h, d, phi)
    half = wo + wi
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    assert np.arccos(half[:, 2]) == pytest.approx(h, abs=1e-7)
    assert np.arccos((wi * half).sum(axis=-1)) == pytest.approx(d, abs=1e-7)


def test_a_slice_has_f_and_is_black_below_the_horizon() -> None:
    columns = draw_plot("slice", size=32).columns
    h, d = (np.radians(columns[f"theta_{name} (degrees)"]) for name in "hd")
    wo, wi = half_difference(h, d, 0.5 * np.pi)
    f = np.stack([columns[f"plastic.{name}"] for name in "rgb"], axis=-1)
    assert np.array_equal(f, evaluate(PLASTIC.bsdf, wo, wi))
    # At 90 degrees of phi_d both elevations are alike, and cos theta = cos theta_h cos theta_d is above 0.
    assert f.min() > 0.0
    columns = draw_plot("slice", size=32, phi=0.0).columns
    lower = columns["theta_h (degrees)"] + columns["theta_d (degrees)"]
    # At 90 degrees exactly, rounding decides.
    assert not columns["plastic.g"][lower > 90.1].any()
    assert columns["plastic.g"][lower < 89.9].all()


def test_the_albedo_of_white_is_one_and_its_error_is_in_the_numbers() -> None:
    columns = draw_plot("albedo", WHITE, size=4).columns
    assert np.all(np.abs(columns["white"] - 1.0) <= columns["white error"] + 1e-9)


def test_retro_and_cartesian_meet_where_both_directions_are_one() -> None:
    retro = draw_plot("retro", size=91).columns
    w = spherical_direction(np.radians(retro["theta (degrees)"][:80]), 0.5 * np.pi)
    assert retro["plastic"][:80] == pytest.approx(evaluate(PLASTIC.bsdf, w, w) @ (0.2126, 0.7152, 0.0722))
    along = draw_plot("cartesian", size=81, theta=0.0, limit=80.0).columns
    w = spherical_direction(np.radians(along["theta_h (degrees)"]))
    assert along["plastic"] == pytest.approx(evaluate(PLASTIC.bsdf, w, w) @ (0.2126, 0.7152, 0.0722))


def test_theta_i_is_zero_along_the_normal_and_negative_on_the_views_side() -> None:
    columns = draw_plot("cartesian", axis="theta_i", theta=30.0, size=181, limit=90.0).columns
    peak = columns["theta_i (degrees)"][np.argmax(columns["plastic"][20:-20]) + 20]
    assert 25.0 < peak < 60.0


def test_fresnel_of_glass_is_that_of_the_equations() -> None:
    columns = draw_plot("fresnel", GLASS, size=46).columns
    cosine = np.cos(np.radians(columns["theta_d (degrees)"][:-1]))
    assert columns["glass"][:-1] == pytest.approx(np.asarray(conductor_fresnel(cosine, 1.5, 0.0)), rel=1e-12)


def test_fresnel_of_a_surface_rises_as_schlicks_curve_where_shadowing_does_not_matter() -> None:
    columns = draw_plot("fresnel", size=91).columns
    within = (columns["theta_d (degrees)"] >= 45.0) & (columns["theta_d (degrees)"] <= 80.0)
    assert columns["plastic"][within].mean() == pytest.approx(1.0)
    assert columns["schlick"][within].mean() == pytest.approx(1.0)
    assert columns["plastic"][0] == 0.0


def test_chi_square_accepts_the_models_samples_and_refuses_others() -> None:
    wo = spherical_direction(np.radians(40.0))
    rng = np.random.default_rng(3)
    z = np.sqrt(rng.random(1 << 16))
    cosine = spherical_direction(np.arccos(z), 2.0 * np.pi * rng.random(len(z)))
    good, bad = (chi_square(subject.bsdf, wo, cosine, len(z)) for subject in (WHITE, PLASTIC))
    assert good.resolved
    assert bad.resolved
    # One run in a thousand of right samples is below the first, whose seed is fixed.
    assert good.p > 1e-3
    assert bad.p < 1e-12


def test_a_sphere_under_a_light_has_lamberts_law() -> None:
    columns = draw_plot("sphere", WHITE, size=16, theta=0.0).columns
    x, y = ((columns[name] + 0.5) / 8.0 - 1.0 for name in ("column", "row"))
    assert columns["white.point.g"] == pytest.approx(np.sqrt(1.0 - x * x - y * y), abs=1e-12)


def test_the_difference_of_one_and_itself_is_nothing() -> None:
    assert not draw_plot("difference", PLASTIC, PLASTIC, size=16).columns["difference of cube roots"].any()


@pytest.mark.parametrize(
    ("kind", "count", "options", "message"),
    [
        ("slcie", 1, {}, "did you mean 'slice'"),
        ("slice", 1, {"scale": "log"}, "slice has no --scale"),
        ("difference", 1, {}, "two would be right"),
        ("retro", 9, {}, "1 to 8 would be right"),
        ("retro", 1, {"scale": "lgo"}, "did you mean 'log'"),
        ("retro", 1, {"limit": 91.0}, "0.01 to 90"),
        ("retro", 1, {"size": 2}, "4 to 2048"),
        ("retro", 1, {"theta": 3.0}, "retro has no --theta"),
    ],
)
def test_a_plot_that_cannot_be_is_refused(kind: str, count: int, options: dict[str, object], message: str) -> None:
    with pytest.raises(LookdevError, match=message):
        draw(kind, [PLASTIC] * count, PlotOptions(**options))  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", ["slice", "retro", "sampling"])
def test_what_has_no_f_is_refused(kind: str) -> None:
    with pytest.raises(LookdevError, match="glass: scatters along single directions"):
        draw_plot(kind, GLASS, size=8)
    with pytest.raises(LookdevError, match="one of the two kinds would be right"):
        draw_plot("fresnel", GLASS, PLASTIC)
