"""Random inputs of foreign models, where our models can agree with them.

Surfaces are opaque and isotropic, without sheen, and reflections have no hue beyond that of metals.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import foreign_albedo
import numpy as np
from foreign_albedo import Floats

from lookdev.brdf import StackLayer, evaluate_cosine, stack_bsdf
from lookdev.brdf.parameters import complete
from lookdev.brdf.quadrature import half_vector_grid
from lookdev.material.translate import TRANSLATIONS, translated

VIEWS = (0.0, 20.0, 40.0, 60.0, 75.0)
"""In degrees."""

_CELLS = (40, 24)
Rng = np.random.Generator


Draw = Callable[[Rng], Any]


def _number(low: float = 0.0, high: float = 1.0) -> Draw:
    return lambda rng: float(rng.uniform(low, high))


def _color(rng: Rng) -> tuple[float, ...]:
    return tuple(rng.uniform(0.0, 1.0, 3).tolist())


def _often(*usual: float) -> Draw:
    """Draw one of the usual numbers, or any."""
    return lambda rng: float(rng.choice([*usual, rng.uniform()]))


_PREVIEW_SURFACE: dict[str, Draw] = {
    "diffuseColor": _color,
    "roughness": _number(),
    "metallic": _often(0.0, 0.0, 1.0),
    "clearcoat": _often(0.0),
    "clearcoatRoughness": _number(),
    "ior": _number(1.0, 2.2),
}
_STANDARD_SURFACE: dict[str, Draw] = {
    "base": _number(0.5),
    "base_color": _color,
    "metalness": _often(0.0, 0.0, 1.0),
    "specular": _often(1.0),
    "specular_roughness": _number(),
    "specular_IOR": _number(1.0, 2.2),
    "subsurface": _often(0.0, 0.0),
    "subsurface_color": _color,
    "coat": _often(0.0),
    "coat_color": lambda rng: (_often(1.0)(rng),) * 3,
    "coat_roughness": _number(),
    "coat_IOR": _number(1.0, 2.2),
    "coat_affect_color": _often(0.0),
    "coat_affect_roughness": _often(0.0),
}
_GLTF_PBR: dict[str, Draw] = {
    "base_color": _color,
    "metallic": _often(0.0, 0.0, 1.0),
    "roughness": _number(),
    "specular": _often(1.0),
    "ior": _number(1.0, 2.2),
    "clearcoat": _often(0.0),
    "clearcoat_roughness": _number(),
}
_OPEN_PBR_SURFACE: dict[str, Draw] = {
    "base_weight": _number(0.5),
    "base_color": _color,
    "base_metalness": _often(0.0, 0.0, 1.0),
    "specular_weight": _often(1.0),
    "specular_roughness": _number(),
    "specular_ior": _number(1.0, 2.2),
    "subsurface_weight": _often(0.0, 0.0),
    "subsurface_color": _color,
    "coat_weight": _often(0.0),
    "coat_roughness": _number(),
    "coat_ior": _number(1.0, 2.2),
    "coat_darkening": _often(0.0, 1.0),
}


def _draw(draws: Mapping[str, Draw], rng: Rng) -> dict[str, Any]:
    given = {name: draw(rng) for name, draw in draws.items()}
    if draws is _PREVIEW_SURFACE and rng.random() < 0.25:
        given |= {"useSpecularWorkflow": "1", "metallic": 0.0}
        # Plastics and metals; not more than all light is reflected.
        color = given["diffuseColor"]
        plastic = {"specularColor": (_number(0.0, 1.0 - max(color))(rng),) * 3}
        given |= plastic if rng.random() < 0.5 else {"specularColor": color, "diffuseColor": (0.0,) * 3}
    return given


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
    "preview_surface": Foreign(_PREVIEW_SURFACE, foreign_albedo.preview_surface, _metallic, 40.0),
    "standard_surface": Foreign(_STANDARD_SURFACE, foreign_albedo.standard_surface, itemgetter("metalness"), 20.0),
    "open_pbr_surface": Foreign(_OPEN_PBR_SURFACE, foreign_albedo.open_pbr_surface, itemgetter("base_metalness"), 60.0),
    "gltf_pbr": Foreign(_GLTF_PBR, foreign_albedo.gltf_pbr, itemgetter("metallic"), 60.0),
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
    rng, foreign, known = np.random.default_rng(seed), FOREIGN[name], TRANSLATIONS[name].parameters
    found = []
    for _ in range(count):
        given = _draw(foreign.draws, rng)
        whole = {each: parameter.default for each, parameter in known.items()} | given
        own = np.stack([foreign.albedo(whole, angle) for angle in VIEWS])
        ours = np.stack([translated_albedo(name, given, angle) for angle in VIEWS])
        found.append(Compared(given, foreign.metal(whole), own, ours))
    return found


def translated_albedo(name: str, inputs: dict[str, Any], degrees: float) -> Floats:
    """Return the directional albedo, (3,), of the layers that stand for inputs."""
    stack = translated(StackLayer(name, complete(name, TRANSLATIONS[name].parameters, inputs)))
    bsdf, wo = stack_bsdf(stack), foreign_albedo.view(degrees)
    # A grid for each width of the coats is dense where they peak; the ground is even.
    total = np.zeros(3)
    for lobe in bsdf.lobes(wo):
        if not np.any(lobe.share) or not np.any(lobe.weight):
            continue
        alpha = float(np.max(lobe.values.get("alpha_x", 1.0)))
        wi, weight = half_vector_grid(wo, alpha, _CELLS)
        alone = type(bsdf)(lambda _, lobe=lobe: (lobe,))
        total += (evaluate_cosine(alone, wo, wi) * weight[:, None]).sum(axis=0)
    return total
