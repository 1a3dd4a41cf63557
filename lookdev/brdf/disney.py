"""Disney's principled BRDF as published in 2012, and with the addenda of 2014.

- Burley, B. 2012. Physically Based Shading at Disney. SIGGRAPH course notes, version 3 (2014), sections 5.1 to 5.6,
  addenda.
- Hanrahan, P. and Krueger, W. 1993. Reflection from Layered Surfaces due to Subsurface Scattering. SIGGRAPH.

The model has three lobes: `diffuse` (diffuse reflection, subsurface shape and sheen), `specular` (GTR2) and `clearcoat`
(GTR1). As published, ``specular = 0`` does not remove the specular lobe: Schlick's term still rises to 1 at grazing
angles. The parameters for a normal of each lobe, for the general GTR and for thin films follow suggestions of section 6
and appendix B. Two more parameters extend the published model: `presence` is the coverage of the surface, and
`fresnel` selects the Fresnel term of metals, as published or exact.

Section numbers in this file are those of Burley 2012.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lookdev.brdf import microfacet as mf
from lookdev.brdf.film import film_reflectance, metal_film_reflectance
from lookdev.brdf.frames import Frame, frame_of
from lookdev.brdf.fresnel import schlick_blend, schlick_weight
from lookdev.brdf.lobes import Bsdf, DirectionPair, Lobe
from lookdev.brdf.metal import is_exact, metal_fresnel, metal_parameters
from lookdev.brdf.model import Model, Preview
from lookdev.brdf.parameters import PRESENCE, Parameter, normal_parameter, parameters_by_name, token_parameter
from lookdev.brdf.reflectance import ggx_albedo, ggx_reflectance
from lookdev.brdf.vectors import TINY, Array, Parameters, Real, are_equal, mean, mix, mix_color, reflect, scale

COAT_F0 = 0.04
"""The reflectance at normal incidence of the clearcoat, whose index of refraction is 1.5 (section 5.4)."""


def _tint(base_color: Array) -> Array:
    """Return the base colour divided by its luminance, or white where the luminance is 0 (section 5.1)."""
    luminance = 0.3 * base_color[..., 0] + 0.6 * base_color[..., 1] + 0.1 * base_color[..., 2]
    positive = np.expand_dims(luminance > 0.0, -1)
    return np.where(positive, base_color / np.where(positive, np.expand_dims(luminance, -1), 1.0), np.ones(3))


def _diffuse(p: Parameters, wo: Array, frame: Frame) -> Lobe:
    """Build the diffuse lobe, with sheen as a part of it."""
    base_color, roughness = p["baseColor"], p["roughness"]
    dielectric = 1.0 - p["metallic"]
    sheen_color = scale(mix_color(np.ones(3), _tint(base_color), p["sheenTint"]), p["sheen"])

    def sheen(d: DirectionPair) -> Array:
        # Burley 2012, addenda, "Sheen details".
        return scale(sheen_color, schlick_weight(d.cos_theta_d))

    def evaluate(d: DirectionPair) -> Array:
        fi, fo = schlick_weight(d.cos_theta_i), schlick_weight(d.cos_theta_o)
        # Burley 2012, section 5.3.
        retro = roughness * d.cos_theta_d * d.cos_theta_d
        fd90 = 0.5 + 2.0 * retro
        diffuse = mix(1.0, fd90, fi) * mix(1.0, fd90, fo)
        # Hanrahan and Krueger 1993, as in Disney's BRDF Explorer: Fss90, which is `retro`, flattens retroreflection,
        # and the factor 1.25 keeps the albedo.
        fss = schlick_blend(1.0, retro, d.cos_theta_i) * schlick_blend(1.0, retro, d.cos_theta_o)
        subsurface = 1.25 * (fss * (1.0 / np.maximum(d.cos_theta_i + d.cos_theta_o, TINY) - 0.5) + 0.5)
        body = scale(base_color, mix(diffuse, subsurface, p["subsurface"]) * (1.0 / np.pi))
        return scale(body + sheen(d), dielectric)

    return Lobe(
        "disney",
        "diffuse",
        # The albedo is about the base colour plus a tenth of the sheen colour. Sheen has the factor
        # (1 - cos theta_d)^5.
        dielectric * (mean(base_color) + 0.1 * mean(sheen_color)),
        evaluate,
        pdf=lambda d: d.cos_theta_i * (1.0 / np.pi),
        sample=mf.sample_cosine,
        group="diffuse",
        frame=frame,
        broad=True,
        values={**p, "sheen_color": sheen_color, "dielectric": dielectric},
        parts={"sheen": lambda d: scale(sheen(d), dielectric)},
    )


# Burley 2012, addenda, "Anisotropic specular details"; the floor of 0.001 is from Disney's BRDF Explorer.
def _alphas(p: Parameters) -> tuple[Array, Array]:
    """Return the alphas of the specular lobe along tangent and bitangent."""
    aspect, square = np.sqrt(1.0 - 0.9 * p["anisotropic"]), p["roughness"] * p["roughness"]
    return np.maximum(0.001, square / aspect), np.maximum(0.001, square * aspect)


# Section 5.5 and figure 14.
def _f0(p: Parameters) -> Array:
    """Return Schlick's reflectance (..., 3) at normal incidence of the specular lobe.

    For a dielectric it is 0.08 times `specular`, tinted. For a metal it is the base colour. If metals have the exact
    Fresnel term, the result is the dielectric's reflectance.
    """
    dielectric = scale(mix_color(np.ones(3), _tint(p["baseColor"]), p["specularTint"]), 0.08 * p["specular"])
    return dielectric if is_exact(p) else mix_color(dielectric, p["baseColor"], p["metallic"])


def specular_fresnel(p: Parameters, cos_theta: Array) -> Array:
    """Return the Fresnel term (..., 3) of the specular lobe at a cosine (...), with the thin film if there is one."""
    term = mix_color(_f0(p), np.ones(3), schlick_weight(cos_theta))
    film = () if are_equal(p["filmThickness"], 0.0) else (cos_theta, p["filmThickness"], p["filmIor"])
    if film:
        term = film_reflectance(term, *film)
    if is_exact(p):
        exact = metal_film_reflectance(p["eta"], p["k"], *film) if film else metal_fresnel(p, cos_theta)
        term = mix_color(term, exact, p["metallic"])
    return term


def _specular(p: Parameters, wo: Array, frame: Frame) -> Lobe:
    """Build the specular lobe."""
    roughness = p["roughness"]
    alpha_x, alpha_y = _alphas(p)

    def shadowing(cos_theta: Array, w: Array) -> Array:
        """Return Smith's G1 of the direction w, divided by ``2 cos_theta``."""
        if p["variant"] == "2012":
            # Section 5.6: roughness remapped to [0.5, 1] before squaring.
            alpha_g = 0.5 + 0.5 * roughness
            return mf.smith_ggx(cos_theta, alpha_g * alpha_g)
        return mf.smith_ggx_aniso(w, alpha_x, alpha_y)

    # At gamma 2, half vectors are drawn from the visible normals of GGX. At another gamma, they are drawn from the
    # general distribution of appendix B itself.
    is_ggx = are_equal(p["gamma"], 2.0)

    def distribution(wm: Array) -> Array:
        return mf.gtr2_aniso(wm, alpha_x, alpha_y) if is_ggx else mf.gtr_aniso(wm, alpha_x, alpha_y, p["gamma"])

    def evaluate(d: DirectionPair) -> Array:
        # D F G / (4 cos_theta_i cos_theta_o). The two factors of `shadowing` contain the denominator.
        g = shadowing(d.cos_theta_i, d.wi) * shadowing(d.cos_theta_o, d.wo)
        return scale(specular_fresnel(p, d.cos_theta_d), distribution(d.wm) * g)

    def density(d: DirectionPair) -> Array:
        if is_ggx:
            return mf.visible_ggx_pdf(d.wo, distribution(d.wm), alpha_x, alpha_y)
        return distribution(d.wm) * d.wm[..., 2] / (4.0 * d.cos_theta_d)

    def sample(u1: Array, u2: Array) -> Array:
        if is_ggx:
            return reflect(wo, mf.sample_visible_ggx(wo, alpha_x, alpha_y, u1, u2))
        return reflect(wo, mf.sample_gtr_aniso(alpha_x, alpha_y, p["gamma"], u1, u2))

    return Lobe(
        "disney",
        "specular",
        # The floor is for F0 = 0: the Fresnel term is then 0 for a view along the normal, but above 0 for the half
        # vectors of tilted microfacets.
        np.maximum(mean(specular_fresnel(p, wo[..., 2])), 0.001),
        evaluate=evaluate,
        pdf=density,
        sample=sample,
        group="specular",
        frame=frame,
        values={**p, "f0": _f0(p), "alpha_x": alpha_x, "alpha_y": alpha_y},
    )


def _clearcoat(p: Parameters, wo: Array, frame: Frame) -> Lobe:
    """Build the clearcoat: GTR1, and the shadowing of GGX with a fixed alpha of 0.25 (sections 5.4 to 5.6)."""
    weight = 0.25 * p["clearcoat"]
    alpha = mix(0.1, 0.001, p["clearcoatGloss"])

    def fresnel(cos_theta: Array) -> Real:
        return mix(COAT_F0, 1.0, schlick_weight(cos_theta))

    def evaluate(d: DirectionPair) -> Array:
        g = mf.smith_ggx(d.cos_theta_i, 0.25) * mf.smith_ggx(d.cos_theta_o, 0.25)
        f = weight * mf.gtr1(d.wm, alpha) * fresnel(d.cos_theta_d) * g
        return np.expand_dims(f, -1) * np.ones(3)

    return Lobe(
        "disney",
        "clearcoat",
        weight * fresnel(wo[..., 2]),
        evaluate=evaluate,
        # Burley 2012, appendix B.1.
        pdf=lambda d: mf.gtr1(d.wm, alpha) * d.wm[..., 2] / (4.0 * d.cos_theta_d),
        sample=lambda u1, u2: reflect(wo, mf.sample_gtr1(alpha, u1, u2)),
        group="clearcoat",
        frame=frame,
        values={"weight": weight, "alpha": alpha},
    )


_PARAMETERS = parameters_by_name(
    Parameter("baseColor", "color", (0.8, 0.8, 0.8), help="The surface colour, usually a texture; linear."),
    Parameter("subsurface", "float", 0.0, help="Blends the diffuse shape to a subsurface approximation."),
    Parameter("metallic", "float", 0.0, help="0 dielectric, 1 metallic; a linear blend of the two models."),
    Parameter(
        "specular",
        "float",
        0.5,
        hard=(0.0, 12.5),
        help="Incident specular amount: F0 = 0.08 specular; 0.5 is an index of refraction of 1.5.",
    ),
    Parameter("specularTint", "float", 0.0, help="Tints incident specular towards the base colour's hue."),
    Parameter("roughness", "float", 0.5, help="Controls both diffuse and specular response; alpha is its square."),
    Parameter("anisotropic", "float", 0.0, help="Aspect ratio of the highlight, up to 10:1 at 1."),
    Parameter("sheen", "float", 0.0, help="An additional grazing component, for cloth."),
    Parameter("sheenTint", "float", 0.5, help="Tints sheen towards the base colour's hue."),
    Parameter("clearcoat", "float", 0.0, help="A second specular lobe, GTR1, with an index of 1.5."),
    Parameter("clearcoatGloss", "float", 1.0, help="Clearcoat glossiness: 0 satin, 1 gloss."),
    PRESENCE,
    normal_parameter("normal", "Normal of all lobes, in the frame of tangent, bitangent and shading normal."),
    normal_parameter("specularNormal", "Normal of the specular lobe; if not given, as normal.", "normal"),
    normal_parameter("clearcoatNormal", "Normal of the clearcoat lobe; if not given, as normal.", "normal"),
    Parameter(
        "gamma",
        "float",
        2.0,
        hard=(0.5, 4.0),
        soft=(1.0, 3.0),
        help="Exponent of the specular lobe's GTR distribution: 2 is GGX; less has a longer tail.",
        optional=True,
    ),
    Parameter(
        "filmThickness",
        "float",
        0.0,
        hard=(0.0, 3000.0),
        soft=(0.0, 1000.0),
        help="Thickness of a film over the specular lobe, which makes it iridescent; 0: there is none.",
        unit="nm",
        optional=True,
    ),
    Parameter("filmIor", "float", 1.33, (1.0, 3.0), (1.0, 2.5), help="Index of refraction of the film.", optional=True),
    token_parameter(
        "variant",
        ("2014", "2012"),
        "2014: Smith G with the lobe's own alpha (addenda). 2012: isotropic G with remapped roughness.",
    ),
    *metal_parameters(agreement="apart"),
)


_QUOTES = {
    "baseColor": "the surface color, usually supplied by texture maps.",
    "subsurface": "controls diffuse shape using a subsurface approximation.",
    "metallic": "the metallic-ness (0 = dielectric, 1 = metallic). This is a linear blend between two different "
    "models. The metallic model has no diffuse component and also has a tinted incident specular, equal to the base "
    "color.",
    "specular": "incident specular amount. This is in lieu of an explicit index-of-refraction.",
    "specularTint": "a concession for artistic control that tints incident specular towards the base color. Grazing "
    "specular is still achromatic.",
    "roughness": "surface roughness, controls both diffuse and specular response.",
    "anisotropic": "degree of anisotropy. This controls the aspect ratio of the specular highlight. (0 = isotropic, "
    "1 = maximally anisotropic.)",
    "sheen": "an additional grazing component, primarily intended for cloth.",
    "sheenTint": "amount to tint sheen towards base color.",
    "clearcoat": "a second, special-purpose specular lobe.",
    "clearcoatGloss": "controls clearcoat glossiness (0 = a “satin” appearance, 1 = a “gloss” appearance).",
    "gamma": "Preliminary fitting results suggest typical values of γ between 1 and 2.",
    "filmThickness": "We've also received requests to add iridescence to our model. This should be as simple as adding "
    "specular color variation as previously discussed.",
}


def _bsdf(parameters: Parameters) -> Bsdf:
    """Return the BSDF of the model (`Model.bsdf`)."""
    presence = parameters["presence"]

    def lobes(wo: Array) -> tuple[Lobe, ...]:
        frame = frame_of(parameters["normal"]).bend_towards(wo)

        def lobe(build: Callable[[Parameters, Array, Frame], Lobe], normal: str) -> Lobe:
            # Lobes with the same normal share a frame.
            shared = are_equal(parameters[normal], parameters["normal"])
            lobe_frame = frame if shared else frame_of(parameters[normal]).bend_towards(wo)
            return build(parameters, lobe_frame.to_local(wo), lobe_frame).blend(presence)

        parts = (_diffuse, "normal"), (_specular, "specularNormal"), (_clearcoat, "clearcoatNormal")
        return tuple(lobe(build, normal) for build, normal in parts)

    return Bsdf(lobes, presence)


def _reflectance(p: Parameters, wo: Array) -> Real:
    """Return the albedo (...) of the specular lobe, by a fit for the variant of 2014 and gamma 2."""
    cos_theta = frame_of(p["specularNormal"]).bend_towards(wo).to_local(wo)[..., 2]
    alpha_x, alpha_y = _alphas(p)
    # An anisotropic lobe has about the albedo of an isotropic lobe whose alpha is the geometric mean of both alphas.
    alpha = np.minimum(np.sqrt(alpha_x * alpha_y), 1.0)
    if is_exact(p) or not are_equal(p["filmThickness"], 0.0):
        unweighted, typical_cosine = ggx_albedo(cos_theta, alpha)
        return unweighted * mean(specular_fresnel(p, typical_cosine))
    return ggx_reflectance(cos_theta, alpha, mean(_f0(p)))


def _preview(p: Parameters) -> dict[str, Real]:
    exact: dict[str, Real] = {}
    if is_exact(p):
        exact["diffuseColor"] = mix_color(p["baseColor"], metal_fresnel(p, np.ones(())), p["metallic"])
    return exact | {
        # The weight of the clearcoat lobe, and the square root of the lobe's alpha.
        "clearcoat": 0.25 * p["clearcoat"],
        "clearcoatRoughness": np.sqrt(mix(0.1, 0.001, p["clearcoatGloss"])),
        "f0": 0.08 * p["specular"],
    }


DISNEY = Model(
    name="disney",
    title="Disney",
    text="Disney's principled BRDF (Burley 2012, with the 2014 addenda).",
    parameters=_PARAMETERS,
    bsdf=_bsdf,
    identifier="LookdevDisney",
    # The model does not conserve energy: saturated tints are up to ten times brighter than white, and a rough surface
    # retroreflects. The largest albedo observed is 2.5.
    energy=lambda tokens: 4.0,
    reciprocal=lambda tokens: ("diffuse", "specular", "clearcoat"),
    modes=("over", "coat"),
    reflectance=_reflectance,
    probe={"roughness": 0.4, "clearcoat": 0.5, "sheen": 0.5},
    preview=Preview(
        {"diffuseColor": "baseColor", "metallic": "metallic", "roughness": "roughness", "opacity": "presence"}, _preview
    ),
    quotes=_QUOTES,
    quote_source="Burley 2012, sections 5.2, 5.4 and 6.3",
)
