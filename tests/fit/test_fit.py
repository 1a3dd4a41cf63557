"""Fits of data that a model made give its parameters back; others end at the loss that they state."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lookdev.brdf import CONTINUOUS, MODELS, evaluate
from lookdev.brdf.measured.files import write_merl
from lookdev.brdf.measured.synthetic import isotropic_samples
from lookdev.errors import LookdevError
from lookdev.fit import LOSSES, fit, free_parameters
from lookdev.fit.data import data_of
from lookdev.fit.solve import fit_text
from lookdev.plot import read_subject, subject_of

DISNEY = MODELS["disney"]
KNOWN: dict[str, Any] = {
    "baseColor": (0.6, 0.3, 0.15), "subsurface": 0.2, "metallic": 0.2, "specular": 0.6, "roughness": 0.35,
    "sheen": 0.3, "sheenTint": 0.7, "clearcoat": 0.5, "clearcoatGloss": 0.6,
}  # fmt: skip
# With a tint of the specular lobe, other metallic surfaces have the same f.
FIXED = {"specularTint": 0.0}


@pytest.mark.parametrize("loss", LOSSES)
def test_known_parameters_of_a_merl_file_come_back(loss: str, tmp_path: Path) -> None:
    file = tmp_path / "known.binary"
    write_merl(file, isotropic_samples(DISNEY.bsdf(DISNEY.complete(KNOWN))))
    found = fit(read_subject(str(file)), DISNEY, FIXED, loss=loss)
    for name, value in KNOWN.items():
        # The file's samples are float64 at the centres that are fitted: the issue asks for 1 %.
        assert np.asarray(found.values[name]) == pytest.approx(np.asarray(value), rel=0.01), name
    # The aspect ratio of the highlight is the root of 1 - 0.9 anisotropic.
    assert found.values["anisotropic"] < 0.01
    assert found.loss < 1e-3 * np.abs(LOSSES[loss](data_of(found.subject.bsdf, "").f)).max()
    assert found.unknown == ()


def test_an_anisotropic_surface_is_found_too() -> None:
    data = subject_of(DISNEY, {"metallic": 1.0, "anisotropic": 0.6, "roughness": 0.4}, "brushed")
    found = fit(data, DISNEY, wanted=("anisotropic", "roughness", "metallic", "baseColor"))
    assert found.values["anisotropic"] == pytest.approx(0.6, rel=0.01)
    assert found.values["roughness"] == pytest.approx(0.4, rel=0.01)


@pytest.mark.parametrize("name", [name for name in CONTINUOUS if name not in ("disney", "measured")])
def test_another_model_is_fitted_better_than_by_the_defaults(name: str) -> None:
    data = subject_of(MODELS[name], MODELS[name].probe, name)
    found = fit(data, DISNEY, starts=2)
    pairs = data_of(data.bsdf, name)
    plain = evaluate(DISNEY.bsdf(DISNEY.complete({})), pairs.wo, pairs.wi)
    worst = np.sqrt(np.mean((np.log1p(plain * pairs.cosine) - np.log1p(pairs.f * pairs.cosine)) ** 2))
    assert found.loss < worst
    fitted = evaluate(found.subject.bsdf, pairs.wo, pairs.wi)
    differences = np.log1p(fitted * pairs.cosine) - np.log1p(pairs.f * pairs.cosine)
    assert np.sqrt(np.mean(differences**2)) == pytest.approx(found.loss, rel=1e-9)
    assert np.sqrt(np.mean(differences**2, axis=0)) == pytest.approx(found.per_channel, rel=1e-9)
    assert found.starts == tuple(sorted(found.starts))


def test_what_has_no_effect_is_named() -> None:
    data = subject_of(MODELS["lambert"], {}, "lambert")
    found = fit(data, DISNEY, {"sheen": 0.0}, wanted=("baseColor", "roughness", "sheenTint"))
    assert found.unknown == ("sheenTint",)
    assert "sheenTint" in fit_text(found)
    assert "(without effect)" in fit_text(found)


def test_all_numbers_but_optional_ones_are_fitted() -> None:
    names = [each.name for each in free_parameters(DISNEY, {"sheen": 0.0})]
    assert "roughness" in names
    assert not {"sheen", "presence", "gamma", "filmThickness"} & set(names)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"loss": "lgo"}, "did you mean 'log'"),
        ({"wanted": ("rougness",)}, "did you mean 'roughness'"),
        ({"wanted": ("sheen",), "fixed": {"sheen": 0.1}}, "given and wanted"),
        ({"starts": 0}, "1 to 128"),
        ({"model": MODELS["mirror"]}, "mirror scatters along single directions"),
        ({"data": subject_of(MODELS["glass"], {}, "glass")}, "glass scatters along single directions"),
        ({"fixed": {"roughness": 3.0}}, "its range is 0 to 1"),
    ],
)
def test_a_fit_that_cannot_be_is_refused(arguments: dict[str, Any], message: str) -> None:
    given = {"data": subject_of(MODELS["lambert"], {}, "lambert"), "model": DISNEY, **arguments}
    with pytest.raises(LookdevError, match=message):
        fit(**given)
