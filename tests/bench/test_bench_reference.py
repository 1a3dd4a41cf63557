"""Errors of renders of known noise against a reference that has noise too."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench_fakes import SIDE, FakeRenderer, quiet, truth

from lookdev.bench.reference import FIRST_SEED, Reference, obtain_reference
from lookdev.errors import LookdevError
from lookdev.metrics import EPSILON

SAMPLES = 16


def make_reference(render: FakeRenderer, samples: int = SAMPLES, parts: int = 4) -> Reference:
    return obtain_reference(render.name, samples, parts, render, quiet)


def test_the_references_own_error_is_taken_away() -> None:
    # With four parts of as many samples as the render, the squared difference is a quarter too large.
    render = FakeRenderer()
    reference = make_reference(render)
    shots = [render(SAMPLES, seed) for seed in range(8)]
    verdict = reference.measure_error(*shots)
    # 43 x 64 x 3 values of chi squared, of which the weights 1 / (ref^2 + 0.01) leave about a tenth; the reference's
    # noise is common to all renders: one standard error is about 1.5 %, a missing subtraction would be 25 %.
    assert verdict.relmse == pytest.approx(render.relmse(SAMPLES), rel=0.06)
    assert reference.own_relmse == pytest.approx(render.relmse(4 * SAMPLES), rel=0.1)


def test_what_the_references_own_noise_leaves_uncertain_is_not_reported() -> None:
    render = FakeRenderer()
    reference = make_reference(render)
    assert reference.measure_error(render(2 * SAMPLES, 1)).relmse is not None
    # Of half its own error, over some thousand pixels, its noise is a sixth.
    below = [reference.measure_error(render(8 * SAMPLES, seed)).relmse for seed in range(3)]
    assert below == [pytest.approx(render.relmse(8 * SAMPLES), rel=0.5)] * 3
    assert reference.measure_error(render(512 * SAMPLES, 1)).relmse is None


def test_the_noise_of_a_reference_is_what_it_is_estimated_to_be() -> None:
    render = FakeRenderer()
    shot = render(16 * SAMPLES, 1)
    image, alpha = truth()
    covered = alpha > 0.0
    exact = (((shot.image - image) ** 2) / (image**2 + EPSILON))[covered].mean()
    off, expected = [], []
    for start in range(0, 200, 4):
        reference = Reference(SAMPLES)
        for seed in range(start, start + 4):
            reference.add(render(SAMPLES, FIRST_SEED + seed))
        squares = (shot.image - reference.mean) ** 2
        off.append(reference._relative(squares) - reference.own_relmse - exact)
        expected.append(reference._uncertainty(squares))
    # Fifty of them: their spread is known to a tenth; channels of the fake are independent, which is a third of it.
    assert np.std(off) == pytest.approx(np.mean(expected) / np.sqrt(3.0), rel=0.4)


def test_bias_and_its_standard_error() -> None:
    reference = make_reference(FakeRenderer())
    brighter = FakeRenderer(gain=1.05)
    image, alpha = truth()
    covered = alpha > 0.0
    scale = brighter.scale
    # The mean of three channels has a third of the variance; render and reference both have noise; and where
    # brightness differs, the bias does.
    spread = np.sqrt(scale**2 / 3.0 * (1.0 / SAMPLES + 1.0 / (4 * SAMPLES)) + (0.05 * image[covered].mean(-1)).var())
    expected = spread / np.sqrt(covered.sum()) / image[covered].mean()
    verdict = reference.measure_error(brighter(SAMPLES, 1))
    assert verdict.bias_error == pytest.approx(expected, rel=0.1)
    assert abs(verdict.bias - 0.05) < 5.0 * verdict.bias_error
    assert verdict.bias > 5.0 * verdict.bias_error
    unbiased = reference.measure_error(*(FakeRenderer()(SAMPLES, seed) for seed in range(40)))
    assert abs(unbiased.bias) < 5.0 * unbiased.bias_error


def test_a_bias_is_part_of_relmse() -> None:
    reference = make_reference(FakeRenderer())
    brighter = FakeRenderer(gain=1.2)
    assert reference.measure_error(brighter(SAMPLES, 1)).relmse == pytest.approx(brighter.relmse(SAMPLES), rel=0.1)


def test_pixels_without_coverage_do_not_count() -> None:
    render = FakeRenderer()
    reference = make_reference(render)
    shot = render(SAMPLES, 3)
    image = shot.image.copy()
    image[: SIDE // 3] = 100.0
    assert reference.measure_error(replace(shot, image=image)) == reference.measure_error(shot)


def test_a_second_run_finds_the_reference() -> None:
    render = FakeRenderer()
    first = make_reference(render, parts=6)
    assert [(samples, seed) for _, samples, seed in render.calls] == [(SAMPLES, FIRST_SEED + k) for k in range(6)]
    render.calls.clear()
    again = make_reference(render, parts=6)
    assert render.calls == []
    np.testing.assert_array_equal(again.mean, first.mean)
    assert again.own_relmse == first.own_relmse
    # Fewer samples are there already, too, with any number of parts.
    assert make_reference(render, samples=4, parts=5).samples == 6 * SAMPLES
    assert render.calls == []


def test_a_reference_grows_and_is_taken_up_where_it_was_left() -> None:
    render = FakeRenderer(ends_after=5)
    with pytest.raises(KeyboardInterrupt):
        make_reference(render, parts=8)
    render.ends_after = None
    assert make_reference(render, parts=8).samples == 8 * SAMPLES
    assert [seed for _, _, seed in render.calls] == [FIRST_SEED + k for k in range(8)]


def test_a_reference_of_smaller_parts_is_begun_anew() -> None:
    render = FakeRenderer()
    make_reference(render, samples=4)
    assert make_reference(render, samples=SAMPLES).part_samples == SAMPLES
    assert make_reference(render, samples=SAMPLES).samples == 4 * SAMPLES


def test_a_reference_is_rendered_again_if_that_is_asked_for_or_its_file_is_broken(tmp_path: Path) -> None:
    render = FakeRenderer()
    make_reference(render)
    obtain_reference(render.name, SAMPLES, 4, render, quiet, fresh=True)
    assert len(render.calls) == 2 * 4
    (file,) = (tmp_path / "cache" / "bench").glob("*.npz")
    file.write_bytes(file.read_bytes()[:1000])
    make_reference(render)
    assert len(render.calls) == 3 * 4


def test_a_black_picture_is_refused() -> None:
    with pytest.raises(LookdevError, match="black or empty"):
        make_reference(FakeRenderer(gain=0.0, scale=0.0))
