"""Setups of the fits: lobes of the models from all views, and the mixes of closures that stand for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf import MODELS, complete_parameters
from lookdev.brdf.angles import spherical_direction
from lookdev.brdf.disney import COAT_F0
from lookdev.brdf.frames import TiltedFrame, UprightFrame, mirror_across_surface
from lookdev.brdf.fresnel import schlick_weight
from lookdev.brdf.lobes import DirectionPair, Lobe
from lookdev.brdf.pixar.partition import REFLECTED_LOBES, TRANSMITTED_LOBES, Partition, PartitionLobe, partition_lobes
from lookdev.brdf.quadrature import half_vector_grid
from lookdev.closures.closure import Closure, closure_cosine
from lookdev.closures.disney import coat_mix
from lookdev.closures.fits import CoatShape, HighlightShape
from lookdev.closures.pixar import highlight_mix

WHITE = np.ones(3)
SHAPE_ANGLES = np.array([0.0, 30.0, 50.0, 65.0])
"""Angles of the view, in degrees, at which shapes are compared."""

COARSE = (24, 16)
_CELLS = (48, 32)
"""Cells of `half_vector_grid` for the search of shapes, and for albedos."""


@dataclass(frozen=True, eq=False)
class LobeGrid:
    """Values at which lobes are integrated; angles of views and cones are in degrees."""

    angles: Floats
    roughness: Floats
    gloss: Floats
    cones: Floats
    iors_minus_one: Floats


FULL = LobeGrid(
    np.array([0, 10, 20, 28, 35, 42, 48, 54, 58, 62, 65, *range(68, 84, 2), 83.5, 85, 86, 87, 88, 89, 89.5, 89.97]),
    np.array([0.0, 0.05, 0.1, *np.linspace(0.15, 1.0, 18)]),
    np.linspace(0.0, 1.0, 11),
    np.array([0.25, 0.5, 1, 1.5, 2, 3, 4, 6, 8, 10, 12, 15, 18, 21, 25, 30, 35, 40, 45, 50, 54]),
    np.array([0.05, 0.2, 0.33, 0.5, 0.8, 1.5]),
)


@dataclass(frozen=True, eq=False)
class LobeSetup:
    """A lobe at one view, and the closures that stand for it.

    angle : degrees from the normal to the view `wo`.
    view : `wo`, refracted if the lobe transmits.
    width : the scale of the quadrature, that of the narrowest lobe.
    alpha : the variable of the fit.
    unweighted, weighted : the lobe with a Fresnel term of 1, and with one that is Schlick's weight.
    mix : closures, without the ratio that is fitted.
    """

    angle: float
    wo: Floats
    view: Floats
    width: float
    alpha: float
    unweighted: Lobe
    weighted: Lobe
    mix: Sequence[Closure]


@dataclass(frozen=True, eq=False)
class Albedos:
    """Directional albedos of setups, (n,): of the lobe and of the mix, each without and with Schlick's weight.

    `angle` and `alpha` are those of the setups. `cosine` is that of `LobeSetup.view` to the normal, and `tilt` is 1
    minus the cosine between the view and the refracted view.
    """

    angle: Floats
    cosine: Floats
    tilt: Floats
    alpha: Floats
    unweighted: Floats
    weighted: Floats
    mix: Floats
    mix_weighted: Floats


def specular_setups(variant: str, grid: LobeGrid = FULL) -> list[LobeSetup]:
    """Return setups of a variant of Disney's isotropic specular lobe."""
    return [
        LobeSetup(
            angle,
            wo := view_at(angle),
            wo,
            alpha := max(0.001, roughness * roughness),
            alpha,
            disney_lobe("specular", wo, metallic=1.0, baseColor=WHITE, roughness=roughness, variant=variant),
            disney_lobe("specular", wo, specular=0.0, roughness=roughness, variant=variant),
            (Closure("ggx", WHITE, alpha, alpha),),
        )
        for angle in grid.angles
        for roughness in grid.roughness
    ]


def coat_setups(shape: CoatShape, grid: LobeGrid = FULL) -> list[LobeSetup]:
    """Return setups of the clearcoat."""
    setups = []
    for angle in grid.angles:
        wo = view_at(angle)
        for gloss in grid.gloss:
            lobe = disney_lobe("clearcoat", wo, clearcoat=1.0, clearcoatGloss=gloss)
            width = 0.1 + (0.001 - 0.1) * gloss
            mix = coat_mix(width, shape)
            closures = [
                Closure("metal", 0.25 * share * WHITE, alpha, alpha, f0=COAT_F0 * WHITE) for share, alpha in mix
            ]
            setups.append(LobeSetup(angle, wo, wo, width, width, lobe, lobe, closures))
    return setups


def highlight_setups(
    shape: HighlightShape, ior_minus_one: float | None = None, grid: LobeGrid = FULL
) -> list[LobeSetup]:
    """Return setups of Pixar's highlights: reflected, or transmitted if `ior_minus_one` is a number."""
    setups = []
    for angle in grid.angles:
        wo = view = view_at(angle)
        if ior_minus_one is not None:
            x = wo[0] / (1.0 + ior_minus_one)
            view = np.array([x, 0.0, np.sqrt((1.0 - x) * (1.0 + x))]) if ior_minus_one else wo
        for cone in grid.cones:
            whole, weighted = (_highlight(cone, ior_minus_one, normal, wo) for normal in (1.0, 0.0))
            # This is 1 / sqrt(power).
            alpha = float(np.sin(np.radians(cone)) / np.sqrt(np.log(10.0)))
            mix = highlight_mix(np.array(alpha), view, UprightFrame(), ior_minus_one is not None, shape)
            closures = [replace(closure, weight=closure.weight * WHITE) for closure in mix]
            # A refraction is narrower than the lobe in the plane of incidence.
            width = alpha if ior_minus_one is None else alpha * float(np.sqrt(view[2]))
            setups.append(LobeSetup(angle, wo, view, width, alpha, whole, weighted, closures))
    return setups


def measure_albedos(setups: Sequence[LobeSetup]) -> Albedos:
    """Integrate the lobes and mixes of setups over the light."""
    rows = []
    for setup in setups:
        wi, weight = half_vector_grid(setup.view, setup.width, _CELLS)
        values = setup_values(setup, wi)
        whole, weighted, mix = values @ weight
        mix_weighted = (values[2] * schlick_weight(DirectionPair.from_directions(setup.view, wi).cos_theta_d)) @ weight
        if setup.unweighted.transmits:
            # A refraction is symmetric about its own normal, and twice as wide as half vectors.
            wi, weight = half_vector_grid(view_at(0.0), setup.width, _CELLS)
            light = -np.asarray(TiltedFrame(setup.view).from_local(wi))
            mix = sum(closure_cosine(closure, setup.wo, light)[:, 0] for closure in setup.mix) @ weight
        rows.append(
            (setup.angle, setup.view[2], 1.0 - setup.wo @ setup.view, setup.alpha, whole, weighted, mix, mix_weighted)
        )
    return Albedos(*np.array(rows).T)


def mix_distance(setup: LobeSetup) -> float:
    """Return half the L1 distance of a mix from its lobe over the light, both normalised: 0 to 1."""
    wi, weight = half_vector_grid(setup.view, setup.width, COARSE)
    whole, _, mix = setup_values(setup, wi) * weight
    return float(0.5 * np.abs(whole / whole.sum() - mix / mix.sum()).sum())


def setup_values(setup: LobeSetup, wi: Floats) -> Floats:
    """Return the unweighted lobe, the weighted lobe and the mix, times the cosine, (3, n).

    `wi`, (n, 3), are directions of light on the viewer's side, mirrored where the lobe transmits.
    """
    directions = DirectionPair.from_directions(setup.wo, wi)
    light = np.asarray(mirror_across_surface(wi)) if setup.unweighted.transmits else wi
    mix = sum(closure_cosine(closure, setup.wo, light)[:, 0] for closure in setup.mix)
    lobes = (np.asarray(lobe.evaluate(directions))[:, 0] * wi[:, 2] for lobe in (setup.unweighted, setup.weighted))
    return np.stack([*lobes, np.asarray(mix)])


def view_at(angle: float, azimuth: float = 0.0) -> Floats:
    """Return the unit direction, (3,), at an angle from the normal and an azimuth around it, in degrees."""
    return spherical_direction(np.radians(angle), np.radians(azimuth))


def disney_lobe(name: str, wo: Floats, **parameters: object) -> Lobe:
    """Return a lobe of Disney's BRDF with these parameters, at the view `wo`, (3,)."""
    lobes = MODELS["disney"].bsdf(complete_parameters("disney", parameters)).lobes(wo)
    return next(lobe for lobe in lobes if lobe.name == name)


def _highlight(cone: float, ior_minus_one: float | None, normal: float, wo: Floats) -> Lobe:
    terms = dict.fromkeys(
        (*REFLECTED_LOBES, *TRANSMITTED_LOBES), PartitionLobe(normal * WHITE, WHITE, cone, ior_minus_one or 0.0)
    )
    lobes = partition_lobes(Partition(wo, terms, {"diffuse": UprightFrame(), "highlight": UprightFrame()}, 1.0))
    return next(
        lobe for lobe in lobes if lobe.name == ("specular" if ior_minus_one is None else "specularTransmission")
    )
