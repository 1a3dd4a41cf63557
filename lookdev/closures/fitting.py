"""Compute the fits of `lookdev.closures.fits`: ``python -m lookdev.closures.fitting`` writes their table.

A *mix* is the sum of closures of Cycles that approximates a lobe of a model. The script integrates lobes and mixes over
the light by quadrature, for many views. It takes some seconds and is deterministic.

First the script searches the *shape* of each mix: the alphas and the shares of its closures. A mix and its lobe each
distribute reflected light over directions. The best shape has the smallest L1 distance between these two distributions,
averaged over views. Then the script fits two kinds of functions of the view and the lobe's alpha. The *ratio* is the
lobe's directional albedo divided by the mix's directional albedo. The *typical cosine* is the cosine at which Schlick's
weight (1 - cosine)^5 equals its mean over the lobe.

Views up to 85 degrees have equal weights in a fit; beyond, weights fall. Residuals are the largest and the root mean
square error of the directional albedo for views up to 85 degrees. Errors are relative to the albedo, or to 0.1 where
the albedo is smaller.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.disney import COAT_F0
from lookdev.brdf.fresnel import schlick_weight
from lookdev.brdf.lobes import DirectionPair
from lookdev.brdf.quadrature import half_vector_grid, hemisphere_grid
from lookdev.brdf.rational import Rational
from lookdev.brdf.reflectance import relative_cosine
from lookdev.closures.closure import Closure, closure_cosine, oren_nayar_g
from lookdev.closures.disney import apparent_alphas, shadowing_2012
from lookdev.closures.fits import (
    FITS_FILE,
    AnisotropicShape,
    ClosureFit,
    ClosureShapes,
    ClosureTable,
    CoatShape,
    HighlightShape,
    MixShapes,
    RetroShape,
)
from lookdev.closures.pixar import ggx_share
from lookdev.closures.rational import Degree, RationalProblem, fit_rational
from lookdev.closures.setups import (
    COARSE,
    FULL,
    SHAPE_ANGLES,
    WHITE,
    Albedos,
    LobeGrid,
    LobeSetup,
    coat_setups,
    disney_lobe,
    highlight_setups,
    measure_albedos,
    mix_distance,
    setup_values,
    specular_setups,
    view_at,
)

# The tolerated error of a directional albedo, relative to the albedo or to the floor, whichever is larger.
_TOLERANCE, _FLOOR = 0.01, 0.1
_SHAPE_GRID = replace(FULL, angles=SHAPE_ANGLES)


@dataclass(frozen=True, eq=False)
class FitGoal:
    """A problem for `fit_rational`, and how the errors of its fit are measured.

    `error` maps the values (n,) of a fitted function at the problem's points to relative errors (n,) of albedo. `angle`
    (n,) is the angle of the view at each point, in degrees from the normal.
    """

    problem: RationalProblem
    error: Callable[[Floats], Floats]
    angle: Floats

    def errors(self, rational: Rational) -> Floats:
        """Return the relative errors of albedo that a fit causes at the points with views up to 85 degrees."""
        return self.error(np.asarray(rational(self.problem.x, self.problem.y)))[self.angle <= 85.0]


def _tolerance_factor(angle: Floats) -> Floats:
    """Return a factor for tolerances (n,): 1 for views up to 85 degrees; beyond, it doubles with each degree."""
    return np.where(angle > 85.0, np.exp2(angle - 84.0), 1.0)


def ratio_goal(a: Albedos, x: Floats, target: Floats) -> FitGoal:
    """Return the goal for a factor of a closure's weight, a function of `x` and alpha with the values `target`.

    `a` has the albedos of n setups. `x` and `target` are (n,).
    """
    # An error of the factor is an equal relative error of albedo. It counts less where the albedo is below the floor.
    relative = a.unweighted / np.maximum(a.unweighted, _FLOOR)
    tolerance = _TOLERANCE * target * _tolerance_factor(a.angle)
    return FitGoal(
        RationalProblem(x, a.alpha, target, tolerance), lambda values: np.abs(values / target - 1.0) * relative, a.angle
    )


def grazing_goal(a: Albedos, factor: Floats) -> FitGoal:
    """Return the goal for the ratio of the albedos of lobe and mix, both with Schlick's weight as the Fresnel term.

    `a` has the albedos of n setups. The ratio is divided by `factor`, (n,), which the closure's weight already
    contains.
    """
    # Where the albedo with Schlick's weight is below the floor, the relative tolerance is larger, up to 30 %.
    relative = np.maximum(np.minimum(a.weighted / _FLOOR, 1.0), _TOLERANCE / 0.3)
    target = a.weighted / a.mix_weighted / factor
    problem = RationalProblem(a.cosine, a.alpha, target, _TOLERANCE * target / relative * _tolerance_factor(a.angle))
    return FitGoal(problem, lambda values: np.abs(values / target - 1.0) * relative, a.angle)


def cosine_goal(a: Albedos) -> FitGoal:
    """Return the goal for the typical cosine, at which Schlick's weight (1 - cosine)^5 equals its mean over the lobe.

    `a` has the albedos of n setups.
    """
    # `allowed` is the tolerance of this mean. The fifth root of the mean is 1 minus the cosine. The fifth root also
    # converts the tolerance.
    mean = a.weighted / a.unweighted
    allowed = _TOLERANCE * np.maximum(mean, _FLOOR / a.unweighted)
    root = mean**0.2
    tolerance = np.minimum((mean + allowed) ** 0.2 - root, 0.3) * _tolerance_factor(a.angle)
    problem = RationalProblem(a.cosine, a.alpha, 1.0 - root, tolerance)
    return FitGoal(problem, lambda values: np.abs(schlick_weight(values) - mean) / allowed * _TOLERANCE, a.angle)


def diffuse_goal(
    grid: LobeGrid, closure: Closure, base_color: float, roughness: Sequence[float], **parameters: float
) -> FitGoal:
    """Return the goal for the weight of a closure that replaces Disney's diffuse lobe with these parameters.

    The weight is a function of the view's cosine and of roughness. `base_color` is the value of a grey base colour.
    `roughness` has the values for which the weight is fitted.
    """
    wi, weight = hemisphere_grid(96)
    rows = []
    for angle in grid.angles:
        wo = view_at(angle)
        closure_albedo = closure_cosine(closure, wo, wi)[:, 0] @ weight
        for level in roughness:
            lobe = disney_lobe("diffuse", wo, baseColor=base_color * WHITE, roughness=level, **parameters)
            rows.append(
                (
                    angle,
                    wo[2],
                    level,
                    closure_albedo,
                    (lobe.evaluate(DirectionPair.from_directions(wo, wi))[:, 0] * wi[:, 2]) @ weight,
                )
            )
    angle, x, y, closure_albedo, albedo = np.array(rows).T
    floored = np.maximum(albedo, _FLOOR)
    problem = RationalProblem(
        x, y, albedo / closure_albedo, _TOLERANCE * floored / closure_albedo * _tolerance_factor(angle)
    )
    return FitGoal(problem, lambda values: np.abs(values * closure_albedo - albedo) / floored, angle)


def retro_goal(grid: LobeGrid) -> FitGoal:
    """Return the goal for `oren_nayar_g`, the integral of Oren and Nayar's rough term, over the cosine of the view."""
    x = np.cos(np.radians(grid.angles))
    target = np.asarray(oren_nayar_g(x))
    problem = RationalProblem(x, np.zeros_like(x), target, _TOLERANCE * _tolerance_factor(grid.angles))
    # An albedo contains this integral times sigma / pi, or less, with sigma at most 1.
    return FitGoal(problem, lambda values: np.abs(values - target) / np.pi, grid.angles)


def retro_shape() -> RetroShape:
    """Search the strength at which the Oren-Nayar closure resembles Disney's diffuse lobe best.

    The strength is the closure's roughness at grazing views for a lobe of roughness 1.
    """
    wi, weight = hemisphere_grid(48)
    lobes = []
    for angle, roughness in product((50.0, 65.0, 75.0, 83.0), (0.5, 0.75, 1.0)):
        wo = view_at(angle)
        lobe = disney_lobe("diffuse", wo, baseColor=0.5 * WHITE, roughness=roughness)
        energy = np.asarray(lobe.evaluate(DirectionPair.from_directions(wo, wi)))[:, 0] * wi[:, 2] * weight
        lobes.append((wo, roughness, energy / energy.sum()))

    def distances(strength: float) -> list[float]:
        # The values are half the L1 distances between closure and lobe, both normalised, for each view and roughness.
        values = []
        for wo, roughness, lobe in lobes:
            sigma = strength * roughness * (1.0 - wo[2]) ** 3  # as in `lookdev.closures.disney`
            closure = Closure("rough_diffuse", WHITE, f0=0.5 * WHITE, roughness=sigma)
            energy = closure_cosine(closure, wo, wi)[:, 0] * weight
            values.append(float(0.5 * np.abs(energy / energy.sum() - lobe).sum()))
        return values

    best = min((round(0.02 * k, 2) for k in range(40)), key=lambda strength: float(np.mean(distances(strength))))
    return {"strength": best, "distance": _summary(distances(best))}


def coat_shape() -> CoatShape:
    """Search the three GGX lobes that resemble the clearcoat lobe best, with the same powers and shares for each gloss.

    Powers are searched in steps of 0.05, shares in steps of 0.1; see `lookdev.closures.disney.coat_mix`.
    """
    best: CoatShape = {"powers": [], "shares": []}
    smallest = np.inf
    grid = replace(FULL, angles=SHAPE_ANGLES, gloss=np.array([0.0, 0.5, 0.9, 1.0]))
    powers = [round(0.05 * k, 2) for k in range(2, 21)]
    # The mixes of these setups are not used: any shape will do.
    lobes = _normalised_lobes(
        coat_setups({"shares": [1.0], "powers": [1.0]}, grid),
        lambda alpha: [Closure("metal", WHITE, alpha**k, alpha**k, f0=COAT_F0 * WHITE) for k in powers],
    )
    tenths = range(1, 9)
    shares = np.array([(a, b, 10 - a - b) for a in tenths for b in tenths if a + b < 10]) / 10.0
    for columns in combinations(range(len(powers)), 3):
        distances = np.mean(
            [0.5 * np.abs(shares @ parts[list(columns)] - whole).sum(axis=1) for whole, parts in lobes], 0
        )
        index = int(distances.argmin())
        if distances[index] < smallest:
            smallest = float(distances[index])
            best = {"powers": [powers[k] for k in columns], "shares": shares[index].tolist()}
    return best


def highlight_shape() -> HighlightShape:
    """Search the mix of Beckmann and GGX that resembles Pixar's highlight best.

    The numbers are the width of GGX relative to Beckmann, and the growth of GGX's share with alpha; see
    `lookdev.closures.pixar.highlight_mix`.
    """
    widths = (0.8, 0.85, 0.9, 0.95, 1.0)
    # The mixes of these setups are not used: any shape will do.
    setups = highlight_setups({"start": 1.0, "slope": 1.0, "width": 1.0}, grid=_SHAPE_GRID)
    lobes = _normalised_lobes(
        setups,
        lambda alpha: [
            Closure("beckmann", WHITE, alpha, alpha),
            *(Closure("ggx", WHITE, k * alpha, k * alpha) for k in widths),
        ],
    )

    def mean_distance(shape: HighlightShape) -> float:
        column = 1 + widths.index(shape["width"])
        total = 0.0
        for setup, (whole, parts) in zip(setups, lobes, strict=True):
            share = np.clip(shape["slope"] * (setup.alpha - shape["start"]), 0.0, 1.0)
            total += 0.5 * np.abs((1.0 - share) * parts[0] + share * parts[column] - whole).sum()
        return total

    shapes: list[HighlightShape] = [
        {"start": start, "slope": slope, "width": width}
        for start in (0.1, 0.125, 0.15, 0.175, 0.2)
        for slope in (1.4, 1.6, 1.8, 2.0, 2.2, 2.4)
        for width in widths
    ]
    return min(shapes, key=mean_distance)


def _normalised_lobes(
    setups: Sequence[LobeSetup], closures: Callable[[float], Sequence[Closure]]
) -> list[tuple[Floats, Floats]]:
    """Return, for each setup, the distributions over directions of the light that its lobe and some closures reflect.

    The result has pairs (whole, parts): the distribution of the lobe, (n,), and the distributions, (k, n), of the k
    closures that `closures` returns for the setup's alpha. A distribution has n values, at the nodes of a quadrature;
    the sum of the values is 1.
    """
    lobes = []
    for setup in setups:
        wi, weight = half_vector_grid(setup.view, setup.width, COARSE)
        whole = setup_values(setup, wi)[0] * weight
        parts = np.stack([closure_cosine(closure, setup.wo, wi)[:, 0] * weight for closure in closures(setup.alpha)])
        lobes.append((whole / whole.sum(), parts / parts.sum(axis=1, keepdims=True)))
    return lobes


def make_shapes() -> MixShapes:
    """Search the shapes of the mixes for clearcoat and highlight, with their distances from the lobes."""
    coat, highlight = coat_shape(), highlight_shape()
    coat["distance"] = _summary([mix_distance(setup) for setup in coat_setups(coat, _SHAPE_GRID)])
    highlight["distance"] = _summary([mix_distance(setup) for setup in highlight_setups(highlight, grid=_SHAPE_GRID)])
    return {"clearcoat": coat, "highlight": highlight}


def make_fits(
    shapes: MixShapes, grid: LobeGrid = FULL, load_fit: Callable[[str], Rational] | None = None
) -> dict[str, tuple[Rational, FitGoal]]:
    """Return the fits for mixes of these shapes by name, each as a pair of the fitted function and its goal.

    With `load_fit`, no fit is computed: `load_fit` is called with the name of a fit, and returns the fitted function.
    """
    fits: dict[str, tuple[Rational, FitGoal]] = {}

    def add(name: str, goal: FitGoal, numerator: Degree, denominator: Degree) -> Rational:
        rational = load_fit(name) if load_fit else fit_rational(goal.problem, numerator, denominator)
        fits[name] = rational, goal
        return rational

    add("sheen", diffuse_goal(grid, Closure("sheen", WHITE), 0.0, [0.0], sheen=1.0), Degree(4, 0, 4), _CONSTANT)
    add("retro", retro_goal(grid), Degree(4, 0, 4), _CONSTANT)
    levels = [0.0, 0.25, 0.5, 0.75, 1.0]
    add(
        "subsurface",
        diffuse_goal(grid, Closure("diffuse", WHITE), 1.0, levels, subsurface=1.0),
        Degree(2, 2, 4),
        Degree(2, 0, 2),
    )

    a = measure_albedos(specular_setups("2014", grid))
    add("specular_2014", ratio_goal(a, a.cosine, a.unweighted / a.mix), Degree(2, 2, 2), Degree(2, 2, 2))
    add("specular_cosine_2014", cosine_goal(a), Degree(3, 3, 3), Degree(2, 2, 2))
    add("specular_grazing_2014", grazing_goal(a, np.ones(1)), Degree(2, 2, 2), Degree(2, 2, 2))

    a = measure_albedos(specular_setups("2012", grid))
    typical = add("specular_cosine_2012", cosine_goal(a), Degree(3, 3, 3), Degree(2, 2, 2))(a.cosine, a.alpha)
    # The closure's weight contains the shadowing of 2012 at the view and at a typical light. The fits are the factors
    # that remain.
    roughness = np.tile(grid.roughness, len(grid.angles))
    factors = (shadowing_2012(cosine, roughness) for cosine in (a.cosine, np.clip(typical, 0.0, 1.0)))
    shadowing = np.prod([*factors], axis=0)
    add("specular_2012", ratio_goal(a, a.cosine, a.unweighted / a.mix / shadowing), Degree(3, 3, 4), Degree(3, 3, 3))
    add("specular_grazing_2012", grazing_goal(a, shadowing), Degree(3, 3, 4), Degree(3, 3, 3))

    a = measure_albedos(coat_setups(shapes["clearcoat"], grid))
    add("clearcoat", ratio_goal(a, a.cosine, a.unweighted / a.mix), Degree(3, 2, 3), Degree(2, 1, 2))

    a = measure_albedos(highlight_setups(shapes["highlight"], grid=grid))
    add("highlight", _relative_goal(a), Degree(3, 3, 4), Degree(3, 3, 3))
    add("highlight_cosine", cosine_goal(a), Degree(4, 4, 4), Degree(2, 2, 2))
    straight, *refracted = (
        measure_albedos(highlight_setups(shapes["highlight"], ior_minus_one, grid))
        for ior_minus_one in (0.0, *grid.iors_minus_one)
    )
    straight_fit = add("transmitted", _relative_goal(straight), Degree(3, 3, 4), Degree(3, 3, 3))
    add("transmitted_tilt", _tilt_goal(shapes["highlight"], refracted, straight_fit), Degree(1, 1, 2), _CONSTANT)
    return fits


def anisotropic_shape(fits: Mapping[str, Rational]) -> AnisotropicShape:
    """Search the numbers with which `apparent_alphas` predicts the albedo of anisotropic lobes best.

    `fits` has the fits of isotropic lobes by name. Albedos of dielectrics (F0 0.04) and of metals (F0 1) are compared.
    """
    cases = []
    for roughness, anisotropic, angle, azimuth in product(
        (0.3, 0.45, 0.6), (0.3, 0.6, 0.9), (40, 60, 75, 85), (0, 45, 90)
    ):
        wo = view_at(angle, azimuth)
        parameters = {"roughness": roughness, "anisotropic": anisotropic}
        aspect = np.sqrt(1.0 - 0.9 * anisotropic)
        x, y = roughness**2 / aspect, roughness**2 * aspect
        # A white metal has a Fresnel term of 1. With specular 0, F0 is 0 and the Fresnel term is Schlick's weight.
        whole = disney_lobe("specular", wo, metallic=1.0, baseColor=WHITE, **parameters)
        weighted = disney_lobe("specular", wo, specular=0.0, **parameters)
        albedos = measure_albedos([LobeSetup(angle, wo, wo, y, y, whole, weighted, (Closure("ggx", WHITE, x, y),))])
        cases.append(((x, y), wo, albedos.unweighted, albedos.weighted, albedos.mix))

    def errors(shape: AnisotropicShape) -> Floats:
        deviations = []
        for alphas, wo, whole, weighted, mix in cases:
            apparent = apparent_alphas(alphas, wo, shape)
            mean = schlick_weight(np.asarray(fits["specular_cosine_2014"](wo[2], apparent.cosine))) * apparent.skew
            reflected = fits["specular_2014"](wo[2], apparent.ratio) * mix
            for f0 in (0.04, 1.0):
                value, target = reflected * (f0 + (1.0 - f0) * mean), f0 * whole + (1.0 - f0) * weighted
                deviations.append(np.abs(value - target) / np.maximum(target, _FLOOR))
        return np.concatenate(deviations)

    shapes: list[AnisotropicShape] = [
        {"azimuth": azimuth, "skew": skew, "skew_rise": rise}
        for azimuth in (0.0, 0.2, 0.4, 0.6, 0.8)
        for skew in (0.1, 0.2, 0.3, 0.4, 0.5)
        for rise in (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75)
    ]
    best = min(shapes, key=lambda shape: float(np.mean(errors(shape) ** 2)))
    return {**best, "residual": _residual(errors(best))}


_CONSTANT = Degree(0, 0, 0)  # the degree of a denominator that is constant


def _relative_goal(a: Albedos) -> FitGoal:
    """Return the goal for the ratio of albedos, a smooth function of `relative_cosine` and alpha."""
    return ratio_goal(a, np.asarray(relative_cosine(a.cosine, a.alpha)), a.unweighted / a.mix)


def _tilt_goal(shape: HighlightShape, refracted: Sequence[Albedos], straight_fit: Rational) -> FitGoal:
    """Return the goal for the change of a transmitted highlight's ratio if refraction bends the view.

    The change is divided by the tilt, by alpha and by the share of GGX. The quotient is a function of the tilt and the
    cosine of the refracted view. The tilt is 1 minus the cosine between the view and the refracted view. `refracted`
    has the albedos for each index of refraction, and `straight_fit` is the ratio without refraction.
    """
    columns = zip(*(vars(albedos).values() for albedos in refracted), strict=True)
    a = Albedos(*map(np.concatenate, columns))
    factor = a.tilt * a.alpha * np.asarray(ggx_share(a.alpha, shape))
    a = Albedos(*(column[factor > 0.0] for column in vars(a).values()))
    factor = factor[factor > 0.0]
    base = np.asarray(straight_fit(relative_cosine(a.cosine, a.alpha), a.alpha))
    whole = _relative_goal(a)
    problem = RationalProblem(
        a.tilt, a.cosine, (whole.problem.target - base) / factor, whole.problem.tolerance / factor
    )
    return FitGoal(problem, lambda values: whole.error(base + factor * values), a.angle)


def fit_entry(rational: Rational, error: Floats) -> ClosureFit:
    """Return the entry of a fit in the table; `error` (n,) has the errors of albedo, for the residual."""
    return {"numerator": rational.numerator, "denominator": rational.denominator, "residual": _residual(error)}


def _residual(error: Floats) -> dict[str, float]:
    """Return the largest of errors, ``"largest"``, and their root mean square, ``"rms"``."""
    largest, rms = float(np.abs(error).max()), float(np.sqrt(np.mean(error * error)))
    return {"largest": _round_figures(largest), "rms": _round_figures(rms)}


def _summary(distances: Sequence[float]) -> dict[str, float]:
    """Return the largest of the distances between mixes and lobes, ``"largest"``, and their mean, ``"mean"``."""
    return {"largest": _round_figures(max(distances)), "mean": _round_figures(float(np.mean(distances)))}


def _round_figures(value: float) -> float:
    """Return a number rounded to three significant figures."""
    return float(f"{value:.3g}")


def make_table() -> ClosureTable:
    """Search all shapes and compute all fits; return the table of them."""
    mixes = make_shapes()
    fits = make_fits(mixes)
    anisotropic = anisotropic_shape({name: rational for name, (rational, _) in fits.items()})
    shapes: ClosureShapes = {**mixes, "retro": retro_shape(), "anisotropic": anisotropic}
    return {
        "shapes": shapes,
        "fits": {name: fit_entry(rational, goal.errors(rational)) for name, (rational, goal) in fits.items()},
    }


def main() -> None:
    """Compute the table and write it to its file."""
    text = json.dumps(make_table(), indent=1)
    # Put each innermost list of numbers on one line.
    text = re.sub(r"\[[^][]+\]", lambda row: " ".join(row[0].split()).replace("[ ", "[").replace(" ]", "]"), text)
    FITS_FILE.write_text(text + "\n")


if __name__ == "__main__":
    main()
