"""The layers to which foreign models are translated, a diffuse base and glossy coats, and formulas of their parameters.

- Karis, B. 2013. Real Shading in Unreal Engine 4. SIGGRAPH course notes.
- Turquin, E. 2019. Practical multiple scattering compensation for microfacet models.
- MaterialX Physically Based Shading Nodes, 1.39.

The base is a layer of Pixar's model without an interface, which reflects as Lambert's model. A coat is a layer with
Disney's specular lobe in mode ``"coat"``: the light that it reflects does not reach the layers beneath, as with
MaterialX's `layer`. One layer of Disney's model cannot replace both. Its diffuse lobe is not Lambert's, its specular
lobe withholds no light from the diffuse one, and its clearcoat has a quarter of a coat's strength.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lookdev.brdf import StackLayer
from lookdev.brdf.rational import Rational, load_rational
from lookdev.brdf.reflectance import ggx_reflectance
from lookdev.brdf.vectors import Array, Real, are_equal, mean, mix, mix_color, scale

FITS_FILE = Path(__file__).parent / "data" / "fits.json"
"""The file of fits, which `lookdev.material.translate.fitting` writes."""

MIN_SQRT_F0_OF_UNIT_F90 = 0.2
"""The smallest sqrt(f0) for which f90 of a dielectric is 1; the index of refraction is then 1.5.

f0 and f90 are the reflectances at normal and at grazing incidence of Schlick's term.
"""

WHITE: Array = np.ones(3)
"""The colour white."""

# The cosine at which Schlick's weight equals its own cosine-weighted mean over the hemisphere, 1/21.
_MEAN_COSINE: Array = np.asarray(1.0 - 21.0 ** (-0.2))
# Below this alpha, less than 0.004 of the light is scattered several times.
_MIN_SCATTERING_ALPHA = 0.03


def load_fit(name: str) -> Rational:
    """Return a fit of `FITS_FILE`, a function of one number, by its name; see `lookdev.material.translate.fitting`."""
    return load_rational(FITS_FILE, name)


def f0_of_ior(ior: Real) -> Real:
    """Return a dielectric's reflectance at normal incidence, (...), for its index of refraction (...) >= 0."""
    root = (1.0 - ior) / (1.0 + ior)
    return root * root


def f90_of_f0(f0: Real) -> Real:
    """Return f90, (...), of the Schlick term closest to the Fresnel term of a dielectric with `f0` (fit ``"edge"``)."""
    share = np.minimum(np.sqrt(f0) * (1.0 / MIN_SQRT_F0_OF_UNIT_F90), 1.0)
    return np.where(share > 0.999, 1.0, np.clip(load_fit("edge")(share), 0.0, 1.0))


def max_channel(color: Array) -> Array:
    """Return the largest channel of colours (..., 3)."""
    return np.maximum(np.maximum(color[..., 0], color[..., 1]), color[..., 2])


def base_layer(
    color: Array, normal: Array, presence: Real, *, back: Real = 0.0, clear: Real = 0.0, ior: Real = 1.0
) -> StackLayer:
    """Return the layer beneath the coats, which reflects and transmits light of a colour (..., 3).

    The share `clear` of the light passes straight through, refracted by `ior` as in a thin shell. The rest is scattered
    as by Lambert's surface; the share `back` of the rest goes to the other side. The layer has no interface that
    reflects.
    """
    zero = np.asarray(0.0)
    parameters = {
        "surfaceColor": np.clip(color, 0.0, 1.0),
        "roughness": zero,
        "normalScale": zero,
        "grazingScale": zero,
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
    """Return a coat: a layer with a GGX lobe whose reflectance rises by Schlick's term from `f0` to `f90`.

    `f0`, (..., 3), is at most `f90`, (...). alpha is the square of `roughness`.
    """
    # A metal's reflectance rises from its base colour to 1. The mask multiplies this by f90. Here and below, adding
    # np.zeros(()) turns a number into an array.
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
    """A rough surface of a dielectric or a metal, which reflects a part of the light: the coat on a base.

    Its reflectance rises by Schlick's term from `f0`, (..., 3), to `f90`, (...), at most 1. alpha is the square of
    `roughness`, (...).
    """

    f0: Array
    f90: Real
    roughness: Real

    @classmethod
    def from_ior(cls, ior: Real, roughness: Real, tint: Array = WHITE, weight: Real = 1.0) -> Interface:
        """Return the interface of a dielectric whose reflection has a tint (..., 3) and a weight (...).

        For an index near 1, `f90` is below 1.
        """
        f0 = f0_of_ior(ior)
        return cls(scale(tint, weight * f0), max_channel(tint) * weight * f90_of_f0(f0), roughness)

    def mean_withheld(self) -> Real:
        """Return, approximately, the share of light (...) that the coat withholds from the base, averaged over views.

        The share is the light that the lobe of `coat` reflects. It does not include `scattered_light`.
        """
        # `grazing` is the mean albedo with Schlick's weight, (1 - cosine)^5, as the Fresnel term.
        grazing = ggx_reflectance(_MEAN_COSINE, np.maximum(self.roughness * self.roughness, 0.001), np.zeros(()))
        return mean(self.f0) * (1.0 - self._roughness_fit("lost") - grazing) + self.f90 * grazing

    def scattered_light(self) -> Array:
        """Return the share of light, (..., 3), that the interface reflects but the lobe of `coat` lacks.

        It is nearly diffuse and has two parts: light that scatters several times (Turquin 2019), and light that the
        lobe shadows in excess, because its shadowing is not height-correlated.
        """
        # Let F be the mean of the Fresnel term, and E the lobe's albedo for F = 1. With correlated shadowing, this
        # albedo is E + hidden, and the remaining light is scattered twice: F (E + hidden) + F^2 (1 - E - hidden) in
        # all. Without the lobe's own F E, this is F^2 lost + F (1 - F) hidden, where lost is 1 - E.
        multiple, overshadowed = self._roughness_fit("lost"), self._roughness_fit("hidden")
        mean_term = self.f0 + (np.expand_dims(self.f90 + np.zeros(()), -1) - self.f0) * (1.0 / 21.0)
        return scale(mean_term * mean_term, multiple) + scale(mean_term * (1.0 - mean_term), overshadowed)

    def _roughness_fit(self, name: str) -> Array:
        """Return the value (...) of the fit ``"lost"`` or ``"hidden"`` at alpha, or 0 where alpha is very small."""
        alpha = self.roughness * self.roughness + np.zeros(())
        return np.where(alpha > _MIN_SCATTERING_ALPHA, load_fit(name)(alpha), 0.0)

    def emerging_light(self, color: Array) -> Array:
        """Return the diffuse light, (..., 3), that a base of a diffuse colour (..., 3) sends through the interface.

        `scattered_light` is added to it.
        """
        scattered = self.scattered_light()
        return scale(color, 1.0 - self.mean_withheld() - mean(scattered)) + scattered

    def mix_with(self, other: Interface, weight: Real) -> Interface:
        """Return the mixture with `other`, of the same roughness. The weight of `other` is `weight`, (...)."""
        return Interface(mix_color(self.f0, other.f0, weight), mix(self.f90, other.f90, weight), self.roughness)

    def tint_by(self, tint: Array) -> Interface:
        """Return the interface whose reflectance is multiplied by a colour (..., 3)."""
        return Interface(self.f0 * tint, self.f90 * max_channel(tint), self.roughness)


def mix_with_metal(
    color: Array, dielectric: Interface, metal: Interface, metalness: Real, weight: Real = 1.0
) -> tuple[Array, Interface]:
    """Mix a dielectric over a diffuse colour, (..., 3), with a metal.

    Returns the diffuse light, (..., 3), that emerges through the interface (see `Interface.emerging_light`), and the
    mixed interface. `metalness`, (...), is the share of the metal; `weight`, (...), multiplies the metal's reflection.
    """
    emerging_light = dielectric.emerging_light(color)
    if not are_equal(metalness, 0.0):
        emerging_light = mix_color(emerging_light, scale(metal.scattered_light(), weight), metalness)
    return emerging_light, dielectric.mix_with(metal.tint_by(scale(WHITE, weight)), metalness)


def base_and_coat(
    emerging_light: Array,
    interface: Interface,
    normal: Array,
    *,
    presence: Real = 1.0,
    coat_presence: Real | None = None,
    roughness: Real | None = None,
    anisotropic: Real = 0.0,
    back: Real = 0.0,
    clear: Real = 0.0,
    ior: Real = 1.0,
) -> list[StackLayer]:
    """Return two layers: the base, and a coat on it with the reflectance of `interface`.

    Parameters
    ----------
    emerging_light : (..., 3)
        The diffuse light that leaves the base through the coat.
    presence, coat_presence : (...)
        The presence of the base and the presence of the coat, by default the same.
    roughness : (...)
        The roughness of the coat if it is anisotropic; by default the roughness of `interface`.
    back, clear, ior : (...)
        As in `base_layer`.
    """
    # Mode "coat" withholds light from the base. The division makes up for it, on average over views.
    color = scale(emerging_light, 1.0 / np.maximum(1.0 - interface.mean_withheld(), 0.01))
    rough = interface.roughness if roughness is None else roughness
    coat_presence = presence if coat_presence is None else coat_presence
    return [
        base_layer(color, normal, presence, back=back, clear=clear, ior=ior),
        coat("specular", interface.f0, interface.f90, rough, normal, coat_presence, anisotropic),
    ]


def dielectric_coat(
    name: str, ior: Real, roughness: Real, normal: Array, mask: Real, anisotropic: Real = 0.0
) -> StackLayer:
    """Return the coat of a clear dielectric with an index of refraction `ior`, (...)."""
    interface = Interface.from_ior(ior, roughness)
    return coat(name, interface.f0, interface.f90, roughness, normal, mask, anisotropic)


def disney_anisotropy(anisotropy: Real) -> Real:
    """Return the value of Disney's `anisotropic` for which alpha_y / alpha_x is ``1 - anisotropy``, at least 0.1."""
    return np.minimum(anisotropy * (1.0 / 0.9), 1.0)


def color_under_sheen(color: Array, weight: Real, sheen: Array, name: str, roughness: Real) -> Array:
    """Return the diffuse colour (..., 3) that replaces a colour (..., 3) under a lobe of sheen, averaged over views.

    The sheen has the weight `weight` (...) and the colour `sheen` (..., 3). `name` is the fit of the sheen's mean
    albedo, a function of `roughness` (...).
    """
    if are_equal(weight, 0.0):
        return color
    albedo = weight * np.maximum(load_fit(name)(roughness), 0.0)
    return scale(color, 1.0 - albedo) + scale(sheen, albedo)
