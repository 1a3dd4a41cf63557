"""What the page draws itself: a surface as GLSL with its numbers as uniforms, light, and values to be compared with."""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.stats import qmc

from lookdev.brdf import MODELS, evaluate_cosine, pdf
from lookdev.codegen.glsl.functions import PRELUDE, TABLE_WIDTH
from lookdev.codegen.glsl.look import look_functions
from lookdev.codegen.program.look import live_name
from lookdev.light import load_environment, prepare_light
from lookdev.material.textures import image_file
from lookdev.plotting.angles import Values
from lookdev.studio.explorer.surfaces import Surfaces

DOME = "studio"
"""The built-in environment map of spheres, in the page and in the renderer."""

_DRAWN = 4096
_PAIRS = 2048


def usually_live(model: str) -> frozenset[str]:
    """Return the numbers of a model that sliders change without a compilation: all but normals and optional ones."""
    known = MODELS[model].parameters.values()
    return frozenset(each.name for each in known if each.kind in ("float", "color") and not each.optional)


def shader(surfaces: Surfaces, words: str, extra: Collection[str] = ()) -> tuple[dict[str, Any], Values]:
    """Return the functions of a surface and what they read, and its tables, (rows, `TABLE_WIDTH`).

    `extra` are further parameters that stay uniforms: a lobe's own normal, or a part that defaults leave out. A surface
    of several layers has no uniforms.
    """
    look = surfaces.look(words)

    def live(number: int, name: str) -> bool:
        model = look.layers[number].model
        return len(look.layers) == 1 and (name in usually_live(model) or name in extra)

    functions = look_functions(look, image_file, live)
    header = {
        "prelude": PRELUDE,
        "text": functions.text,
        "numbers": functions.numbers,
        "places": {live_name(0, each): each for each in MODELS[look.layers[0].model].parameters},
        "transmits": functions.transmits,
        "deltas": functions.deltas,
        "attributes": [[each.parameter, each.kind] for each in functions.attributes],
    }
    return header, {f"look_table{k}": _rows(np.load(each.path)) for k, each in enumerate(functions.tables)}


def _rows(values: Any) -> Any:
    texels = np.zeros((-(-values.size // TABLE_WIDTH), TABLE_WIDTH), np.float32)
    texels.ravel()[: values.size] = values.ravel()
    return texels


def pairs(surfaces: Surfaces, words: str) -> Values:
    """Return random pairs of directions `wo`, `wi` (n, 3), and `value`, f times the cosine, and `pdf` there, by Python.

    Directions are as float32 has them: both sides are given the same.
    """
    subject = surfaces.subject(words)
    rng = np.random.default_rng(3)
    w = rng.normal(size=(2, _PAIRS, 3))
    w[..., 2] = np.abs(w[..., 2]) + 0.05
    # Half of the lights are near the mirrored view, where peaks are.
    near = slice(0, _PAIRS // 2)
    w[0] /= np.linalg.norm(w[0], axis=-1, keepdims=True)
    spread = 10.0 ** rng.uniform(-3.0, -0.3, (_PAIRS // 2, 1))
    w[1, near] = w[0, near] * (-1.0, -1.0, 1.0) + spread * rng.normal(size=(_PAIRS // 2, 3))
    w[1, :, 2] = np.abs(w[1, :, 2]) + 0.01
    if subject.bsdf.transmits(w[0]):
        w[1, ::4, 2] *= -1.0
    wo, wi = (w / np.linalg.norm(w, axis=-1, keepdims=True)).astype(np.float32).astype(np.float64)
    found = {"wo": wo, "wi": wi, "value": evaluate_cosine(subject.bsdf, wo, wi), "pdf": pdf(subject.bsdf, wo, wi)}
    for number, delta in enumerate(subject.bsdf.deltas(wo, np.zeros(len(wo), np.bool_))):
        found[f"direction{number}"] = np.broadcast_to(delta.direction, wo.shape)
        found[f"factor{number}"] = np.broadcast_to(delta.value, wo.shape)
    return found


@lru_cache(maxsize=1)
def dome() -> Values:
    """Return the studio dome: `radiance` and pdf of directions, (h, w, 4), and drawn directions with theirs.

    Of `drawn`, (2, n, 4), one row has directions and pdf, the other radiances.
    """
    light = prepare_light(load_environment(builtin=DOME), sampled=False)
    height, width = light.table.shape[:2]
    theta, phi = (np.arange(height) + 0.5) / height * np.pi, (np.arange(width) + 0.5) / width * 2.0 * np.pi
    sine, cosine = np.sin(theta)[:, None], np.cos(theta)[:, None]
    toward = np.stack([sine * np.cos(phi), sine * np.sin(phi), np.broadcast_to(cosine, (height, width))], axis=-1)
    origin = np.zeros(3)
    radiance = np.concatenate([light.radiance(origin, toward), light.pdf(origin, toward)[..., None]], axis=-1)
    drawn = light.sample(origin, qmc.Sobol(2, rng=0).random(_DRAWN))
    density, emitted = light.pdf(origin, drawn), light.radiance(origin, drawn)
    rows = [np.concatenate([drawn, density[:, None]], axis=-1), np.pad(emitted, ((0, 0), (0, 1)))]
    return {"radiance": radiance, "drawn": np.stack(rows)}
