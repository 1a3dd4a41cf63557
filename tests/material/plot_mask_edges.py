"""Measure every pair of presets across a blurred mask: `mask_edges.txt`, tables of docs/presets.md, and its picture.

Run ``python tests/material/plot_mask_edges.py`` (some minutes).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from mask_edges import (
    ALLOWED,
    KINDS,
    LIGHTS,
    MASKS,
    PAIRS,
    PRESETS,
    ROOT,
    Floats,
    Pair,
    Preset,
    edges,
    excess,
    kind_of,
    overshoot,
    read_presets,
    write_edges,
)

PAGE = ROOT / "docs" / "presets.md"
_PICTURE = ROOT / "docs" / "images" / "mask_edges.png"
_SHAPE = ("roughness", "anisotropic", "clearcoatGloss")
_EQUAL = {
    "nothing": (),
    "`roughness`, `anisotropic`, `clearcoatGloss`": _SHAPE,
    "`metallic`": ("metallic",),
    "all four": (*_SHAPE, "metallic"),
}
_WORST = 6


def written(page: str, name: str) -> str:
    """Return a table of the page."""
    (rows,) = re.findall(rf"<!-- edges: {name} -->\n(.*?)<!-- end -->", page, re.DOTALL)
    return rows


def kinds_table(presets: Mapping[str, Preset], kinds: Mapping[Pair, str]) -> str:
    """Count the pairs of each kind, by their models."""
    blended = {
        ("disney", "disney"): "their parameters",
        ("pixar", "pixar"): "their lobes",
        ("disney", "pixar"): "what is evaluated",
    }
    rows = [("presets", "what is blended", "within 5 %", "up to its width", "beyond")]
    for models, what in blended.items():
        found = [kind for (a, b), kind in kinds.items() if sorted((presets[a][0], presets[b][0])) == list(models)]
        rows.append((" and ".join(models), what, *(str(found.count(kind)) for kind in KINDS)))
    return _markdown(rows)


def tables(presets: Mapping[str, Preset]) -> dict[str, str]:
    """Return the tables that are measured anew."""
    pairs = [pair for pair in PAIRS if all(presets[name][0] == "disney" for name in pair)]
    return {"equal": _equal_table(presets, pairs), "worst": _worst_table(presets, pairs)}


def _equal_table(presets: Mapping[str, Preset], pairs: Sequence[Pair]) -> str:
    rows = [("made equal first", "pairs within 5 %")]
    for what, equal in _EQUAL.items():
        worst = np.max([overshoot(light, presets, pairs, equal) for light in LIGHTS], axis=0)
        rows.append((what, f"{np.mean(worst <= ALLOWED):.0%}"))
    return _markdown(rows)


def _worst_table(presets: Mapping[str, Preset], pairs: Sequence[Pair]) -> str:
    """Return the worst pixel of the worst pairs, each preset once."""
    shown = {light: edges(light, presets, pairs) for light in LIGHTS}
    worst = {light: excess(values).max(axis=(1, 2, 3)) for light, values in shown.items()}
    rows = [("pair", "light", "mask", "the two", "blend", "excess", "equal highlights", "equal `metallic`", "both")]
    used: set[str] = set()
    for number in np.argsort(-np.max(list(worst.values()), axis=0)):
        pair = pairs[number]
        if used & set(pair) or len(rows) > _WORST:
            continue
        used |= set(pair)
        light = max(LIGHTS, key=lambda each: worst[each][number])
        values = shown[light][number]
        found = excess(values[None])[0]
        step, pixel, channel = np.unravel_index(found.argmax(), found.shape)
        below, blend, above = (f"{values[index, pixel, channel]:.3f}" for index in (0, step, -1))
        left = (overshoot(light, presets, [pair], equal)[0] for equal in list(_EQUAL.values())[1:])
        excesses = (f"{max(value, 0.0):.2g}" for value in (found.max(), *left))
        rows.append((", ".join(pair), light, f"{MASKS[step]:g}", f"{below}, {above}", blend, *excesses))
    return _markdown(rows)


def _markdown(rows: Sequence[tuple[str, ...]]) -> str:
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([lines[0], "|---" * len(rows[0]) + "|", *lines[1:]]) + "\n"


def _draw(worst: Floats) -> None:
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
    figure.savefig(_PICTURE, dpi=100)


def main() -> None:
    """Write everything."""
    presets = read_presets()
    worst = np.max([overshoot(light, presets, PAIRS) for light in LIGHTS], axis=0)
    kinds = {pair: kind_of(value) for pair, value in zip(PAIRS, worst, strict=True)}
    write_edges(kinds)
    page = PAGE.read_text()
    for name, table in {"kinds": kinds_table(presets, kinds), **tables(presets)}.items():
        page = page.replace(f"<!-- edges: {name} -->\n{written(page, name)}", f"<!-- edges: {name} -->\n{table}")
    PAGE.write_text(page)
    _draw(worst)


if __name__ == "__main__":
    main()
