"""Pixels of a sphere with a blurred mask between two presets, under an image-based light, without noise.

A pixel is the radiance of one point of a sphere towards the viewer. Behind a surface that transmits, as behind a card,
is the light itself. The light on the point is gathered once into cells of directions, small about the mirror
direction and the refracted one, each with its light and its mean direction. A surface is then a sum over the same
cells, so that a difference of two surfaces has no noise.

`EDGES` records each pair by `KINDS`. ``python tests/material/mask_edges.py`` (some minutes) measures every pair and
writes it anew, with the tables of docs/presets.md and its picture.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import qmc

from lookdev.arrays import Floats, Indices
from lookdev.brdf import Bsdf, StackLayer, complete_parameters, evaluate_cosine, stack_bsdf
from lookdev.light import Light, load_environment, prepare_light
from lookdev.material.library import read_preset
from lookdev.material.library.edit import preset_look
from lookdev.scene.shading import shading_frame

Pair = tuple[str, str]
Preset = tuple[str, dict[str, Any]]
"""A model and all of its parameters."""

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "presets.md"
PRESETS = sorted(file.stem for file in (ROOT / "materials" / "presets").glob("*.usda"))
PAIRS: list[Pair] = list(combinations(PRESETS, 2))
EDGES = Path(__file__).with_name("mask_edges.txt")

LIGHTS = ("studio", "forest")
"""Large lamps in a dark room; light from everywhere."""

MASKS = np.arange(9) / 8

NARROW = 0.2
"""The range that two neighbours span counts as at least this fraction of the brighter one: 5 % of it are then 1 % of
what is seen, about the least step that an eye, or 8 bits, can show."""

ALLOWED = 0.05
KINDS = {".": ALLOWED, "+": 1.0, "#": np.inf}
"""Up to which overshoot a pair is of each kind: within the claim, by less than the range itself, by more."""

# Degrees between normal and view, and the number of pixels at each.
_RINGS = ((15.0, 1), (40.0, 3), (62.0, 3), (78.0, 3))
# Cells in slope of the half vector, logarithmic beyond _T0, and in its azimuth.
_CELLS = (24, 16)
# tan^2 of half the width of the narrowest highlight here, Pixar's at 0.25 degrees.
_T0 = 0.002**2
_POINTS = 2**15
_IOR = 1.5  # of every preset that transmits
_AT_A_TIME = 8
_ANYWHERE = np.zeros(3)
_SHAPE = ("roughness", "anisotropic", "clearcoatGloss")
_EQUAL = {
    "nothing": (),
    "`roughness`, `anisotropic`, `clearcoatGloss`": _SHAPE,
    "`metallic`": ("metallic",),
    "all four": (*_SHAPE, "metallic"),
}
_WORST = 6


def read_presets() -> dict[str, Preset]:
    """Read every preset as the only layer of a look, by reference."""
    read = {}
    for name in PRESETS:
        (layer,) = preset_look(read_preset(ROOT / "materials" / "presets" / f"{name}.usda"), name).layers
        read[name] = layer.model, complete_parameters(layer.model, layer.inputs)
    return read


@dataclass(frozen=True)
class Pixel:
    """A viewing direction (3,), and directions (n, 3) of incident light (n, 3), in radiance times sr.

    `frame` (3, 3) has tangent, bitangent and normal as its rows.
    """

    frame: Floats
    wo: Floats
    wi: Floats
    light: Floats

    def show(self, bsdf: Bsdf) -> Floats:
        """Return the radiance (..., 3) of surfaces whose parameters have shape (..., 1)."""
        is_lit = self.wi[:, 2] > (-1.0 if bsdf.two_sided else 0.0)
        return np.asarray((evaluate_cosine(bsdf, self.wo, self.wi[is_lit]) * self.light[is_lit]).sum(axis=-2))


@cache
def sphere_pixels(light: str) -> tuple[Pixel, ...]:
    """Gather the light at some points of a sphere that is seen from -y."""
    dome = prepare_light(load_environment(builtin=light), sampled=False)
    polar = np.radians(np.repeat([angle for angle, _ in _RINGS], [count for _, count in _RINGS]))
    around = 2.0 * np.pi * (np.concatenate([np.arange(count) / count for _, count in _RINGS]) + 0.07)
    normals = np.stack([np.sin(polar) * np.cos(around), -np.cos(polar), np.sin(polar) * np.sin(around)], axis=-1)
    tangents = np.cross([0.0, 0.0, 1.0], normals)
    frame = shading_frame(normals, tangents, normals, np.broadcast_to([0.0, -1.0, 0.0], normals.shape))
    frames = np.stack([frame.tangent, frame.bitangent, frame.normal], axis=1)
    return tuple(_gather(dome, frame, seed) for seed, frame in enumerate(frames))


def _gather(light: Light, frame: Floats, seed: int) -> Pixel:
    rng = np.random.default_rng(seed)
    wo = frame @ [0.0, -1.0, 0.0]
    sides = [(1.0, wo), (-1.0, np.append(wo[:2], np.sqrt(_IOR**2 - 1.0 + wo[2] ** 2)) / _IOR)]
    # Drawn from the cells and from the light, both combined: small lamps are found, and so are mirror images.
    wi = np.concatenate([_draw(side, view, rng) for side, view in sides])
    wi = np.concatenate([wi, light.sample(_ANYWHERE, qmc.Sobol(2, rng=rng).random(_POINTS)) @ frame.T])
    wi = wi[np.abs(wi[:, 2]) > 1e-6]

    cell, density = np.zeros(len(wi), np.intp), np.zeros(len(wi))
    for number, (side, view) in enumerate(sides):
        is_visible = wi[:, 2] * side > 0.0
        within, density[is_visible] = _cell(view, wi[is_visible] * (1.0, 1.0, side))
        cell[is_visible] = within + number * _CELLS[0] * _CELLS[1]
    world = wi @ frame
    arriving = light.radiance(_ANYWHERE, world) / (_POINTS * (density + light.pdf(_ANYWHERE, world)))[:, None]
    energy, direction = (
        np.stack([np.bincount(cell, weight) for weight in weights.T], axis=-1)
        for weights in (arriving, wi * arriving.sum(axis=-1, keepdims=True))
    )
    is_lit = energy.any(axis=-1)
    mean = direction[is_lit] / np.linalg.norm(direction[is_lit], axis=-1, keepdims=True)
    return Pixel(frame, wo, mean, energy[is_lit])


def _length(view: Floats) -> float:
    """Return the logarithm of the steepest slope there is, as in `sphere_quadrature` of the models' tests."""
    return float(np.log1p((2.0 / view[2]) ** 2 / _T0))


def _draw(side: float, view: Floats, rng: np.random.Generator) -> Floats:
    u = qmc.Sobol(2, rng=rng).random(_POINTS)
    t = _T0 * np.expm1(u[:, 0] * _length(view))
    cos = 1.0 / np.sqrt(1.0 + t)
    sin, phi = np.sqrt(t) * cos, 2.0 * np.pi * u[:, 1]
    wm = np.stack([sin * np.cos(phi), sin * np.sin(phi), cos], axis=-1)
    wi = 2.0 * (wm @ view)[:, None] * wm - view
    return np.asarray(wi[wi[:, 2] > 0.0] * (1.0, 1.0, side))


def _cell(view: Floats, wi: Floats) -> tuple[Indices, Floats]:
    """Return the cells (n,) of directions above the horizon, and the density (n,) that `_draw` has there."""
    half = view + wi
    t = (half[:, 0] ** 2 + half[:, 1] ** 2) / half[:, 2] ** 2
    cell = np.log1p(t / _T0) / _length(view), np.arctan2(half[:, 1], half[:, 0]) / (2.0 * np.pi) % 1.0
    row, column = (np.minimum((x * n).astype(np.intp), n - 1) for x, n in zip(cell, _CELLS, strict=True))
    # d omega_i = 4 (wi . wm) d omega_h, and d omega_h = dt d phi / (2 (1 + t)^(3/2)).
    density = (1.0 + t) ** 1.5 / (np.pi * (_T0 + t) * _length(view) * 2.0 * np.linalg.norm(half, axis=-1))
    return row * _CELLS[1] + column, density


def edges(light: str, presets: Mapping[str, Preset], pairs: Sequence[Pair], equal: Iterable[str] = ()) -> Floats:
    """Return the pixels across blurred masks, (n, 9, P, 3), with the second preset of each pair over the first.

    Parameters named by `equal` are first set to their mean over the two.
    """
    models = [tuple(presets[name][0] for name in pair) for pair in pairs]
    colors = np.empty((len(pairs), len(MASKS), len(sphere_pixels(light)), 3))
    for kind in dict.fromkeys(models):
        of_kind = np.array([number for number, model in enumerate(models) if model == kind])
        for block in np.array_split(of_kind, -(-len(of_kind) // _AT_A_TIME)):
            below, above = (_stack_parameters([presets[pairs[number][side]][1] for number in block]) for side in (0, 1))
            for name in equal:
                below[name] = above[name] = 0.5 * (below[name] + above[name])
            bsdf = stack_bsdf([StackLayer(kind[0], below), StackLayer(kind[1], above, MASKS[:, None])])
            colors[block] = np.stack([pixel.show(bsdf) for pixel in sphere_pixels(light)], axis=-2)
    return colors


def _stack_parameters(parameter_sets: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Stack parameters to shape (n, 1, 1), colours and normals (n, 1, 1, 3)."""
    return {
        name: value
        if isinstance(value, str)
        else np.stack([parameters[name] for parameters in parameter_sets])[:, None, None]
        for name, value in parameter_sets[0].items()
    }


def excess(colors: Floats) -> Floats:
    """Return the distances by which values (n, 9, ...) leave the range of their two ends, as fractions of it."""
    low, high = (end(colors[:, ::8], axis=1, keepdims=True) for end in (np.min, np.max))
    return np.asarray(np.maximum(colors - high, low - colors) / np.maximum(high - low, NARROW * high))


def overshoot(light: str, presets: Mapping[str, Preset], pairs: Sequence[Pair], equal: Iterable[str] = ()) -> Floats:
    """Return the worst excess of each pair, (n,)."""
    return np.asarray(excess(edges(light, presets, pairs, equal)).max(axis=(1, 2, 3)))


def kind_of(value: float) -> str:
    """Return the kind of a pair by its overshoot."""
    return next(kind for kind, most in KINDS.items() if value <= most)


def read_edges() -> dict[Pair, str]:
    """Return the recorded kind of every pair."""
    rows = dict(line.split() for line in EDGES.read_text().splitlines() if line.split()[1:])
    return {(a, b): rows[b][PRESETS.index(a)] for a, b in PAIRS}


def write_edges(kinds: Mapping[Pair, str]) -> None:
    """Write a row of kinds for each preset, against all before it."""
    rows = [f"{b:24}" + "".join(kinds[a, b] for a in PRESETS[:number]) for number, b in enumerate(PRESETS)]
    EDGES.write_text("\n".join(row.rstrip() for row in rows) + "\n")


def page_table(page: str, name: str) -> str:
    """Return a table of the page."""
    (rows,) = re.findall(rf"<!-- edges: {name} -->\n(.*?)<!-- end -->", page, re.DOTALL)
    return rows


def kinds_table(presets: Mapping[str, Preset], kinds: Mapping[Pair, str]) -> str:
    """Count the pairs of each kind, by their models."""
    blended = {"disney disney": "their parameters", "pixar pixar": "their lobes", "disney pixar": "what is evaluated"}
    rows = [("presets", "what is blended", "within 5 %", "up to its width", "beyond")]
    for models, blend in ((names.split(), blend) for names, blend in blended.items()):
        kinds_found = [kind for (a, b), kind in kinds.items() if sorted((presets[a][0], presets[b][0])) == models]
        rows.append((" and ".join(models), blend, *(str(kinds_found.count(kind)) for kind in KINDS)))
    return _markdown(rows)


def tables(presets: Mapping[str, Preset]) -> dict[str, str]:
    """Return the tables from new measurements."""
    pairs = [pair for pair in PAIRS if all(presets[name][0] == "disney" for name in pair)]
    rows = [("made equal first", "pairs within 5 %")]
    for name, equal in _EQUAL.items():
        worst = np.max([overshoot(light, presets, pairs, equal) for light in LIGHTS], axis=0)
        rows.append((name, f"{np.mean(worst <= ALLOWED):.0%}"))
    return {"equal": _markdown(rows), "worst": _worst_table(presets, pairs)}


def _worst_table(presets: Mapping[str, Preset], pairs: Sequence[Pair]) -> str:
    """Return the worst pixel of the worst pairs, each preset once."""
    colors = {light: edges(light, presets, pairs) for light in LIGHTS}
    worst = {light: excess(values).max(axis=(1, 2, 3)) for light, values in colors.items()}
    rows = [("pair", "light", "mask", "the two", "blend", "excess", "equal highlights", "equal `metallic`", "both")]
    used: set[str] = set()
    for number in np.argsort(-np.max(list(worst.values()), axis=0)):
        pair = pairs[number]
        if used & set(pair) or len(rows) > _WORST:
            continue
        used |= set(pair)
        light = max(LIGHTS, key=lambda light_name: worst[light_name][number])
        values = colors[light][number]
        worst_excess = excess(values[None])[0]
        step, pixel, channel = np.unravel_index(worst_excess.argmax(), worst_excess.shape)
        below, blend, above = (f"{values[index, pixel, channel]:.3f}" for index in (0, step, -1))
        left = (overshoot(light, presets, [pair], equal)[0] for equal in list(_EQUAL.values())[1:])
        excesses = (f"{max(value, 0.0):.2g}" for value in (worst_excess.max(), *left))
        rows.append((", ".join(pair), light, f"{MASKS[step]:g}", f"{below}, {above}", blend, *excesses))
    return _markdown(rows)


def _markdown(rows: Sequence[tuple[str, ...]]) -> str:
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([lines[0], "|---" * len(rows[0]) + "|", *lines[1:]]) + "\n"


def _draw_picture(worst: Floats) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot
    from matplotlib.colors import BoundaryNorm, ListedColormap

    grid = np.full((len(PRESETS), len(PRESETS)), np.nan)
    for (a, b), value in zip(PAIRS, worst, strict=True):
        grid[PRESETS.index(b), PRESETS.index(a)] = max(value, 0.0)
    colors = ListedColormap(["#d9ead3", "#fce29b", "#f4a259", "#c8553d", "#6d1a36"])
    bounds = [0.0, ALLOWED, 0.2, 1.0, 5.0, 100.0]
    figure, axes = pyplot.subplots(figsize=(11.0, 10.0))
    image = axes.imshow(grid, colors, BoundaryNorm(bounds, colors.N))
    axes.set_xticks(range(len(PRESETS)), PRESETS, rotation=90, fontsize=6.5)
    axes.set_yticks(range(len(PRESETS)), PRESETS, fontsize=6.5)
    axes.spines[["top", "right"]].set_visible(False)
    bar = figure.colorbar(image, ax=axes, shrink=0.5, ticks=bounds, format="%g")
    bar.set_label("excess over the range of the two presets, as a fraction of it")
    figure.tight_layout()
    figure.savefig(ROOT / "docs" / "images" / "mask_edges.png", dpi=100)


def main() -> None:
    """Write everything."""
    presets = read_presets()
    worst = np.max([overshoot(light, presets, PAIRS) for light in LIGHTS], axis=0)
    kinds = {pair: kind_of(value) for pair, value in zip(PAIRS, worst, strict=True)}
    write_edges(kinds)
    page = PAGE.read_text()
    for name, table in {"kinds": kinds_table(presets, kinds), **tables(presets)}.items():
        page = page.replace(f"<!-- edges: {name} -->\n{page_table(page, name)}", f"<!-- edges: {name} -->\n{table}")
    PAGE.write_text(page)
    _draw_picture(worst)


if __name__ == "__main__":
    main()
