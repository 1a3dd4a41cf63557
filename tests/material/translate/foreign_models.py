"""Directional albedos of foreign shading models, by their own definitions, and of random inputs, compared with ours.

- UsdPreviewSurface Specification, Pixar; usd_preview_surface.mtlx and previewSurface.glslfx.
- MaterialX 1.39, libraries/bxdf: node graphs of standard_surface, open_pbr_surface and gltf_pbr; libraries/pbrlib and
  "MaterialX Physically Based Shading Nodes": closures.
- Gulbrandsen, O. 2014. Artist Friendly Metallic Fresnel. JCGT 3(4).
- Turquin, E. 2019. Practical multiple scattering compensation for microfacet models.

GGX has Smith's height-correlated shadowing and Turquin's compensation by the albedo of the lobe with a Fresnel term of
1. A layer withholds from what is beneath its own directional albedo, the mean over RGB. All albedos are integrated,
where MaterialX has fits. Surfaces are opaque, thick and isotropic; random ones have no sheen, and no reflection with a
hue beyond that of metals.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from operator import itemgetter
from typing import Any

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf import StackLayer, evaluate_cosine, stack_bsdf
from lookdev.brdf.fresnel import schlick_weight
from lookdev.brdf.lobes import DirectionPair
from lookdev.brdf.microfacet import gtr2_aniso
from lookdev.brdf.parameters import complete
from lookdev.brdf.quadrature import half_vector_grid, hemisphere_grid
from lookdev.material.translate import TRANSLATIONS, translate_layer

Fresnel = Callable[[Floats], Floats]
"""From cosines (n,) to reflectances (n, 3)."""

_CELLS = (40, 24)


def view(degrees: float) -> Floats:
    theta = np.radians(degrees)
    return np.array([np.sin(theta), 0.0, np.cos(theta)])


@lru_cache(maxsize=64)
def _ggx(alpha: float, degrees: float) -> tuple[Floats, Floats]:
    """Return cosines to the half vectors, (n,), and weights (n,) whose sum is the albedo with a Fresnel term of 1."""
    wo = view(degrees)
    wi, weight = half_vector_grid(wo, alpha, _CELLS)
    d = DirectionPair.from_directions(wo, wi)
    i, o = wi[:, 2], wo[2]
    # Heitz 2014, eq. 99, over 4 cos_theta_i cos_theta_o.
    visible = 0.5 / (
        i * np.sqrt(alpha**2 + (1.0 - alpha**2) * o * o) + o * np.sqrt(alpha**2 + (1.0 - alpha**2) * i * i)
    )
    return np.asarray(d.cos_theta_d), np.asarray(gtr2_aniso(d.wm, alpha, alpha) * visible * i * weight)


def lobe(roughness: float, degrees: float, fresnel: Fresnel) -> Floats:
    """Return the albedo, (3,), of a GGX lobe, compensated (Turquin 2019, eqs. 14 and 16)."""
    cosines, weight = _ggx(max(roughness * roughness, 1e-3), degrees)
    f, whole = fresnel(cosines), weight.sum()
    return np.asarray(((1.0 + f * (1.0 - whole) / whole) * f * weight[:, None]).sum(axis=0))


def schlick(f0: Any, f90: Any) -> Fresnel:
    def fresnel(cosines: Floats) -> Floats:
        weight = np.asarray(schlick_weight(cosines))[:, None]
        return np.asarray(f0 * (1.0 - weight) + f90 * weight * np.ones(3))

    return fresnel


def dielectric(ior: float) -> Fresnel:
    def fresnel(c: Floats) -> Floats:
        g2 = ior * ior + c * c - 1.0
        g = np.sqrt(np.maximum(g2, 0.0))
        f = 0.5 * ((g - c) / (g + c)) ** 2 * (1.0 + (((g + c) * c - 1.0) / ((g - c) * c + 1.0)) ** 2)
        return np.where(g2 < 0.0, 1.0, f)[:, None] * np.ones(3)

    return fresnel


def conductor(reflectivity: Floats, edge: Floats) -> Fresnel:
    """Return the Fresnel term of a metal by its two colours (Gulbrandsen 2014)."""
    r = np.clip(reflectivity, 0.0, 0.99)
    root = np.sqrt(r)
    n = (1.0 - edge) * (1.0 + root) / (1.0 - root) + edge * (1.0 - r) / (1.0 + r)
    k2 = np.maximum(((n + 1.0) ** 2 * r - (n - 1.0) ** 2) / (1.0 - r), 0.0)

    def fresnel(cosines: Floats) -> Floats:
        c2 = (cosines * cosines)[:, None]
        s2 = 1.0 - c2
        t0 = n * n - k2 - s2
        both = np.sqrt(t0 * t0 + 4.0 * n * n * k2)
        a = np.sqrt(np.maximum(0.5 * (both + t0), 0.0))
        t1, t2 = both + c2, 2.0 * a * cosines[:, None]
        rs = (t1 - t2) / (t1 + t2)
        t3, t4 = c2 * both + s2 * s2, t2 * s2
        return np.asarray(0.5 * rs * (1.0 + (t3 - t4) / (t3 + t4)))

    return fresnel


def layer_over(top: Floats, base: Floats, weight: float = 1.0) -> Floats:
    """MaterialX's `layer`."""
    return weight * top + (1.0 - weight * float(top.mean())) * base


def preview_surface(p: dict[str, Any], degrees: float) -> Floats:
    at_normal = ((1.0 - p["ior"]) / (1.0 + p["ior"])) ** 2
    color, metallic = np.asarray(p["diffuseColor"]), p["metallic"]
    if p["useSpecularWorkflow"] == "1":
        f0, f90, diffuse = np.asarray(p["specularColor"]), np.ones(3), color
    else:
        f90 = 1.0 - metallic + metallic * color
        f0 = (1.0 - metallic) * at_normal * f90 + metallic * f90
        diffuse = (1.0 - metallic) * color
    base = layer_over(lobe(p["roughness"], degrees, schlick(f0, f90)), diffuse)
    return layer_over(lobe(p["clearcoatRoughness"], degrees, schlick(at_normal, 1.0)), base, p["clearcoat"])


def oren_nayar(roughness: float, degrees: float) -> float:
    """MaterialX's `oren_nayar_diffuse_bsdf` of a white colour, without energy compensation."""
    wi, weight = hemisphere_grid(48)
    wo = view(degrees)
    variance = roughness * roughness
    s = np.maximum(wi @ wo - wi[:, 2] * wo[2], 0.0) / np.maximum(wi[:, 2], wo[2])
    f = 1.0 - 0.5 * variance / (variance + 0.33) + 0.45 * variance / (variance + 0.09) * s
    return float((f * wi[:, 2] / np.pi) @ weight)


def sheen_bsdf(roughness: float, degrees: float) -> float:
    """MaterialX's `sheen_bsdf` of Estevez and Kulla (2017)."""
    wi, weight = hemisphere_grid(96)
    wo = view(degrees)
    d = DirectionPair.from_directions(wo, wi)
    inverse = 1.0 / max(roughness, 0.005)
    distribution = (2.0 + inverse) * (1.0 - np.asarray(d.wm)[:, 2] ** 2) ** (0.5 * inverse) / (2.0 * np.pi)
    return float((distribution / (4.0 * (wi[:, 2] + wo[2] - wi[:, 2] * wo[2])) * wi[:, 2]) @ weight)


def standard_surface(p: dict[str, Any], degrees: float) -> Floats:
    over, gamma = p["coat"], 1.0 + p["coat"] * p["coat_affect_color"]
    roughness = p["specular_roughness"]
    roughness += (1.0 - roughness) * p["coat_affect_roughness"] * over * p["coat_roughness"]
    base_color, specular_color = np.asarray(p["base_color"]), np.asarray(p["specular_color"])
    diffuse = p["base"] * base_color**gamma * oren_nayar(p["diffuse_roughness"], degrees)
    diffuse = (1.0 - p["subsurface"]) * diffuse + p["subsurface"] * np.asarray(p["subsurface_color"]) ** gamma
    if p["sheen"]:
        albedo = sheen_bsdf(p["sheen_roughness"], degrees)
        diffuse = p["sheen"] * albedo * np.asarray(p["sheen_color"]) + (1.0 - p["sheen"] * albedo) * diffuse
    reflected = lobe(roughness, degrees, dielectric(p["specular_IOR"]))
    # The tint is that of the reflection; the white part is withheld.
    specular = p["specular"] * specular_color * reflected + (1.0 - p["specular"] * reflected) * diffuse
    metal = lobe(roughness, degrees, conductor(p["base"] * base_color, p["specular"] * specular_color))
    mixed = p["metalness"] * metal + (1.0 - p["metalness"]) * specular
    attenuated = mixed * (1.0 - over + over * np.asarray(p["coat_color"]))
    return layer_over(lobe(p["coat_roughness"], degrees, dielectric(p["coat_IOR"])), attenuated, over)


def gltf_pbr(p: dict[str, Any], degrees: float) -> Floats:
    color, metallic = np.asarray(p["base_color"]), p["metallic"]
    at_normal = np.minimum(((1.0 - p["ior"]) / (1.0 + p["ior"])) ** 2 * np.asarray(p["specular_color"]), 1.0)
    top = lobe(p["roughness"], degrees, schlick(at_normal * p["specular"], p["specular"]))
    mixed = metallic * lobe(p["roughness"], degrees, schlick(color, 1.0)) + (1.0 - metallic) * layer_over(top, color)
    return layer_over(lobe(p["clearcoat_roughness"], degrees, dielectric(1.5)), mixed, p["clearcoat"])


def open_pbr_surface(p: dict[str, Any], degrees: float) -> Floats:
    over, weight, metalness = p["coat_weight"], p["specular_weight"], p["base_metalness"]
    base_roughness, coated = p["specular_roughness"], p["coat_roughness"]
    roughness = (1.0 - over) * base_roughness + over * min(1.0, 2.0 * coated**4 + base_roughness**4) ** 0.25
    color, specular_color = np.asarray(p["base_color"]), np.asarray(p["specular_color"])
    under = np.asarray(p["subsurface_color"])
    diffuse = (1.0 - p["subsurface_weight"]) * p["base_weight"] * color + p["subsurface_weight"] * under
    quotient = p["specular_ior"] / p["coat_ior"]
    eta = (1.0 - over) * p["specular_ior"] + over * max(quotient, 1.0 / quotient)
    root = np.sqrt(min(weight * ((eta - 1.0) / (eta + 1.0)) ** 2, 0.99999)) * np.sign(eta - 1.0)
    reflected = lobe(roughness, degrees, dielectric((1.0 + root) / (1.0 - root)))
    # The tint is that of the reflection; the white part is withheld.
    opaque = specular_color * reflected + (1.0 - reflected) * diffuse
    # With a white specular_color, the F82 curve is Schlick's.
    metal = weight * lobe(roughness, degrees, schlick(p["base_weight"] * color, 1.0))
    mixed = metalness * metal + (1.0 - metalness) * opaque
    f0 = ((p["coat_ior"] - 1.0) / (p["coat_ior"] + 1.0)) ** 2
    inside = 1.0 - (1.0 - f0) / p["coat_ior"] ** 2
    estimate = (1.0 - p["subsurface_weight"]) * color + p["subsurface_weight"] * under
    estimate = metalness * color * weight + (1.0 - metalness) * estimate
    darker = over * p["coat_darkening"]
    mixed = mixed * (1.0 - darker + darker * (1.0 - inside) / (1.0 - estimate * inside))
    mixed = mixed * (1.0 - over + over * np.asarray(p["coat_color"]))
    return layer_over(lobe(coated, degrees, dielectric(p["coat_ior"])), mixed, over)


VIEWS = (0.0, 20.0, 40.0, 60.0, 75.0)
"""In degrees."""

Rng = np.random.Generator


Draw = Callable[[Rng], Any]


def _number(low: float = 0.0, high: float = 1.0) -> Draw:
    return lambda rng: float(rng.uniform(low, high))


def _color(rng: Rng) -> tuple[float, ...]:
    return tuple(rng.uniform(0.0, 1.0, 3).tolist())


def _draw_often(*usual: float) -> Draw:
    """Return a function that draws one of the usual numbers, or a random one."""
    return lambda rng: float(rng.choice([*usual, rng.uniform()]))


_PREVIEW_SURFACE: dict[str, Draw] = {
    "diffuseColor": _color,
    "roughness": _number(),
    "metallic": _draw_often(0.0, 0.0, 1.0),
    "clearcoat": _draw_often(0.0),
    "clearcoatRoughness": _number(),
    "ior": _number(1.0, 2.2),
}
_STANDARD_SURFACE: dict[str, Draw] = {
    "base": _number(0.5),
    "base_color": _color,
    "metalness": _draw_often(0.0, 0.0, 1.0),
    "specular": _draw_often(1.0),
    "specular_roughness": _number(),
    "specular_IOR": _number(1.0, 2.2),
    "subsurface": _draw_often(0.0, 0.0),
    "subsurface_color": _color,
    "coat": _draw_often(0.0),
    "coat_color": lambda rng: (_draw_often(1.0)(rng),) * 3,
    "coat_roughness": _number(),
    "coat_IOR": _number(1.0, 2.2),
    "coat_affect_color": _draw_often(0.0),
    "coat_affect_roughness": _draw_often(0.0),
}
_GLTF_PBR: dict[str, Draw] = {
    "base_color": _color,
    "metallic": _draw_often(0.0, 0.0, 1.0),
    "roughness": _number(),
    "specular": _draw_often(1.0),
    "ior": _number(1.0, 2.2),
    "clearcoat": _draw_often(0.0),
    "clearcoat_roughness": _number(),
}
_OPEN_PBR_SURFACE: dict[str, Draw] = {
    "base_weight": _number(0.5),
    "base_color": _color,
    "base_metalness": _draw_often(0.0, 0.0, 1.0),
    "specular_weight": _draw_often(1.0),
    "specular_roughness": _number(),
    "specular_ior": _number(1.0, 2.2),
    "subsurface_weight": _draw_often(0.0, 0.0),
    "subsurface_color": _color,
    "coat_weight": _draw_often(0.0),
    "coat_roughness": _number(),
    "coat_ior": _number(1.0, 2.2),
    "coat_darkening": _draw_often(0.0, 1.0),
}


def _draw(draws: Mapping[str, Draw], rng: Rng) -> dict[str, Any]:
    values = {name: draw(rng) for name, draw in draws.items()}
    if draws is _PREVIEW_SURFACE and rng.random() < 0.25:
        values |= {"useSpecularWorkflow": "1", "metallic": 0.0}
        # Plastics and metals; not more than all light is reflected.
        color = values["diffuseColor"]
        plastic = {"specularColor": (_number(0.0, 1.0 - max(color))(rng),) * 3}
        values |= plastic if rng.random() < 0.5 else {"specularColor": color, "diffuseColor": (0.0,) * 3}
    return values


@dataclass(frozen=True)
class Foreign:
    """Random inputs, the albedo by definition, how metallic they are, and up to which view (degrees) metals agree."""

    draws: Mapping[str, Draw]
    albedo: Callable[[dict[str, Any], float], Floats]
    metal: Callable[[dict[str, Any]], float]
    metals_agree: float


def _metallic(p: dict[str, Any]) -> float:
    return 1.0 if len(set(p["specularColor"])) > 1 else p["metallic"]


FOREIGN = {
    "preview_surface": Foreign(_PREVIEW_SURFACE, preview_surface, _metallic, 40.0),
    "standard_surface": Foreign(_STANDARD_SURFACE, standard_surface, itemgetter("metalness"), 20.0),
    "open_pbr_surface": Foreign(_OPEN_PBR_SURFACE, open_pbr_surface, itemgetter("base_metalness"), 60.0),
    "gltf_pbr": Foreign(_GLTF_PBR, gltf_pbr, itemgetter("metallic"), 60.0),
}
"""By the name of the translation."""


@dataclass(frozen=True, eq=False)
class Compared:
    """Albedos of one set seen from `VIEWS`, (views, 3), by definition and of the translation."""

    inputs: dict[str, Any]
    metal: float
    own: Floats
    ours: Floats

    @property
    def error(self) -> Floats:
        return np.abs(self.ours - self.own).max(axis=-1)


def compare(name: str, count: int, seed: int) -> list[Compared]:
    """Compare the albedos of random sets."""
    rng, foreign, parameters = np.random.default_rng(seed), FOREIGN[name], TRANSLATIONS[name].parameters
    albedos = []
    for _ in range(count):
        values = _draw(foreign.draws, rng)
        whole = {input_name: parameter.default for input_name, parameter in parameters.items()} | values
        reference = np.stack([foreign.albedo(whole, angle) for angle in VIEWS])
        ours = np.stack([translated_albedo(name, values, angle) for angle in VIEWS])
        albedos.append(Compared(values, foreign.metal(whole), reference, ours))
    return albedos


def translated_albedo(name: str, inputs: dict[str, Any], degrees: float) -> Floats:
    """Return the directional albedo, (3,), of the layers that a model with some inputs translates to."""
    stack = translate_layer(StackLayer(name, complete(name, TRANSLATIONS[name].parameters, inputs)))
    bsdf, wo = stack_bsdf(stack), view(degrees)
    # A grid for each width of the coats is dense where they peak; the ground is even.
    total = np.zeros(3)
    for lobe in bsdf.lobes(wo):
        if not np.any(lobe.share) or not np.any(lobe.weight):
            continue
        wi, weight = half_vector_grid(wo, float(np.max(lobe.values.get("alpha_x", 1.0))), _CELLS)
        alone = type(bsdf)(lambda _, lobe=lobe: (lobe,))
        total += (evaluate_cosine(alone, wo, wi) * weight[:, None]).sum(axis=0)
    return total
