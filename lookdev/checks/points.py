"""The check "points" of `lookdev check`: compares f and pdf of a look in Cycles (float32) and in NumPy (float64).

Cycles evaluates the generated OSL of the look. The inputs that vary over a surface are read from a table with their
values at random points. Constants are compiled into the code as in the shader that renders the look, so that the code
of that shader is tested. Both sides start from the same float32 numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf import MODELS, Bsdf, sample
from lookdev.brdf.angles import direction_at_cosine
from lookdev.brdf.frames import ZENITH
from lookdev.checks.evaluate import Batch, evaluate_cycles, evaluate_numpy, join_columns, round_to_float32
from lookdev.checks.finding import CheckFinding, FindingPlot, PlotCurve
from lookdev.checks.samples import case_line, constant_numbers, point_layer, sample_layers, varying_numbers
from lookdev.material import Look

TOLERANCE = 2e-4
"""Relative tolerance. For equal float32 inputs, the error of a formula is some hundred roundings (6e-8) at most."""

VISIBLE = 1e-4
"""The value of f or pdf, in 1/sr, below which the tolerance is absolute: it is then `TOLERANCE` times this value."""

_WORST = 5  # the number of cases that a finding lists
# The relative rounding error of a direction (four roundings to float32) in three cases: it is expressed in the frame of
# a tilted normal, it is refracted by an averaged index, or its angles are looked up in a table.
_DIRECTION_ROUNDING = 4.0 * 2.0**-24
_EDGES = np.linspace(-9.0, 0.0, 37)  # the edges of the bins of a histogram of relative errors, log10


def check_points(
    look: Look,
    *,
    count: int = 40_000,
    seed: int = 0,
    tolerance: float = TOLERANCE,
    alter: Callable[[str], str] = lambda osl: osl,
) -> CheckFinding:
    """Compare f and pdf of a look in `count` random cases, which are points of a surface with two directions.

    Textures are read. `tolerance` is the relative error that is allowed for values above `VISIBLE`. `alter` alters the
    text of the shader. Raises WorkerError if Cycles fails.
    """
    batch = look_batch(look, count, np.random.default_rng(seed))
    actual = join_columns(evaluate_cycles(batch, alter=alter))
    expected = join_columns(evaluate_numpy(batch))
    allowed = tolerance * np.maximum(expected, VISIBLE)
    has_rounded_directions = _rounds_directions(batch)
    if has_rounded_directions:
        allowed += _direction_rounding(batch, expected)
    allowed += _option_rounding(batch, expected)
    is_sound = np.isfinite(actual) & (actual >= 0.0)
    error = np.abs(np.where(is_sound, actual, 0.0) - expected)
    # The error of each value over the allowed error. A case fails if one of these ratios is above 1.
    excess = np.where(is_sound, error / allowed, np.inf)
    is_visible = expected > VISIBLE
    relative = error[is_visible] / expected[is_visible]
    worst = np.argsort(-excess.max(axis=-1), kind="stable")[:_WORST]
    failed = int(np.count_nonzero((excess > 1.0).any(axis=-1)))
    largest = float(relative.max(initial=0.0))
    extra = ", more where a normal, an averaged index or a look-up rounds directions" if has_rounded_directions else ""
    summary = (
        f"{count} cases, {failed} beyond {tolerance:.0e}{extra}; "
        f"relative error at most {largest:.1e}, median {float(np.median(relative)) if relative.size else 0.0:.1e}"
    )
    return CheckFinding(
        check="points",
        subject=look.name,
        passed=failed == 0,
        summary=summary,
        figures={
            "cases": float(count),
            "visible_values": float(relative.size),
            "failed": float(failed),
            "largest_relative_error": largest,
            "largest_excess": float(excess.max()),
        },
        details=tuple(_describe_case(batch, int(index), actual, expected, excess) for index in worst),
        plots=(_plot_histogram(error, expected, tolerance),),
    )


def look_batch(look: Look, count: int, rng: np.random.Generator) -> Batch:
    """Return random cases of a look, rounded to float32.

    In half of the cases, all inputs of a case are from one point. In the other half, inputs of different points are
    combined.
    """
    layers = sample_layers(look, count, rng)
    numbers = tuple(
        {name: round_to_float32(_recombine(value, rng)) for name, value in varying_numbers(layer).items()}
        for layer in layers
    )
    point_layers = tuple(point_layer(layer, constant_numbers(layer)) for layer in layers)
    zenith = np.tile(ZENITH, (count, 1))
    bsdf = Batch(point_layers, zenith, zenith, numbers).bsdf()
    wo, wi = (round_to_float32(w) for w in _draw_directions(bsdf, count, rng))
    return Batch(point_layers, wo, wi, numbers)


def _recombine(values: Floats, rng: np.random.Generator) -> Floats:
    """Shuffle the second half of values, so that inputs of different points are combined."""
    half = len(values) // 2
    return np.concatenate([values[:half], rng.permutation(values[half:])])


def _draw_directions(bsdf: Bsdf, count: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Draw directions wo to the viewer and wi to the light, (count, 3) each.

    A quarter of the views are grazing, with cosines down to 1e-4. Half of the directions to the light are samples of
    the BSDF. The others are near the mirror direction, nearly opposite to the view, on the horizon, or random. A
    two-sided surface is also seen and lit from behind.
    """
    wo, wi = _draw_upper(rng, count), _draw_upper(rng, count)
    sixteenth = count // 16
    sampled = sample(bsdf, wo, rng.random((count, 2)))
    half = 8 * sixteenth
    # Where the BSDF draws no direction, z is 0.
    wi[:half] = np.where(sampled[:half, 2:] != 0.0, sampled[:half], wi[:half])
    mirror = slice(half, half + 3 * sixteenth)
    spread = 10.0 ** rng.uniform(-5.0, 0.0, (3 * sixteenth, 1))
    wi[mirror] = wo[mirror] * [-1.0, -1.0, 1.0] + rng.normal(size=(3 * sixteenth, 3)) * spread
    opposite = slice(mirror.stop, mirror.stop + sixteenth)
    wo[opposite, 2] = wi[opposite, 2] = 1e-3
    wi[opposite, :2] = -wo[opposite, :2] + rng.normal(size=(sixteenth, 2)) * 1e-3
    horizon = slice(opposite.stop, opposite.stop + sixteenth)
    wi[horizon, 2] *= rng.choice([0.0, -1.0], sixteenth)
    if bsdf.two_sided:
        wi[horizon.stop :: 2, 2] *= -1.0
        behind = rng.random(count) < 1.0 / 16.0
        wo[behind], wi[behind] = -wo[behind], -wi[behind]
    return _normalize(wo), _normalize(wi)


def _draw_upper(rng: np.random.Generator, count: int) -> Floats:
    """Draw directions in the upper hemisphere, a quarter of them grazing."""
    cos = rng.random(count)
    quarter = rng.permutation(count)[: count // 4]
    cos[quarter] = 10.0 ** rng.uniform(-4.0, 0.0, quarter.size)
    return direction_at_cosine(cos, rng.uniform(0.0, 2.0 * np.pi, count))


def _normalize(w: Floats) -> Floats:
    return np.asarray(w / np.linalg.norm(w, axis=-1, keepdims=True))


def _rounds_directions(batch: Batch) -> bool:
    """Return whether code rounds directions before it evaluates a lobe: see `_DIRECTION_ROUNDING`."""
    for layer, numbers in zip(batch.layers, batch.numbers, strict=True):
        if any(parameter.file for parameter in MODELS[layer.model].parameters.values()):
            return True
        for name in layer.shapes():
            normal = numbers.get(name, np.asarray(layer.constants.get(name, ZENITH)))
            if name.lower().endswith("normal") and np.any(normal[..., :2] != 0.0):
                return True
    return [layer.mode for layer in batch.layers].count("transmit") > 1


def _direction_rounding(batch: Batch, expected: Floats) -> Floats:
    """Return the change of f and pdf, (n, 4), when the directions change by `_DIRECTION_ROUNDING`.

    Each component of each direction is changed up and down. Of the two resulting changes, the larger one counts. These
    changes are added over all components.
    """
    total = np.zeros_like(expected)
    for axis in range(3):
        step = _DIRECTION_ROUNDING * np.eye(3)[axis]
        for wo_step, wi_step in ((step, 0.0), (0.0, step)):
            moved = [replace(batch, wo=batch.wo + s * wo_step, wi=batch.wi + s * wi_step) for s in (1.0, -1.0)]
            total += np.maximum(*(np.abs(join_columns(evaluate_numpy(other)) - expected) for other in moved))
    return total


def _option_rounding(batch: Batch, expected: Floats) -> Floats:
    """Return the change of f and pdf, (n, 4), when optional numbers change by `_DIRECTION_ROUNDING`.

    Optional numbers are phases and exponents, which magnify a rounding error.
    """
    change = np.zeros_like(expected)
    for number, layer in enumerate(batch.layers):
        for name, default in MODELS[layer.model].optional_defaults().items():
            values = {**layer.constants, **batch.numbers[number]}
            if name in values and np.any(values[name] != np.asarray(default)):
                numbers = list(batch.numbers)
                numbers[number] = {**numbers[number], name: np.asarray(values[name]) * (1.0 - _DIRECTION_ROUNDING)}
                other = replace(batch, numbers=tuple(numbers))
                change += np.abs(join_columns(evaluate_numpy(other)) - expected)
    return change


def _describe_case(batch: Batch, index: int, actual: Floats, expected: Floats, excess: Floats) -> str:
    """Return one case as a line for `lookdev eval`, with the values of both sides."""
    values_of = {"numpy": expected[index].tolist(), "cycles": [float(value) for value in actual[index]]}
    return case_line(batch, index, excess=float(excess[index].max()), f_and_pdf=values_of)


def _plot_histogram(error: Floats, expected: Floats, tolerance: float) -> FindingPlot:
    """Return a histogram of the relative errors of visible values, for f and for pdf."""
    series = []
    for name, columns in (("f", slice(0, 3)), ("pdf", slice(3, 4))):
        visible = expected[:, columns] > VISIBLE
        relative = error[:, columns][visible] / expected[:, columns][visible]
        logarithm = np.log10(np.clip(relative, 10.0 ** _EDGES[0], 10.0 ** _EDGES[-1]))
        heights = np.histogram(logarithm, _EDGES)[0].astype(np.float64)
        series.append(PlotCurve(name, _EDGES, heights, style="bars"))
    top = max(float(curve.y.max(initial=1.0)) for curve in series)
    limit = PlotCurve("tolerance", np.full(2, np.log10(tolerance)), np.array([0.5, max(top, 1.0)]))
    return FindingPlot("Relative error", "log10 of the relative error", "values", (*series, limit), log_y=True)
