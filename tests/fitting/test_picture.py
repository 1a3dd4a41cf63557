"""Fits to pictures without a renderer: pictures, their noise and colours, and searches of linear models."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from lookdev.brdf import Parameter
from lookdev.errors import LookdevError
from lookdev.fitting.picture.photo import REC709, Photo, estimate_noise, matrix_to_rec709, read_photo
from lookdev.fitting.picture.search import Search, SearchSettings
from lookdev.fitting.picture.target import Target, block_side
from lookdev.fitting.picture.unknowns import EXPOSURE, Unknown, parse_unknowns
from lookdev.material import Layer, Look
from lookdev.material.change import Constant

SIZE = 40


def write(file: Path, pixels: np.ndarray, **attributes: object) -> Path:
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.FLOAT)
    spec.channelnames = ("R", "G", "B", "A", "error.R", "error.G", "error.B")[: pixels.shape[2]]
    for name, value in attributes.items():
        spec.attribute(name, oiio.TypeDesc("float[8]"), value)
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(oiio.ROI(), pixels.astype(np.float32))
    assert buffer.write(str(file))
    return file


def unknown(name: str, value: float) -> Unknown:
    return Unknown(Constant(name, 0, (name,), Parameter(name, "float", value), (value,)), 0.0, 1.0, (0.0, 1.0))


def linear(truth: dict[str, float], noise: float, seed: int = 0, alike: bool = False):
    """Return a renderer of noisy pictures that are linear in parameters, and a target that is such a picture."""
    rng = np.random.default_rng(seed)
    shapes = {name: rng.random((SIZE, SIZE, 3)) + 0.2 for name in truth}
    if alike:
        first, second = list(shapes)[:2]
        shapes[second] = shapes[first]

    def picture(values) -> np.ndarray:
        return 0.3 + sum(shapes[name] * values[name][0] for name in truth)

    def noisy(pixels: np.ndarray, seed: int, samples: int, part: int) -> np.ndarray:
        spread = np.random.default_rng([seed, part]).normal(size=pixels.shape)
        return pixels + noise * spread * np.sqrt(64.0 / samples)

    def render(values, slopes: bool, samples: int, seeds: tuple[int, int]) -> np.ndarray:
        parts = [picture(values), *(shapes[name] for name in truth if slopes)]
        halves = [[noisy(value, seed, samples, n) for n, value in enumerate(parts)] for seed in seeds]
        return np.concatenate([np.array(halves), np.ones((2, len(parts), SIZE, SIZE, 1))], axis=-1)

    value = noisy(picture({name: (value,) for name, value in truth.items()}), 10**6, 64, 0)
    photo = Photo(Path("photo.exr"), value, None, np.full_like(value, noise), np.ones((SIZE, SIZE)), "the test")
    return render, Target.from_photo(photo, 1, np.ones((SIZE, SIZE)), 1.0, see_through=False)


def test_parameters_are_found_within_their_errors() -> None:
    truth = {"a": 0.7, "b": 0.15, "c": 0.4}
    scores = []
    for seed in range(12):
        render, target = linear(truth, 0.05, seed)
        result = Search(render, target, [unknown(name, 0.5) for name in truth], SearchSettings(seed=seed)).run()
        assert result.converged
        assert not result.undetermined
        scores += [(result.values[n][0] - value) / result.errors[n][0] for n, value in truth.items()]
    # Of 36 normal numbers: the variance has a standard error of .24, no mean is further off than 4 of .17.
    assert abs(np.mean(scores)) < 0.67
    assert 0.3 < np.var(scores) < 2.0


def test_the_loss_has_no_bias_of_the_renders_noise() -> None:
    render, target = linear({"a": 0.6}, 0.2)
    losses = []
    for seed in range(40):
        halves = render({"a": (0.6,)}, False, 8, (2 * seed, 2 * seed + 1))[:, 0, ..., :3]
        losses.append(target.loss(*halves))
    error = np.std(losses, ddof=1) / np.sqrt(len(losses))
    assert abs(np.mean(losses) - target.noise) < 4.0 * error + 0.2 * target.noise  # its own noise is one picture's
    assert target.noise < 0.2 * float((target.weight * 0.04 * 8.0).sum() / target.scale)


def test_what_the_picture_does_not_tell_is_reported() -> None:
    render, target = linear({"a": 0.5, "b": 0.3}, 0.05, alike=True)
    result = Search(render, target, [unknown("a", 0.4), unknown("b", 0.4)]).run()
    assert set(result.undetermined) == {"a", "b"}
    [(first, second, correlation)] = result.correlated_pairs
    assert (first, second) == ("a", "b")
    assert correlation < -0.95
    assert result.values["a"][0] + result.values["b"][0] == pytest.approx(0.8, abs=0.02)


def test_a_value_at_its_bound_is_that_bound() -> None:
    render, target = linear({"a": 0.0, "b": 0.5}, 0.02)
    result = Search(render, target, [unknown("a", 0.4), unknown("b", 0.4)]).run()
    assert result.values["a"][0] == pytest.approx(0.0, abs=4.0 * result.errors["a"][0])
    assert result.values["a"][0] >= 0.0


def test_exposure_is_found_too() -> None:
    render, target = linear({"a": 0.5}, 0.02)
    brighter = replace(target, value=2.0**0.5 * target.value)
    result = Search(render, brighter, [unknown("a", 0.3), EXPOSURE]).run()
    assert result.values["exposure"][0] == pytest.approx(0.5, abs=4.0 * result.errors["exposure"][0])
    assert result.values["a"][0] == pytest.approx(0.5, abs=4.0 * result.errors["a"][0])


def test_nothing_that_changes_is_an_error() -> None:
    render, target = linear({"a": 0.5}, 0.02)

    def still(values, slopes: bool, *rest) -> np.ndarray:
        picture = render({"a": (0.5,)}, slopes, *rest)
        picture[:, 1:] = 0.0  # the slopes
        return picture

    with pytest.raises(LookdevError, match="does not change with a"):
        Search(still, target, [unknown("a", 0.3)]).run()


def test_other_primaries_are_converted(tmp_path: Path) -> None:
    aces = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)
    matrix = matrix_to_rec709(aces)
    # ACEScg to Rec.709 with Bradford's adaptation, as OpenColorIO's built-in configs have it.
    published = [[1.70505, -0.62179, -0.08326], [-0.13026, 1.14080, -0.01055], [-0.02400, -0.12897, 1.15297]]
    np.testing.assert_allclose(matrix, published, atol=2e-4)
    np.testing.assert_allclose(matrix_to_rec709(REC709), np.eye(3), atol=1e-12)
    pixels = np.random.default_rng(0).random((8, 8, 3))
    photo = read_photo(write(tmp_path / "aces.exr", pixels, chromaticities=aces))
    np.testing.assert_allclose(photo.color, pixels.astype(np.float32) @ matrix.T, atol=1e-6)
    assert "Bradford" in photo.notes[0]
    assert not read_photo(write(tmp_path / "plain.exr", pixels, chromaticities=REC709)).notes


@pytest.mark.both_pythons
def test_the_layer_error_is_the_noise_and_broken_pixels_do_not_count(tmp_path: Path) -> None:
    pixels = np.full((8, 8, 7), 0.5)
    pixels[..., 4:] = 0.01
    pixels[2, 3, 0] = np.nan
    photo = read_photo(write(tmp_path / "frame.exr", pixels))
    np.testing.assert_allclose(photo.noise, 0.01, rtol=1e-6)
    assert photo.weights.sum() == 63
    assert "1 pixels are not finite" in photo.notes[0]
    mask = write(tmp_path / "mask.exr", np.repeat(np.eye(8)[..., None], 3, axis=-1))
    assert read_photo(tmp_path / "frame.exr", mask).weights.sum() == 8


def test_noise_is_estimated_by_brightness() -> None:
    rng = np.random.default_rng(2)
    smooth = np.broadcast_to(np.linspace(0.1, 2.0, 200)[:, None, None], (200, 200, 3))
    noise = 0.05 * np.sqrt(smooth)
    result = estimate_noise(smooth + noise * rng.normal(size=smooth.shape), np.ones((200, 200)))
    assert np.mean(result / noise) == pytest.approx(1.0, abs=0.05)
    assert result[180:].mean() > 2.0 * result[:20].mean()


@pytest.mark.parametrize(("size", "pixels", "side"), [((128, 128), 4096, 2), ((96, 96), 4096, 1), ((97, 101), 16, 1),
                                                      ((1920, 1080), 4096, 20), ((32, 32), 4096, 1)])  # fmt: skip
def test_blocks_divide_a_picture(size: tuple[int, int], pixels: int, side: int) -> None:
    assert block_side(size, pixels) == side


def test_pictures_that_show_too_little_are_refused() -> None:
    color = np.full((8, 8, 3), 0.5)
    photo = Photo(Path("photo.exr"), color, None, 0.01 * color, np.ones((8, 8)), "the test")
    with pytest.raises(LookdevError, match="only 0 blocks of 1 x 1 pixels show nothing but the asset"):
        Target.from_photo(photo, 1, np.zeros((8, 8)), 1.0, see_through=False)
    with pytest.raises(LookdevError, match="no alpha to compare with"):
        Target.from_photo(photo, 1, np.ones((8, 8)), 1.0, see_through=True)


def test_units_and_values_are_inverse() -> None:
    look = Look("look", (Layer("L", "phong", {"exponent": 40.0}),))
    for parameter in (
        *parse_unknowns(look, ["exponent"]),
        *parse_unknowns(look, ["exponent=10..90"]),
        EXPOSURE,
    ):
        value = np.array([max(parameter.low, 12.5) if parameter.name != "exposure" else 0.7])
        unit = parameter.unit(value)
        assert parameter.value(unit) == pytest.approx(value)
        h = 1e-6
        slope = (parameter.value(unit + h) - parameter.value(unit - h)) / (2.0 * h)
        assert parameter.rate(unit) == pytest.approx(slope, rel=1e-5)


@pytest.mark.parametrize(("bounds", "words"), [("1", "has no 'exponent=1'"), ("9..3", "that rise"), ("a..b", "two")])
def test_wrong_ranges_are_refused(bounds: str, words: str) -> None:
    with pytest.raises(LookdevError, match=words):
        parse_unknowns(Look("look", (Layer("L", "phong", {"exponent": 5.0}),)), [f"exponent={bounds}"])
