"""The check "stability" of `lookdev check`: models and looks with extreme parameters, directions, lights and geometry.

At points, the values of f and pdf must be finite and not negative, in float64 (NumPy) and in float32 (Cycles). A
float32 value must also be accurate. It passes if its relative error is at most `MAX_RELATIVE_ERROR`, or if its backward
error is at most `MAX_BACKWARD_ERROR` (Higham 2002, "Accuracy and Stability of Numerical Algorithms", 1.5). The backward
error is the error of the value, divided by the change of the exact value when every input is rounded: a rounding is a
relative change of 2^-24. For any formula, the change of the exact value is large where a highlight of 0.25 degrees is
at the horizon, and small elsewhere.

In scenes, pictures that must be equal are compared. The noise of their halves must explain their difference.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import numpy as np

from lookdev.arrays import Bools, Floats
from lookdev.asset import Asset, save_asset
from lookdev.brdf import MODELS, StackLayer, evaluate_cosine, pdf, sample
from lookdev.cache import Content
from lookdev.checks.evaluate import Batch, evaluate_cycles, evaluate_numpy, join_columns
from lookdev.checks.extremes import SceneCase, extreme_cases, moderate_numbers, random_normal_scenes, scene_cases
from lookdev.checks.finding import CheckFinding
from lookdev.checks.frames import Halves, RenderHalves
from lookdev.checks.samples import case_line, constant_numbers, point_layer, sample_layers
from lookdev.codegen.points import PointLayer
from lookdev.errors import RenderError, WorkerError
from lookdev.light import prepare_light
from lookdev.material import Layer, Look
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import FrameTask, frame_task
from lookdev.scene import Camera, Pose, Sampling, Scene

DepthName = Literal["quick", "default", "full"]

MAX_RELATIVE_ERROR = 2e-4
"""The relative error that a float32 value may have, whatever its backward error is."""

VISIBLE = 1e-4
"""An f or pdf in 1/sr. The relative error of a smaller value is its error divided by this number."""

MAX_BACKWARD_ERROR = 64.0
"""The backward error, in roundings, that a float32 value may have: formulas have some ten operations, each rounded."""

MAX_DIFFERENCE = 2.0
"""The limit of the squared difference of two pictures, divided by the noise variance that their halves show.

For two pictures of equal scenes this ratio is 1 on average. The limit is larger because the noise has heavy tails.
"""

_ROUNDING = 2.0**-24  # the largest relative error of a number that is rounded to float32
_PERTURBATIONS = 8  # the inputs are rounded at random this number of times; the largest change of a value counts
_WORST = 5  # the number of failed cases that a finding lists
_COUNTS: dict[DepthName, int] = {"quick": 4_000, "default": 20_000, "full": 200_000}  # cases of each stack
# For the albedo: the number of random sets of parameters, and the samples for each view of a set.
_ENERGY: dict[DepthName, tuple[int, int]] = {"quick": (16, 128), "default": (48, 256), "full": (256, 1024)}
_VIEWS = (1.0, 0.5, 0.1, 1e-3, 1e-7)  # cosines of the views at which albedos are computed
_SIZE = (32, 32)  # the width and height of the pictures, pixels
_SAMPLING = Sampling(samples=32, brdf_samples=2, ibl_samples=2, bounces=1)


def check_stability(
    subjects: Sequence[str | Look], render: RenderHalves, *, seed: int = 0, depth: DepthName = "default"
) -> Iterator[CheckFinding]:
    """Check models and looks in extreme cases; yield a finding for each stack of layers and for each scene.

    `subjects` are names of models, and looks. A model is checked alone, with every choice of its tokens, and in stacks.
    A look keeps its constants, and its other inputs take any value of their range. `depth` determines the number of
    cases of each stack: 4,000, 20,000 or 200,000. The cases are drawn with `seed`. Raises WorkerError if Cycles cannot
    evaluate points; a picture that cannot be rendered is a finding.
    """
    rng = np.random.default_rng(seed)
    for subject in subjects:
        if isinstance(subject, Look):
            yield check_stack(subject.name, look_stack(subject), rng, depth)
            yield from check_scenes(subject, random_normal_scenes(), render)
        else:
            for name, layers in model_stacks(subject).items():
                yield check_stack(name, layers, rng, depth)
            # An isotropic look of the model, in which all lobes have a share.
            probe = Look(subject, (Layer("Probe", subject, dict(MODELS[subject].probe)),))
            yield from check_scenes(probe, scene_cases(), render)


def model_stacks(model: str) -> dict[str, tuple[PointLayer, ...]]:
    """Return stacks to check for a model, by their names.

    The stacks are the model alone with every choice of its tokens, the model with its optional numbers, the model over
    itself in each mode, and the model over each other model that has several modes.
    """

    def default_layer(name: str) -> PointLayer:
        tokens = {p.name: p.choices[0] for p in MODELS[name].parameters.values() if p.choices}
        return PointLayer(name, tokens, constants=MODELS[name].optional_defaults())

    choices = MODELS[model].forms()
    stacks: dict[str, tuple[PointLayer, ...]] = {}
    for values in product(*choices.values()):
        form = dict(zip(choices, values, strict=True))
        stacks[" ".join([model, *form.values()])] = (replace(default_layer(model), tokens=form),)
    if MODELS[model].optional_defaults():
        stacks[f"{model} with options"] = (replace(default_layer(model), constants={}),)
    stacks[f"{model} over {model}"] = (default_layer(model), default_layer(model))
    for mode in MODELS[model].modes[1:]:
        above = replace(default_layer(model), mode=mode)
        stacks[f"{model} over {model}, twice in mode {mode}"] = (default_layer(model), above, above)
    layered = [name for name, other in MODELS.items() if len(other.modes) > 1 and name != model]
    return stacks | {f"{model} over {other}": (default_layer(other), default_layer(model)) for other in layered}


def look_stack(look: Look) -> tuple[PointLayer, ...]:
    """Return the layers of a look with their constants, which are rounded to float32."""

    def round_constants(layer: StackLayer) -> dict[str, float | list[float]]:
        return {name: np.asarray(value, np.float32).tolist() for name, value in constant_numbers(layer).items()}

    layers = sample_layers(look, 2, np.random.default_rng(0))
    return tuple(point_layer(layer, round_constants(layer)) for layer in layers)


def check_stack(name: str, layers: Sequence[PointLayer], rng: np.random.Generator, depth: DepthName) -> CheckFinding:
    """Evaluate extreme cases of a stack in NumPy and inside Cycles, and estimate its largest albedo in NumPy."""
    cases = extreme_cases(layers, _COUNTS[depth], rng)
    with np.errstate(all="ignore"):
        expected = join_columns(evaluate_numpy(cases.batch))
    actual = join_columns(evaluate_cycles(cases.batch))
    unsound = {
        side: ~(np.isfinite(v) & (v >= 0.0)).all(axis=-1) for side, v in (("NumPy", expected), ("Cycles", actual))
    }
    is_broken = unsound["NumPy"] | unsound["Cycles"]
    # Values are compared where f is visible. The pdf alone does not matter: the sampling weight divides by the same
    # pdf, so an error of the pdf cancels.
    is_compared = cases.comparable & ~is_broken & (expected[:, :3] > VISIBLE).any(axis=-1)
    error = _measure_error(_select_cases(cases.batch, is_compared), actual[is_compared], expected[is_compared], rng)
    excess = np.zeros(len(is_broken))
    excess[is_compared] = error.excess
    excess[is_broken] = np.inf
    limit, albedo = _energy_limit(layers), _largest_albedo(layers, rng, depth)
    failed = int(np.count_nonzero(excess > 1.0))
    worst = [index for index in np.argsort(-excess, kind="stable")[:_WORST].tolist() if excess[index] > 0.0]
    return CheckFinding(
        check="stability",
        subject=name,
        passed=failed == 0 and albedo <= limit,
        summary=(
            f"{len(is_broken)} cases, {int(is_broken.sum())} not finite or negative, {failed} wrong in all; "
            f"float32 against float64: median {error.median:.1e}, {100.0 * error.ill_conditioned:.2g} % above "
            f"{MAX_RELATIVE_ERROR:.0e}, where inputs off by {error.backward_error:.0f} roundings give as much "
            f"({MAX_BACKWARD_ERROR:.0f} allowed); "
            f"albedo at most {albedo:.2f} of {limit:g}"
        ),
        figures={
            "cases": float(len(is_broken)),
            "unsound_numpy": float(unsound["NumPy"].sum()),
            "unsound_cycles": float(unsound["Cycles"].sum()),
            "failed": float(failed),
            "median_relative_error": error.median,
            "ill_conditioned": error.ill_conditioned,
            "largest_backward_error": error.backward_error,
            "largest_albedo": albedo,
        },
        details=tuple(
            case_line(
                cases.batch,
                index,
                excess=float(excess[index]),
                numpy=expected[index].tolist(),
                cycles=actual[index].tolist(),
            )
            for index in worst
        ),
    )


@dataclass(frozen=True, eq=False)
class _Float32Error:
    """The errors of the float32 values of n cases."""

    excess: Floats  # (n,): for each case, the largest ratio of a value's error to its limit; a case above 1 fails
    median: float  # the median relative error of the visible values
    ill_conditioned: float  # the share of values whose relative error is above MAX_RELATIVE_ERROR
    backward_error: float  # the largest backward error of these ill-conditioned values, in roundings


def _measure_error(batch: Batch, actual: Floats, expected: Floats, rng: np.random.Generator) -> _Float32Error:
    """Compare the float32 values `actual` (n, 4) with the float64 values `expected` (n, 4): f and pdf of n cases."""
    if not len(actual):
        return _Float32Error(np.zeros(0), 0.0, 0.0, 0.0)
    size = np.maximum(expected, VISIBLE)
    # The largest change of the exact value when all inputs change by a rounding, plus the rounding of the value itself.
    rounding_change = _ROUNDING * size
    for _ in range(_PERTURBATIONS):
        rounding_change = np.maximum(
            rounding_change, np.abs(join_columns(evaluate_numpy(_perturb(batch, rng))) - expected) + _ROUNDING * size
        )
    error = np.abs(actual - expected)
    relative, backward_error = error / size, error / rounding_change
    is_accurate = relative <= MAX_RELATIVE_ERROR
    return _Float32Error(
        excess=np.minimum(relative / MAX_RELATIVE_ERROR, backward_error / MAX_BACKWARD_ERROR).max(axis=-1),
        median=float(np.median(relative[expected > VISIBLE])),
        ill_conditioned=float((~is_accurate).mean()),
        backward_error=float(np.max(backward_error, where=~is_accurate, initial=0.0)),
    )


def _perturb(batch: Batch, rng: np.random.Generator) -> Batch:
    """Change all inputs by a relative rounding, up or down at random.

    Usually only the z component of a direction (the cosine) is changed. The reason is the half vector of nearly
    opposite directions: the sums of their x and y components are exact in float32, and a change of these components by
    a rounding would turn the half vector. In two cases, x and y are changed, too. If light is transmitted, x and y are
    changed by a relative rounding, because the view is refracted. If the normal is tilted, all components are changed
    by an absolute `_ROUNDING`.
    """

    def perturb_values(values: Floats, low: float = -np.inf, high: float = np.inf) -> Floats:
        return np.clip(values * (1.0 + rng.choice([-_ROUNDING, _ROUNDING], values.shape)), low, high)

    numbers = tuple(
        {
            name: perturb_values(value, *(MODELS[layer.model].parameters[name].hard if name != "mask" else (0.0, 1.0)))
            for name, value in values.items()
        }
        for layer, values in zip(batch.layers, batch.numbers, strict=True)
    )
    tilted = _has_tilted_normal(batch)[:, None]
    # The mask (n, 3) of the components that are changed by a relative rounding.
    moved = (batch.wo * batch.wi < 0.0)[:, 2:] | np.array([False, False, True])
    wo, wi = (
        np.where(tilted, w + rng.choice([-_ROUNDING, _ROUNDING], w.shape), np.where(moved, perturb_values(w), w))
        for w in (batch.wo, batch.wi)
    )
    return replace(batch, wo=wo, wi=wi, numbers=numbers)


def _has_tilted_normal(batch: Batch) -> Bools:
    """Return a mask (n,) of the cases that have a tilted normal."""
    tilted = np.zeros(len(batch.wo), np.bool_)
    for layer, numbers in zip(batch.layers, batch.numbers, strict=True):
        for name, parameter in MODELS[layer.model].parameters.items():
            if parameter.kind == "normal":
                normal = numbers.get(name, np.asarray(layer.constants.get(name, parameter.default)))
                tilted |= (normal[..., :2] != 0.0).any(axis=-1)
    return tilted


def _select_cases(batch: Batch, mask: Bools) -> Batch:
    """Return the cases of a batch that are in a mask (n,)."""
    numbers = tuple({name: value[mask] for name, value in layer.items()} for layer in batch.numbers)
    return replace(batch, wo=batch.wo[mask], wi=batch.wi[mask], numbers=numbers)


def _energy_limit(layers: Sequence[PointLayer]) -> float:
    """Return the largest albedo that a stack may have: the largest bound of the energy of its models."""
    return max(model.energy(model.tokens(layer.tokens)) for layer in layers for model in [MODELS[layer.model]])


def _largest_albedo(layers: Sequence[PointLayer], rng: np.random.Generator, depth: DepthName) -> float:
    """Return a lower bound of the largest albedo over sets of moderate parameters, views and channels.

    The bound of an albedo is its estimate minus five standard errors.
    """
    sets, samples = _ENERGY[depth]
    numbers = moderate_numbers(layers, sets, rng)
    repeated = tuple({name: np.repeat(value, samples, axis=0) for name, value in layer.items()} for layer in numbers)
    largest = 0.0
    for cosine in _VIEWS:
        wo = np.tile([np.sqrt(1.0 - cosine * cosine), 0.0, cosine], (sets * samples, 1))
        bsdf = Batch(tuple(layers), wo, wo, repeated).bsdf()
        wi = sample(bsdf, wo, rng.random((len(wo), 2)))
        density = pdf(bsdf, wo, wi)
        is_sampled = density > 0.0
        weight = evaluate_cosine(bsdf, wo, wi) * (is_sampled / np.where(is_sampled, density, 1.0))[:, None]
        weight = weight.reshape(sets, samples, 3)
        lower_bound = weight.mean(axis=1) - 5.0 * weight.std(axis=1, ddof=1) / np.sqrt(samples)
        largest = max(largest, float(np.where(np.isfinite(lower_bound), lower_bound, np.inf).max()) - 1e-9)
    return largest


def check_scenes(look: Look, cases: Sequence[SceneCase], render: RenderHalves) -> Iterator[CheckFinding]:
    """Render a look in degenerate scenes, and yield a finding for each scene.

    A picture must be finite, not negative, within the bounds of its case, and equal to the picture of its base case.
    """
    pictures: dict[str, Halves] = {}
    for case in cases:
        subject = f"{look.name}, {case.name}"
        try:
            halves = pictures[case.name] = render(_make_task(look, case))
        except (RenderError, WorkerError) as error:
            yield CheckFinding("stability", subject, passed=False, summary=f"no picture: {error}")
            continue
        if case.base_case and case.base_case not in pictures:
            yield CheckFinding(
                "stability", subject, passed=False, summary=f"nothing to compare with: no '{case.base_case}'"
            )
        else:
            yield _check_picture(look, case, subject, halves, pictures.get(case.base_case))


def _check_picture(look: Look, case: SceneCase, subject: str, halves: Halves, reference: Halves | None) -> CheckFinding:
    """Check the picture of a case; `reference` is the picture of its base case, if it has one."""
    a, b, alpha = (np.asarray(array, dtype=np.float64) for array in (halves.a, halves.b, halves.alpha))
    pixels = np.stack([a, b])
    covered = float(alpha.sum())
    mean = float(pixels.mean(axis=(0, -1)).sum()) / covered if covered else 0.0
    faults = []
    if not covered:
        faults.append("the asset covers no pixel")
    if not (np.isfinite(pixels).all() and (pixels >= 0.0).all()):
        faults.append("pixels are not finite or negative")
    if case.is_black and pixels.any():
        faults.append("pixels are not black in darkness")
    figures = {"mean": mean}
    limit = _energy_limit(look_stack(look))
    if case.is_white and mean > limit:
        faults.append(f"{mean:.3g} of the light is reflected, at most {limit:g} would be right")
    text = f"mean {mean:.3g}"
    if reference is not None:
        figures["difference"] = difference = _difference(case.gain, halves, reference)
        text += f", difference {difference:.2f} of {MAX_DIFFERENCE:g}"
        if not difference < MAX_DIFFERENCE:
            faults.append(f"it is not like '{case.base_case}'")
    return CheckFinding("stability", subject, not faults, "; ".join([text, *faults]), figures)


def _difference(gain: float, halves: Halves, reference: Halves) -> float:
    """Return the squared difference of two pictures over the variance of their noise; inf if their coverage differs.

    The first picture should be `gain` times the second, so it is divided by `gain` before the comparison.
    """
    a, b = (np.float64(half) / gain for half in (halves.a, halves.b))
    c, d = np.float64(reference.a), np.float64(reference.b)
    noise = float((((a - b) ** 2 + (c - d) ** 2) / 4.0).sum())
    squares = float((((a + b - c - d) / 2.0) ** 2).sum())
    coverage = float(np.abs(np.float64(halves.alpha) - reference.alpha).sum() / np.float64(reference.alpha).sum())
    return np.inf if coverage > 0.05 else squares / noise if noise else (np.inf if squares else 0.0)


def _make_task(look: Look, case: SceneCase) -> FrameTask:
    """Return the task to render a look in the scene of a case, with the UV sets that the look reads."""
    camera = Camera(30.0, 20.0, case.asset.center, 4.2 * case.asset.radius)
    task = scene_task(Scene.of_look(case.asset, look, prepare_light(case.light), _SIZE, camera), _SAMPLING)
    uv_sets = [
        attribute.attribute for source in task.shaders for attribute in source.attributes if attribute.kind == "uv"
    ]
    asset = Content.store_copy(save_asset(_add_uv_sets(case.asset, uv_sets), tangent_meshes=[0]))
    return frame_task(replace(task, asset=asset), Pose(30.0, 75.0), f"stress {look.name}, {case.name}")


def _add_uv_sets(asset: Asset, uv_sets: Sequence[str]) -> Asset:
    """Return an asset with copies of its UVs under the names of the UV sets that a look reads."""
    mesh = asset.meshes[0]
    uvs = mesh.uvs | dict.fromkeys(uv_sets, mesh.uvs["st"])
    # An empty digest is computed when the asset is saved.
    return replace(asset, meshes=(replace(mesh, uvs=uvs),), digest="")
