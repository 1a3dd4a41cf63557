"""IES profiles: angles, symmetries, power, and files that contradict themselves."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from closed_forms import by_sampling

from lookdev.errors import EnvironmentMapError
from lookdev.light import Emission, Shaping, SphereLight
from lookdev.light.ies import IesProfile, load_profile, parse_profile, profile_power

HEADER = "IESNA:LM-63-2002\n[TEST] none\n[MANUFAC] nobody\n"


def written(
    down: list[float], around: list[float], candela: Any, multiplier: float = 1.0, factors: Any = (1.0, 1.0)
) -> str:
    """Return the text of an IES file, candela by horizontal angle."""
    rows = "\n".join(" ".join(f"{value:.10g}" for value in row) for row in candela)
    counts = f"1 1000 {multiplier} {len(down)} {len(around)} 1 2 0.1 0.2 0\n{factors[0]} {factors[1]} 50"
    angles = "\n".join(" ".join(f"{value:.10g}" for value in values) for values in (down, around))
    return f"{HEADER}TILT=NONE\n{counts}\n{angles}\n{rows}\n"


def profile(tmp_path: Path, text: str, **options) -> IesProfile:
    file = tmp_path / "lamp.ies"
    file.write_text(text, encoding="latin-1")
    return load_profile(file, **options)


def looked_up(profile: IesProfile, vertical: float, horizontal: float) -> float:
    return float(profile.factor(np.array(vertical), np.array(horizontal)))


def test_intensity_is_bilinear_and_multiplied(tmp_path: Path) -> None:
    text = written([0, 30, 90], [0, 90, 180, 270, 360], [[8, 4, 0], [8, 2, 1], [8, 4, 0], [8, 6, 3], [8, 4, 0]],
                   multiplier=2.5, factors=(0.5, 0.8))  # fmt: skip
    got = profile(tmp_path, text)
    for vertical, horizontal, candela in (
        (0, 0, 8), (15, 0, 6), (30, 90, 2), (30, 45, 3), (60, 270, 4.5), (60, 315, 3.25), (90, 270, 3), (90.1, 270, 0),
        (180, 0, 0), (30, 360, 4),
    ):  # fmt: skip
        assert looked_up(got, vertical, horizontal) == pytest.approx(candela)


@pytest.mark.parametrize(
    ("around", "same"),
    [
        ([0.0], [[0.0, 77.0, 200.0, 360.0]]),
        ([0.0, 20.0, 90.0], [[10.0, 170.0, 190.0, 350.0], [55.0, 125.0, 235.0, 305.0]]),
        ([0.0, 50.0, 110.0, 180.0], [[30.0, 330.0], [100.0, 260.0]]),
        ([90.0, 100.0, 200.0, 270.0], [[95.0, 85.0], [150.0, 30.0], [250.0, 290.0], [180.0, 0.0]]),
    ],
)
def test_horizontal_angles_are_mirrored(around: list[float], same: list[list[float]], tmp_path: Path) -> None:
    rows = [[1.0, 2.0 + number**2] for number in range(len(around))]
    got = profile(tmp_path, written([0, 90], around, rows))
    for number, angle in enumerate(around):
        assert looked_up(got, 90.0, angle) == pytest.approx(2.0 + number**2)
    for angles in same:
        values = [looked_up(got, 90.0, angle) for angle in angles]
        np.testing.assert_allclose(values, values[0])


@pytest.mark.parametrize(("scale", "from_to"), [(0.5, (20.0, 40.0)), (2.0, (40.0, 20.0)), (-0.5, (160.0, 140.0))])
def test_the_angle_scale_narrows_and_broadens(scale: float, from_to: tuple[float, float], tmp_path: Path) -> None:
    candela = [np.cos(np.radians(np.arange(0, 181, 5))) + 2.0]
    text = written(list(range(0, 181, 5)), [0.0], candela)
    got, plain = profile(tmp_path, text, angle_scale=scale), profile(tmp_path, text)
    assert looked_up(got, from_to[0], 0.0) == pytest.approx(looked_up(plain, from_to[1], 0.0))
    # The light is dark beyond the profile's angles.
    assert looked_up(got, 100.0 if scale > 0 else 80.0, 0.0) == (0.0 if abs(scale) < 1 else looked_up(plain, 50.0, 0.0))


def test_a_profile_is_normalized_by_its_mean() -> None:
    for text, mean in (
        (written([0, 180], [0], [[3, 3]]), 3.0),
        (written([0, 90], [0], [[3, 3]]), 3.0),
        (written([90, 120, 180], [0, 45, 90], [[3] * 3] * 3), 3.0),
        # Intensity angle / 90 over the hemisphere: the integral of the angle times its sine is 1.
        (written([0, 45, 90], [0, 90, 180], [[0, 0.5, 1]] * 3), 2.0 / np.pi),
        # Twice as much on one half, linear in between.
        (written([0, 180], [0, 90, 180, 270, 360], [[1, 1], [1, 1], [3, 3], [1, 1], [1, 1]]), 1.5),
    ):
        assert profile_power(parse_profile(text, "lamp.ies")) == pytest.approx(mean, rel=1e-9)


def test_a_light_has_its_profile_about_its_axis(tmp_path: Path) -> None:
    """The irradiance of a small sphere is multiplied by its cosine profile; azimuth is from x towards y."""
    down, around = np.arange(0.0, 181.0), np.arange(0.0, 361.0)
    theta, phi = np.radians(down), np.radians(around)
    candela = 1.0 + 0.5 * np.cos(theta) + 0.25 * np.sin(theta) * np.sin(phi)[:, None]
    shaping = Shaping(profile=profile(tmp_path, written(list(down), list(around), candela), normalize=True))
    light = SphereLight(radius=1e-3, position=(1.0, 2.0, 3.0), emission=Emission(shaping=shaping))
    for sent in np.array([(0.0, 0.0, -1.0), (0.6, 0.0, -0.8), (0.0, 0.8, 0.6), (0.0, -0.6, -0.8), (0.48, 0.64, 0.6)]):
        expected = np.pi * 1e-6 * (1.0 - 0.5 * sent[2] + 0.25 * sent[1]) / 4.0
        got = by_sampling(light, np.array(light.position) + 2.0 * sent, -sent, 4)
        assert got == pytest.approx(expected, rel=1e-3)


RIGHT = written([0, 90], [0, 90], [[1, 2], [3, 4]])
LIES = [
    ("no lamp\n", 1, "an IES file begins with IESNA91"),
    (HEADER, 4, "no line 'TILT='"),
    (RIGHT.replace("1 1000", "0 1000"), 5, "number of lamps 0: a whole number from 1 to"),
    (RIGHT.replace("1 1000", "one 1000"), 5, "'one' among the number of lamps is not a number"),
    (RIGHT.replace("1 1000", "nan 1000"), 5, "'nan' among the number of lamps is not a number"),
    (RIGHT.replace("1000 1.0", "1000 -1"), 5, "candela multiplier -1: a number above 0"),
    (RIGHT.replace("2 2 1 2", "2 2 2 2"), 5, "is of type B goniophotometry; type C, 1, would be right"),
    (RIGHT.replace("2 2 1 2", "999999999 2 1 2"), 5, "number of vertical angles 1e"),
    (RIGHT.replace("2 2 1 2", "2.5 2 1 2"), 5, "number of vertical angles 2.5"),
    (RIGHT.replace("1.0 1.0 50", "0 1.0 50"), 6, "ballast factor 0"),
    (RIGHT.replace("\n0 90\n0 90\n", "\n90 0\n0 90\n"), 7, "the vertical angles do not increase"),
    (RIGHT.replace("\n0 90\n0 90\n", "\n0 80\n0 90\n"), 7, "the vertical angles are from 0 to 80; 0 to 90, 90 to 180"),
    (RIGHT.replace("\n0 90\n0 90\n", "\n0 90\n0 100\n"), 8, "the horizontal angles are from 0 to 100"),
    (RIGHT.replace("3 4", "3 -4"), 10, "candela value -4: none is negative"),
    (RIGHT.replace("3 4", "3 1e999"), 10, "'1e999' among the candela values is not a number"),
    (RIGHT.replace("3 4\n", "3"), 10, "the file ends before its candela values: 1 are missing"),
    (RIGHT + "5 6 7\n", 11, "the file has 3 numbers more than it announces"),
    (RIGHT.replace("3 4", "3 1e30"), 11, r"a candela value of 1e\+30; at most 1e18"),
    (RIGHT.replace("TILT=NONE", "TILT=INCLUDE\n7\n2\n0 90\n1 1"), 5, "lamp to luminaire geometry 7"),
]


@pytest.mark.parametrize(("text", "line", "message"), LIES, ids=[message[:24] for _, _, message in LIES])
def test_a_file_that_lies_is_refused_by_line(text: str, line: int, message: str) -> None:
    with pytest.raises(EnvironmentMapError, match=rf"^lamp\.ies, line {line}: .*{message}"):
        parse_profile(text, "lamp.ies")


def test_line_ends_commas_and_tilt_are_no_lies() -> None:
    right = parse_profile(RIGHT, "lamp.ies")
    for text in (
        RIGHT.replace("\n", "\r\n"),
        RIGHT.replace("\n3 4", " , 3,\n4"),
        RIGHT.replace("TILT=NONE", "TILT=INCLUDE\n1\n2\n0 90\n1 0.9"),
        RIGHT.replace("LM-63-2002", "LM-63-1995"),
    ):
        np.testing.assert_array_equal(parse_profile(text, "lamp.ies"), right)


def test_a_dark_profile_has_no_power(tmp_path: Path) -> None:
    with pytest.raises(EnvironmentMapError, match=r"lamp\.ies: sends no light, so its power cannot be normalized"):
        profile(tmp_path, written([0, 90], [0], [[0, 0]]), normalize=True)
