"""The models of smooth surfaces, `MIRROR` and `GLASS`, which scatter light along single directions.

Both are exact: they follow Fresnel's equations, the law of reflection and Snell's law, with total internal reflection.
As their scattering is a delta distribution, f is 0 for every pair of directions. Each term is a `Delta`, with its
direction and its value.

References
----------
- M. Pharr, W. Jakob, G. Humphreys, Physically Based Rendering, 3rd ed., sections 8.2 (specular reflection and
  transmission) and 16.1.3 (radiance is scaled on refraction).
- M. Born, E. Wolf, Principles of Optics, sections 1.5 and 14.2 in the 7th edition.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lookdev.brdf.frames import Frame, frame_of
from lookdev.brdf.fresnel import conductor_fresnel
from lookdev.brdf.lobes import Bsdf, Delta
from lookdev.brdf.metal import INDEX_QUOTES, named_metal
from lookdev.brdf.model import Model, Preview
from lookdev.brdf.parameters import Parameter, normal_parameter, parameters_by_name
from lookdev.brdf.vectors import TINY, Array, BooleanArray, Parameters, Real, scale, vector

_NORMAL = normal_parameter("normal", "Normal of the surface, as of a normal map; the shading normal by default.")


def _frame_and_view(normal: Array, wo: Array) -> tuple[Frame, Array, Array, Array]:
    """Return the frame about a normal, bent towards the view, and the components x, y, z of the view in this frame."""
    frame = frame_of(normal).bend_towards(wo)
    local = frame.to_local(wo)
    # Rounding may make z negative where the view is at a right angle to the bent normal.
    return frame, local[..., 0], local[..., 1], np.maximum(local[..., 2], 0.0)


def _direction_above(frame: Frame, w: Array) -> Array:
    """Express a direction of a frame in the shading frame; if it is below the horizon there, its z becomes 0."""
    out = frame.from_local(w)
    return vector(out[..., 0], out[..., 1], np.maximum(out[..., 2], 0.0))


def _mirror(p: Parameters) -> Bsdf:
    """Return the BSDF of the mirror."""

    def deltas(wo: Array, inside: BooleanArray) -> tuple[Delta, ...]:
        frame, x, y, cosine = _frame_and_view(p["normal"], wo)
        value = p["tint"] * conductor_fresnel(np.expand_dims(cosine, -1), p["eta"], p["k"])
        mirrored = vector(-x, -y, cosine)
        return (Delta("mirror", "reflection", _direction_above(frame, mirrored), value),)

    return Bsdf(lambda wo: (), deltas=deltas)


def _glass(p: Parameters) -> Bsdf:
    """Return the BSDF of the glass."""

    def deltas(wo: Array, inside: BooleanArray) -> tuple[Delta, ...]:
        frame, x, y, cosine = _frame_and_view(p["normal"], wo)
        eta_i, eta_t = (np.where(inside, p[a], p[b]) for a, b in (("eta", "externalIor"), ("externalIor", "eta")))
        # eta_i is the index of refraction on the viewer's side, eta_t the index on the other side.
        n = eta_i / eta_t
        reflectance = conductor_fresnel(cosine, eta_t, 0.0, eta_i)
        # By Snell's law, `cos2` is the squared cosine of the refracted direction. The form 1 - n^2 (1 - cos^2) would
        # cancel near the critical angle.
        cos2 = 1.0 - n * n * (x * x + y * y)
        cos_t = np.sqrt(np.maximum(cos2, 0.0))
        refracted = frame.from_local(vector(-n * x, -n * y, -cos_t))
        is_refracted = (cos2 > 0.0) & (refracted[..., 2] < 0.0)
        refracted = vector(refracted[..., 0], refracted[..., 1], np.where(is_refracted, refracted[..., 2], 0.0))
        # The mean transmissivity of both polarisations (Born and Wolf, 1.5.2). 1 minus the reflectance would cancel.
        s, t = n * cosine + cos_t, cosine + n * cos_t
        transmittance = 2.0 * n * cosine * cos_t * (1.0 / np.maximum(s * s, TINY) + 1.0 / np.maximum(t * t, TINY))
        # Pharr et al., section 16.1.3: refraction changes the solid angle of light, and so scales radiance by n^2.
        refracted_value = scale(p["tint"], transmittance * n * n)
        return (
            Delta("glass", "reflection", _direction_above(frame, vector(-x, -y, cosine)), vector(*[reflectance] * 3)),
            Delta("glass", "refraction", refracted, refracted_value, transmits=True),
        )

    return Bsdf(lambda wo: (), deltas=deltas)


def _color(name: str, default: float, help: str, hard: tuple[float, float] = (0.0, 1.0)) -> Parameter:
    """Return a parameter that is a colour, by default `default` in all channels; sliders have the range `hard`."""
    return Parameter(name, "color", (default,) * 3, hard=hard, soft=hard, help=help)


def _mirror_preview(p: Parameters) -> dict[str, Real]:
    color = p["tint"] * conductor_fresnel(1.0, p["eta"], p["k"])
    return {"diffuseColor": color, "metallic": 1.0, "roughness": 0.0}


def _glass_preview(p: Parameters) -> dict[str, Real]:
    f0 = conductor_fresnel(1.0, p["eta"], 0.0, p["externalIor"])
    return {"diffuseColor": p["tint"], "roughness": 0.0, "opacity": 0.0, "f0": f0}


def _model(
    name: str,
    title: str,
    text: str,
    bsdf: Callable[[Parameters], Bsdf],
    preview: Callable[[Parameters], dict[str, Real]],
    *parameters: Parameter,
) -> Model:
    """Return the record of a model; `preview` is `Preview.derived`."""
    by_name = parameters_by_name(*parameters, _NORMAL)
    return Model(name, title, text, by_name, bsdf, f"Lookdev{title}", preview=Preview({}, preview), delta=True,
        quotes={key: quote for key, quote in INDEX_QUOTES.items() if key in by_name},
        quote_source="Trent 2017, section 4",
    )  # fmt: skip


MIRROR = _model(
    "mirror",
    "Mirror",
    "A smooth metal: Fresnel's equations (Born and Wolf, section 14.2) for light along the mirrored view.",
    _mirror,
    _mirror_preview,
    _color("eta", 1.5, "Real part of the index of refraction, by channel.", (0.05, 10.0)),
    _color("k", 0.0, "Imaginary part of the index of refraction, by channel.", (0.0, 20.0)),
    _color("tint", 1.0, "Factor of the reflected light; linear."),
    *named_metal(),
)

GLASS = _model(
    "glass",
    "Glass",
    "A smooth solid dielectric: Fresnel's equations and Snell's law (Born and Wolf, section 1.5).",
    _glass,
    _glass_preview,
    Parameter("eta", "float", 1.5, (0.05, 10.0), (1.0, 3.0), help="Index of refraction of the solid."),
    Parameter("externalIor", "float", 1.0, (1.0, 4.0), (1.0, 2.0), help="Index of refraction around it."),
    _color("tint", 1.0, "Factor of the light that passes the surface, each time; linear."),
)
