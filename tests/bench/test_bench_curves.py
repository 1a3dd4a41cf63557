"""Reading a time off a curve: on power laws, where the answer is known."""

import pytest

from lookdev.bench.measure import MAX_EXTRAPOLATION, CurveEffort, effort_ratio, effort_to_error
from lookdev.bench.sequence import error_at

TIMES = [1.0, 4.0, 16.0]


def power_law(exponent: float, scale: float = 1e-2) -> list[float]:
    return [scale * time**-exponent for time in TIMES]


@pytest.mark.parametrize("exponent", [0.5, 1.0, 1.5])
def test_a_power_law_is_read_exactly_between_its_points(exponent: float) -> None:
    for time in (1.5, 4.0, 9.0, 16.0):
        result = effort_to_error(TIMES, power_law(exponent), 1e-2 * time**-exponent)
        assert result is not None
        assert result.value == pytest.approx(time)
        assert result.mark == ""


@pytest.mark.parametrize(
    ("time", "reached"), [(MAX_EXTRAPOLATION * 16.0 * 0.999, True), (MAX_EXTRAPOLATION * 16.0 * 1.001, False)]
)
def test_a_curve_is_continued_by_its_last_slope_for_a_factor_of_four(time: float, reached: bool) -> None:
    # The first stretch is flat: were its slope of any weight, the answer would be another.
    errors = [1e-2, 8e-3, 8e-3 * 4.0**-1.5]
    result = effort_to_error(TIMES, errors, 8e-3 * (time / 4.0) ** -1.5)
    assert (result is not None) == reached
    if result:
        assert (result.value, result.mark) == (pytest.approx(time), "~")


def test_the_first_point_may_be_good_enough_already() -> None:
    assert effort_to_error(TIMES, power_law(1.0), 2e-2) == CurveEffort(1.0, "<")
    assert effort_to_error(TIMES, power_law(1.0), 1e-2) == CurveEffort(1.0)
    assert effort_to_error([2.0], [1e-4], 1e-3) == CurveEffort(2.0, "<")


@pytest.mark.parametrize("curve", [([], []), ([1.0], [1e-2]), ([1.0, 2.0], [1e-2, 2e-2]), ([2.0, 2.0], [1e-2, 5e-3])])
def test_a_curve_without_a_slope_is_not_continued(curve: tuple[list[float], list[float]]) -> None:
    assert effort_to_error(*curve, 1e-3) is None


def test_a_curve_that_rises_again_is_read_where_it_first_gets_there() -> None:
    assert effort_to_error([1.0, 2.0, 4.0, 8.0], [1e-2, 1e-3, 5e-3, 1e-4], 1e-3) == CurveEffort(pytest.approx(2.0))


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        (CurveEffort(3.0), CurveEffort(2.0), CurveEffort(1.5)),
        (CurveEffort(3.0, "~"), CurveEffort(2.0), CurveEffort(1.5, "~")),
        (CurveEffort(3.0), CurveEffort(2.0, "~"), CurveEffort(1.5, "~")),
        (CurveEffort(3.0, "<"), CurveEffort(2.0), CurveEffort(1.5, "<")),
        (CurveEffort(3.0), CurveEffort(2.0, "<"), CurveEffort(1.5, ">")),
        (CurveEffort(3.0, "<"), CurveEffort(2.0, "<"), None),
        (None, CurveEffort(2.0), None),
        (CurveEffort(3.0), None, None),
    ],
)
def test_ratios_keep_the_doubt_of_what_they_are_of(
    one: CurveEffort | None, other: CurveEffort | None, expected: CurveEffort | None
) -> None:
    assert effort_ratio(one, other) == expected


def test_the_error_at_an_effort() -> None:
    for time in (0.25, 1.0, 3.0, 16.0, 100.0):
        assert error_at(list(zip(TIMES, power_law(1.2), strict=True)), time) == pytest.approx(1e-2 * time**-1.2)
