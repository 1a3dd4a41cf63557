"""Layers that foreign models are made of: a diffuse ground, glossy coats, and what both are computed from.

- Karis, B. 2013. Real Shading in Unreal Engine 4. SIGGRAPH course notes.
- Turquin, E. 2019. Practical multiple scattering compensation for microfacet models.
- MaterialX Physically Based Shading Nodes, 1.39.

A ground is Pixar's model without an interface, which is Lambert's reflection; a coat is Disney's specular lobe, in mode
``"coat"``: it withholds from what is beneath what it reflects, as MaterialX's `layer`. Disney's own diffuse lobe is not
Lambert's, nothing is withheld from it, and its clearcoat is a quarter as strong as a coat.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from lookdev.brdf import StackLayer
from lookdev.brdf.rational import Rational
from lookdev.brdf.reflectance import ggx_reflectance
from lookdev.brdf.vectors import Array, Real, mean, mix, mix_color, same, scale

DATA = Path(__file__).parent / "data" / "fits.json"
"""The file of the fits that `lookdev.material.translate.fitting` makes."""

WHITE_EDGE = 0.2
"""The root of a dielectric's reflectance at normal incidence from which on its edge is white: an index of 1.5."""

WHITE: Array = np.ones(3)

# The cosine at which Schlick's weight is its cosine-weighted mean over the hemisphere, 1/21.
_MEAN_COSINE: Array = np.asarray(1.0 - 21.0 ** (-0.2))
# Below this alpha, less than 0.004 is scattered again.
_SMOOTH = 0.03


@cache
def fit(name: str) -> Rational:
    """Return a fit of the table, a function of one number."""
    entry = json.loads(DATA.read_text())[name]
    return Rational(entry["numerator"], entry["denominator"])


def f0_of_ior(ior: Real) -> Real:
    """Reflectance of a dielectric at normal incidence, (...), by its index of refraction (...), at least 0."""
    root = (1.0 - ior) / (1.0 + ior)
    return root * root


def edge_of_f0(f0: Real) -> Real:
    """Return the reflectance at grazing incidence with which Schlick's term is nearest to a dielectric's, (...)."""
    share = np.minimum(np.sqrt(f0) * (1.0 / WHITE_EDGE), 1.0)
    return np.where(share > 0.999, 1.0, np.clip(fit("edge")(share), 0.0, 1.0))


def largest(color: Array) -> Array:
    """Return the largest channel of colours (..., 3)."""
    return np.maximum(np.maximum(color[..., 0], color[..., 1]), color[..., 2])


def ground(
    color: Array, normal: Array, presence: Real, *, back: Real = 0.0, clear: Real = 0.0, ior: Real = 1.0
) -> StackLayer:
    """Return what is beneath coats: of a colour (..., 3), it reflects and transmits, and has no interface.

    The part `clear` of light passes straight through, bent by `ior` as in a thin shell. The rest is scattered evenly,
    the part `back` of it to the other side.
    """
    nothing = np.asarray(0.0)
    parameters = {
        "surfaceColor": np.clip(color, 0.0, 1.0),
        "roughness": nothing,
        "normalScale": nothing,
        "grazingScale": nothing,
        "diffuseNormal": normal,
        "highlightNormal": normal,
        "presence": presence,
        "back": back,
        "clear": clear,
        "ior": np.clip(ior, 1.0, 10.0),
    }
    return StackLayer("pixar", parameters, name="ground")


def coat(
    name: str, f0: Array, f90: Real, roughness: Real, normal: Array, mask: Real = 1.0, anisotropic: Real = 0.0
) -> StackLayer:
    """Return a GGX lobe whose reflectance rises by Schlick's term from `f0`, (..., 3), at most `f90`, to `f90`, (...).

    alpha is the square of `roughness`.
    """
    return StackLayer(
        "disney",
        {
            "metallic": np.asarray(1.0),
            "baseColor": np.clip(scale(f0, 1.0 / np.where(f90 + np.zeros(()) > 0.0, f90, 1.0)), 0.0, 1.0),
            "roughness": roughness,
            "anisotropic": anisotropic,
            "normal": normal,
        },
        mask=mask * f90,
        mode="coat",
        name=name,
    )


@dataclass(frozen=True)
class Interface:
    """A rough interface.

    Its reflectance rises by Schlick's term from `f0`, (..., 3), to `f90`, (...), at most 1.
    """

    f0: Array
    f90: Real
    roughness: Real

    @classmethod
    def of_ior(cls, ior: Real, roughness: Real, tint: Array = WHITE, weight: Real = 1.0) -> Interface:
        """Return a dielectric, whose reflection has a tint (..., 3) and a weight (...).

        Of an index near 1, Schlick's term is lower at grazing angles than 1, too.
        """
        f0 = f0_of_ior(ior)
        return cls(scale(tint, weight * f0), largest(tint) * weight * edge_of_f0(f0), roughness)

    def withheld(self) -> Real:
        """Return about the mean over all views, (...), of what the lobe of `coat` withholds."""
        grazing = ggx_reflectance(_MEAN_COSINE, np.maximum(self.roughness * self.roughness, 0.001), np.zeros(()))
        return mean(self.f0) * (1.0 - self._rough("lost") - grazing) + self.f90 * grazing

    def scattered(self) -> Array:
        """Return the light, (..., 3), that it reflects beside the lobe of `coat`; it is nearly diffuse.

        It is scattered several times (Turquin 2019), or shadowed by heights that are not correlated.
        """
        lost, hidden = self._rough("lost"), self._rough("hidden")
        typical = self.f0 + (np.expand_dims(self.f90 + np.zeros(()), -1) - self.f0) * (1.0 / 21.0)
        return scale(typical * typical, lost) + scale(typical * (1.0 - typical), hidden)

    def _rough(self, name: str) -> Array:
        alpha = self.roughness * self.roughness + np.zeros(())
        return np.where(alpha > _SMOOTH, fit(name)(alpha), 0.0)

    def over(self, color: Array) -> Array:
        """Return the light, (..., 3), that leaves a diffuse colour (..., 3) under it, and what it scatters."""
        again = self.scattered()
        return scale(color, 1.0 - self.withheld() - mean(again)) + again

    def mixed(self, other: Interface, weight: Real) -> Interface:
        """Return the mixture with another of the same roughness, whose weight is (...)."""
        return Interface(mix_color(self.f0, other.f0, weight), mix(self.f90, other.f90, weight), self.roughness)

    def tinted(self, tint: Array) -> Interface:
        """Return the interface under a colour (..., 3)."""
        return Interface(self.f0 * tint, self.f90 * largest(tint), self.roughness)


def mixture(
    color: Array, dielectric: Interface, metal: Interface, metalness: Real, weight: Real = 1.0
) -> tuple[Array, Interface]:
    """Mix a dielectric over a diffuse colour, (..., 3), with a metal; return the light that emerges, and the mixture.

    All that the metal reflects is multiplied by `weight`, (...).
    """
    emerging = dielectric.over(color)
    if not same(metalness, 0.0):
        emerging = mix_color(emerging, scale(metal.scattered(), weight), metalness)
    return emerging, dielectric.mixed(metal.tinted(scale(WHITE, weight)), metalness)


def surface(
    emerging: Array,
    interface: Interface,
    normal: Array,
    *,
    presence: Real = 1.0,
    kept: Real = 1.0,
    roughness: Real | None = None,
    anisotropic: Real = 0.0,
    back: Real = 0.0,
    clear: Real = 0.0,
    ior: Real = 1.0,
) -> list[StackLayer]:
    """Return a ground and a coat on it.

    Parameters
    ----------
    emerging : (..., 3)
        Light that leaves the ground through the coat.
    presence, kept : (...)
        How much there is of the ground, and of the coat.
    roughness : (...)
        That of an anisotropic lobe; None: that of `interface`.
    """
    color = scale(emerging, 1.0 / np.maximum(1.0 - interface.withheld(), 0.01))
    rough = interface.roughness if roughness is None else roughness
    return [
        ground(color, normal, presence, back=back, clear=clear, ior=ior),
        coat("specular", interface.f0, interface.f90, rough, normal, kept, anisotropic),
    ]


def varnish(name: str, ior: Real, roughness: Real, normal: Array, mask: Real, anisotropic: Real = 0.0) -> StackLayer:
    """Return a clear coat of an index of refraction, (...)."""
    interface = Interface.of_ior(ior, roughness)
    return coat(name, interface.f0, interface.f90, roughness, normal, mask, anisotropic)


def aspect_of(anisotropy: Real) -> Real:
    """Return Disney's `anisotropic` where the alphas' quotient is ``1 - anisotropy``, at least 0.1."""
    return np.minimum(anisotropy * (1.0 / 0.9), 1.0)


def fabric(color: Array, weight: Real, sheen: Array, name: str, roughness: Real) -> Array:
    """Return a diffuse colour (..., 3) under a sheen, of a weight (...) and a colour (..., 3).

    It is the mean over all views; `name` is that of the fit of the sheen's albedo by its roughness.
    """
    if same(weight, 0.0):
        return color
    albedo = weight * np.maximum(fit(name)(roughness), 0.0)
    return scale(color, 1.0 - albedo) + scale(sheen, albedo)
