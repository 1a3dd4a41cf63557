"""Data with which the Explorer's page shades surfaces in GLSL: functions, uniforms, tables, light, reference values.

Python computes the reference values; the page compares its own results with them.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache

import numpy as np
from scipy.stats import qmc

from lookdev.arrays import Elements, Floats32
from lookdev.brdf import MODELS, evaluate_cosine, pdf
from lookdev.codegen.glsl.functions import PRELUDE, TABLE_WIDTH
from lookdev.codegen.glsl.look import look_functions
from lookdev.codegen.program.look import live_name
from lookdev.light import load_environment, prepare_light
from lookdev.material.textures import image_file
from lookdev.plotting.figure import PlotValues
from lookdev.studio.explorer.surfaces import Surfaces

DOME = "studio"
"""The built-in environment map that lights spheres, in the page's shaders and in exact frames."""

_DOME_SAMPLES = 4096  # directions that are drawn from the dome for the page
_PAIR_COUNT = 2048  # pairs of directions with reference values


def live_parameters(model: str) -> frozenset[str]:
    """Return the parameters of a model that are uniforms by default: colours and numbers that are not optional."""
    parameters = MODELS[model].parameters.values()
    return frozenset(
        parameter.name for parameter in parameters if parameter.kind in ("float", "color") and not parameter.optional
    )


def surface_shader(surfaces: Surfaces, text: str, extra: Collection[str] = ()) -> tuple[dict[str, object], PlotValues]:
    """Return a header with the GLSL functions of a surface, which a text specifies, and the tables that they read.

    In the header, ``text`` has the functions (see `LookFunctions`), and ``prelude`` is the text before them. By the
    names of uniforms, ``numbers`` has their values, and ``parameters`` the parameters of the model. ``transmits`` is
    whether the surface transmits light, ``deltas`` is the number of delta lobes, and ``attributes`` has the global
    variable and the kind of each mesh attribute that the functions read.

    The uniforms are `live_parameters` and `extra`, which are further parameters, such as the normal of a lobe or an
    optional part of the model. A surface of several layers has no uniforms. Tables are (rows, `TABLE_WIDTH`).
    """
    look = surfaces.look(text)

    def live(number: int, name: str) -> bool:
        model = look.layers[number].model
        return len(look.layers) == 1 and (name in live_parameters(model) or name in extra)

    functions = look_functions(look, image_file, live)
    header = {
        "prelude": PRELUDE,
        "text": functions.text,
        "numbers": functions.numbers,
        "parameters": {live_name(0, parameter): parameter for parameter in MODELS[look.layers[0].model].parameters},
        "transmits": functions.program.transmits,
        "deltas": functions.program.deltas,
        "attributes": [[attribute.parameter, attribute.kind] for attribute in functions.program.attributes],
    }
    return header, {f"look_table{k}": _rows(np.load(table.path)) for k, table in enumerate(functions.program.tables)}


def _rows(values: Elements) -> Floats32:
    """Return the values of a table in rows (rows, `TABLE_WIDTH`), padded with zeros."""
    padded = np.pad(values.ravel().astype(np.float32), (0, -values.size % TABLE_WIDTH))
    return padded.reshape(-1, TABLE_WIDTH)


def reference_values(surfaces: Surfaces, text: str) -> PlotValues:
    """Return random directions ``wo`` and ``wi`` (n, 3), and Python's results for each pair of them.

    ``value`` (n, 3) is the BSDF times the cosine, and ``pdf`` (n,) the density of ``wi``. For delta lobe number k,
    ``direction<k>`` and ``factor<k>`` are (n, 3). Directions are rounded to float32, so that the page and Python
    evaluate the same directions.
    """
    subject = surfaces.subject(text)
    rng = np.random.default_rng(3)
    w = rng.normal(size=(2, _PAIR_COUNT, 3))  # views, then directions to the light
    w[..., 2] = np.abs(w[..., 2]) + 0.05  # above the surface, and not at its horizon
    # Half of the directions to the light are near the mirrored view, where peaks are.
    near = slice(0, _PAIR_COUNT // 2)
    w[0] /= np.linalg.norm(w[0], axis=-1, keepdims=True)
    spread = 10.0 ** rng.uniform(-3.0, -0.3, (_PAIR_COUNT // 2, 1))
    w[1, near] = w[0, near] * (-1.0, -1.0, 1.0) + spread * rng.normal(size=(_PAIR_COUNT // 2, 3))
    w[1, :, 2] = np.abs(w[1, :, 2]) + 0.01
    if subject.bsdf.transmits(w[0]):
        w[1, ::4, 2] *= -1.0  # a quarter of the directions to the light are below the surface
    wo, wi = (w / np.linalg.norm(w, axis=-1, keepdims=True)).astype(np.float32).astype(np.float64)
    values = {"wo": wo, "wi": wi, "value": evaluate_cosine(subject.bsdf, wo, wi), "pdf": pdf(subject.bsdf, wo, wi)}
    for number, delta in enumerate(subject.bsdf.deltas(wo, np.zeros(len(wo), np.bool_))):
        values[f"direction{number}"] = np.broadcast_to(delta.direction, wo.shape)
        values[f"factor{number}"] = np.broadcast_to(delta.value, wo.shape)
    return values


@lru_cache(maxsize=1)
def dome() -> PlotValues:
    """Return the light of the dome `DOME` as a map and as samples, for the page.

    A texel of ``radiance`` (h, w, 4) has the radiance from a direction, and the density with which the direction is
    drawn. Rows follow the polar angle from +z, columns the azimuth. ``samples`` (2, n, 4) has n directions that were
    drawn: row 0 has each direction and its density, row 1 its radiance and 0.
    """
    light = prepare_light(load_environment(builtin=DOME), sampled=False)
    height, width = light.table.shape[:2]
    theta, phi = (np.arange(height) + 0.5) / height * np.pi, (np.arange(width) + 0.5) / width * 2.0 * np.pi
    sine, cosine = np.sin(theta)[:, None], np.cos(theta)[:, None]
    directions = np.stack([sine * np.cos(phi), sine * np.sin(phi), np.broadcast_to(cosine, (height, width))], axis=-1)
    origin = np.zeros(3)
    radiance = np.concatenate([light.radiance(origin, directions), light.pdf(origin, directions)[..., None]], axis=-1)
    samples = light.sample(origin, qmc.Sobol(2, rng=0).random(_DOME_SAMPLES))
    density, emitted = light.pdf(origin, samples), light.radiance(origin, samples)
    rows = [np.concatenate([samples, density[:, None]], axis=-1), np.pad(emitted, ((0, 0), (0, 1)))]
    return {"radiance": radiance, "samples": np.stack(rows)}
