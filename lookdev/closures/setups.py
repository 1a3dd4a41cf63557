"""Make the data of `lookdev.closures.fitting`: lobes of the models, mixes of closures, and the albedos of both.

A *setup* is a lobe at one view with its *mix*, the closures of Cycles that approximate the lobe. Integrals over the
light are computed by quadrature.
"""

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
"""The colour white."""

SHAPE_ANGLES = np.array([0.0, 30.0, 50.0, 65.0])
"""Angles of the view, in degrees from the normal, at which the shapes of lobes and mixes are compared."""

COARSE = (24, 16)
"""The numbers of cells of `half_vector_grid`, along slope and azimuth, with which shapes are compared."""

_CELLS = (48, 32)  # the numbers of cells of `half_vector_grid` with which albedos are computed


@dataclass(frozen=True, eq=False)
class LobeGrid:
    """The values of the view and of lobe parameters for which lobes are integrated.

    `angles` are angles of the view from the normal, in degrees. `roughness` and `gloss` are Disney's parameters. A cone
    in `cones` is the angle, in degrees, at which Pixar's highlight has fallen to a tenth. `iors_minus_one` are indices
    of refraction of transmitted highlights, minus 1.
    """

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
"""The grid of the stored fits. Angles are denser where albedos change fast: towards grazing views."""


@dataclass(frozen=True, eq=False)
class LobeSetup:
    """A lobe at one view, and the closures that approximate it.

    angle : the angle of `wo` from the normal, in degrees.
    wo : the direction (3,) to the viewer.
    view : the direction `wo`, refracted if the lobe transmits, (3,).
    width : the alpha of the narrowest one among lobe and closures; the quadrature adapts to it.
    alpha : the alpha of the lobe, a variable of the fits.
    unweighted : the lobe with a Fresnel term of 1.
    weighted : the lobe with Schlick's weight (1 - cosine)^5 as its Fresnel term.
    mix : the closures, without the fitted ratio in their weights.
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
    """Directional albedos of n setups; all arrays are (n,).

    `unweighted` and `mix` are the albedos of lobe and mix with a Fresnel term of 1. `weighted` and `mix_weighted` are
    the albedos of lobe and mix with Schlick's weight as the Fresnel term. `angle` and `alpha` are as in the setups.
    `cosine` is the cosine between `LobeSetup.view` and the normal. `tilt` is 1 minus the cosine between `LobeSetup.wo`
    and `LobeSetup.view`.
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
    """Return setups of Disney's isotropic specular lobe, in variant ``"2012"`` or ``"2014"``, with a GGX closure."""
    # A white metal has a Fresnel term of 1. With specular 0, F0 is 0 and the Fresnel term is Schlick's weight.
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
    """Return setups of Disney's clearcoat with a mix of this shape. Lobe and mix have the coat's own Fresnel term."""
    setups = []
    for angle in grid.angles:
        wo = view_at(angle)
        for gloss in grid.gloss:
            lobe = disney_lobe("clearcoat", wo, clearcoat=1.0, clearcoatGloss=gloss)
            width = 0.1 + (0.001 - 0.1) * gloss  # the alpha of GTR1, as in `lookdev.brdf.disney`
            mix = coat_mix(width, shape)
            closures = [
                Closure("metal", 0.25 * share * WHITE, alpha, alpha, f0=COAT_F0 * WHITE) for share, alpha in mix
            ]
            setups.append(LobeSetup(angle, wo, wo, width, width, lobe, lobe, closures))
    return setups


def highlight_setups(
    shape: HighlightShape, ior_minus_one: float | None = None, grid: LobeGrid = FULL
) -> list[LobeSetup]:
    """Return setups of Pixar's highlights with a mix of this shape.

    If `ior_minus_one` is None, the highlights are reflected. Otherwise they are transmitted, and `ior_minus_one` is the
    index of refraction minus 1.
    """
    setups = []
    for angle in grid.angles:
        wo = view = view_at(angle)
        if ior_minus_one is not None:
            x = wo[0] / (1.0 + ior_minus_one)
            view = np.array([x, 0.0, np.sqrt((1.0 - x) * (1.0 + x))]) if ior_minus_one else wo
        for cone in grid.cones:
            whole, weighted = (_highlight(cone, ior_minus_one, normal, wo) for normal in (1.0, 0.0))
            # This is 1 / sqrt(power), where exp(-power sin^2 cone) = 1 / 10.
            alpha = float(np.sin(np.radians(cone)) / np.sqrt(np.log(10.0)))
            mix = highlight_mix(np.array(alpha), view, UprightFrame(), ior_minus_one is not None, shape)
            closures = [replace(closure, weight=closure.weight * WHITE) for closure in mix]
            # A refraction is narrower than the lobe in the plane of incidence.
            width = alpha if ior_minus_one is None else alpha * float(np.sqrt(view[2]))
            setups.append(LobeSetup(angle, wo, view, width, alpha, whole, weighted, closures))
    return setups


def measure_albedos(setups: Sequence[LobeSetup]) -> Albedos:
    """Integrate the lobes and mixes of setups over the light, and return their directional albedos."""
    rows = []
    for setup in setups:
        wi, weight = half_vector_grid(setup.view, setup.width, _CELLS)
        values = setup_values(setup, wi)
        whole, weighted, mix = values @ weight
        mix_weighted = (values[2] * schlick_weight(DirectionPair.from_directions(setup.view, wi).cos_theta_d)) @ weight
        if setup.unweighted.transmits:
            # A mix that transmits is symmetric about its own normal, the refracted view, and twice as wide as half
            # vectors. Its grid is the grid of a reflection seen from above, tilted to this normal.
            wi, weight = half_vector_grid(view_at(0.0), setup.width, _CELLS)
            light = -np.asarray(TiltedFrame(setup.view).from_local(wi))
            mix = sum(closure_cosine(closure, setup.wo, light)[:, 0] for closure in setup.mix) @ weight
        rows.append(
            (setup.angle, setup.view[2], 1.0 - setup.wo @ setup.view, setup.alpha, whole, weighted, mix, mix_weighted)
        )
    return Albedos(*np.array(rows).T)


def mix_distance(setup: LobeSetup) -> float:
    """Return how far a mix is from its lobe: half the L1 distance over the light, both normalised, from 0 to 1."""
    wi, weight = half_vector_grid(setup.view, setup.width, COARSE)
    whole, _, mix = setup_values(setup, wi) * weight
    return float(0.5 * np.abs(whole / whole.sum() - mix / mix.sum()).sum())


def setup_values(setup: LobeSetup, wi: Floats) -> Floats:
    """Return the values (3, n), times the cosine, of the unweighted lobe, the weighted lobe and the mix.

    `wi`, (n, 3), are directions to the light. If the lobe transmits, `wi` are mirrored to the viewer's side.
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
    """Return the lobe `name` of Disney's BRDF with these parameters, for the direction `wo`, (3,), to the viewer."""
    lobes = MODELS["disney"].bsdf(complete_parameters("disney", parameters)).lobes(wo)
    return next(lobe for lobe in lobes if lobe.name == name)


def _highlight(cone: float, ior_minus_one: float | None, normal: float, wo: Floats) -> Lobe:
    """Return Pixar's highlight of a cone in degrees, reflected or transmitted as in `highlight_setups`.

    `normal` is the reflectance at normal incidence: with 1, the Fresnel term is 1; with 0, it is Schlick's weight.
    """
    terms = dict.fromkeys(
        (*REFLECTED_LOBES, *TRANSMITTED_LOBES), PartitionLobe(normal * WHITE, WHITE, cone, ior_minus_one or 0.0)
    )
    lobes = partition_lobes(Partition(wo, terms, {"diffuse": UprightFrame(), "highlight": UprightFrame()}, 1.0))
    return next(
        lobe for lobe in lobes if lobe.name == ("specular" if ior_minus_one is None else "specularTransmission")
    )
