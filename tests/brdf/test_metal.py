"""Metals by name: their table against the spectra, and the parameters that select them."""

import json

import numpy as np
import pytest

from lookdev.brdf import complete_parameters, conductor, metal_fits, model_named
from lookdev.brdf.conductor import METALS, metal_curve
from lookdev.brdf.metal import INTERFACE, METAL_COLORS, METAL_TABLE_FILE, metal_fresnel, metal_index
from lookdev.brdf.metal_fits import COSINES, band_means, largest_deviation, nearest_index
from lookdev.errors import ModelError

TABLE = json.loads(METAL_TABLE_FILE.read_text())


@pytest.mark.parametrize("name", METALS)
def test_a_metal_reflects_as_its_spectra_do(name: str) -> None:
    curve = np.asarray(metal_curve(name, COSINES))
    for color in METAL_COLORS:
        entry, index = TABLE[name][color], metal_index(name, color)
        reflected = metal_fresnel({key: np.array(value) for key, value in index.items()}, COSINES)
        worst = np.abs(reflected - np.clip(curve, 0.0, 1.0)).max(axis=0)
        # Five digits of eta and k.
        np.testing.assert_allclose(worst, entry["deviation"], atol=3e-5)
        assert max(entry["deviation"]) <= (0.01 if color == "nearest" else 0.11)
        for key, (low, high) in ((key, INTERFACE[key].hard) for key in ("eta", "k")):
            assert np.all((np.array(index[key]) >= low) & (np.array(index[key]) <= high))
    np.testing.assert_allclose([max(-curve.min(), 0.0), max(curve.max() - 1.0, 0.0)], TABLE[name]["outside"], atol=1e-6)


def test_the_table_and_the_data_have_all_metals_and_no_other() -> None:
    assert list(TABLE) == list(METALS)
    assert set(conductor._load_spectra()) == set(METALS)


@pytest.mark.parametrize("index", [(0.2, 3.0), (3.0, 3.3), (1.5, 0.0), (0.05, 20.0)])
def test_the_nearest_index_of_a_curve_is_its_own(index: tuple[float, float]) -> None:
    target = np.asarray(metal_fresnel({"eta": np.array(index[:1]), "k": np.array(index[1:])}, COSINES))[:, 0]
    assert largest_deviation(nearest_index(target), target) < 1e-7


def test_the_table_is_derived_from_the_spectra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metal_fits, "METALS", ["brass"])
    ((name, table),) = metal_fits.make_table().items()
    for color in METAL_COLORS:
        for key, value in TABLE[name][color].items():
            # Five digits.
            np.testing.assert_allclose(table[color][key], value, rtol=2e-5, err_msg=f"{color} {key}")
    np.testing.assert_allclose(table["outside"], TABLE[name]["outside"], rtol=2e-5)


def test_bands_are_weighted_means() -> None:
    # eta of brass grows steadily from 620 to 740 nm; p is symmetric about the middle, 0.78 at the ends.
    (eta, k), *_ = band_means("brass")
    np.testing.assert_allclose((eta, k), (0.4465, 3.939), rtol=1e-3)


def test_a_name_stands_for_its_index() -> None:
    by_name = complete_parameters("disney", {"metal": "gold", "metallic": 1.0})
    spelled_out = complete_parameters("disney", {"fresnel": "conductor", "metallic": 1.0, **metal_index("gold")})
    assert by_name["metal"] == "none"
    for name, value in spelled_out.items():
        np.testing.assert_array_equal(by_name[name], value)
    in_bands = complete_parameters("disney", {"metal": "gold", "metalColor": "bands"})
    np.testing.assert_array_equal(in_bands["eta"], TABLE["gold"]["bands"]["eta"])
    # A completed set is complete.
    again = model_named("disney").complete(by_name)
    np.testing.assert_array_equal(again["eta"], by_name["eta"])


def test_a_mirror_is_of_a_metal_by_name() -> None:
    mirror = model_named("mirror")
    (delta,) = mirror.bsdf(mirror.complete({"metal": "copper"})).deltas(np.array([0.6, 0.0, 0.8]), np.array(False))
    expected = np.asarray(metal_curve("copper", np.array(0.8)))
    np.testing.assert_allclose(delta.value, expected, atol=max(TABLE["copper"]["nearest"]["deviation"]) + 3e-5)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"metal": "gould"}, "disney.metal is 'gould'; one of none, aluminium, brass, "),
        ({"metal": "gold", "metalColor": "rgb"}, "disney.metalColor is 'rgb'; one of nearest, bands"),
        ({"metal": "gold", "eta": (1.0, 1.0, 1.0)}, r"disney.eta is \(1.0, 1.0, 1.0\), but metal 'gold' stands for \("),
        ({"metal": "gold", "k": "k"}, "disney.k is 'k', but metal 'gold' stands for"),
        ({"metal": "gold", "fresnel": "schlick"}, "fresnel is 'schlick', but metal 'gold' stands for 'conductor'"),
    ],
)
def test_a_name_beside_what_it_stands_for_is_an_error(parameters: dict[str, object], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        complete_parameters("disney", parameters)
