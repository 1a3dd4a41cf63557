"""A picture of an asset with a colour for each part, or each group where there are many parts, and a legend."""

from __future__ import annotations

import colorsys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from lookdev.asset import Asset
from lookdev.asset.silhouette import hull_points
from lookdev.build.refine import Refiner
from lookdev.cache import cache_dir
from lookdev.job import JobOutputs, JobTurntable
from lookdev.light import load_environment, prepare_light
from lookdev.material import Layer, Look
from lookdev.output import OUTPUTS
from lookdev.output.color import SHIPPED
from lookdev.output.display import composite, to_display
from lookdev.output.exr import read_frame
from lookdev.output.legend import write_legend
from lookdev.plan import Turns, make_setup
from lookdev.run.events import Report
from lookdev.run.frames import RunResult
from lookdev.run.render import render_setups
from lookdev.scene import Film, Sampling, Scene, frame_fill

_SIZE = (768, 576)
_BACKGROUND = 0.02  # linear
_SAMPLING = Sampling(samples=64, bounces=1)
_AZIMUTH = -30.0  # degrees: two sides are visible
_FILL = 0.85
_TURNTABLES = (JobTurntable(kind="element", frames=1, start=_AZIMUTH),)
_OUTPUTS = JobOutputs.model_validate({"ocio": SHIPPED, **dict.fromkeys(OUTPUTS, False)})
_VIEW = _OUTPUTS.shown()
_MOST_COLORS = 24  # distinguishable colours
_GOLDEN_RATIO = 0.6180339887498949

Color = tuple[float, float, float]


def write_portrait(asset: Asset, picture: Path, report: Report = lambda event: None) -> RunResult:
    """Refine and render an asset in uniform light, and write it as PNG with a legend of its parts.

    The frame is stored in the cache. Raises LookdevError if the picture cannot be written, and as `render_setups` does.
    """
    groups = group_names([slot.path for slot in asset.slots])
    names = list(dict.fromkeys(groups))
    looks = {
        name: _part_look(number, color) for number, (name, color) in enumerate(zip(names, _colors(), strict=False))
    }
    looks_by_part = {slot.path: looks[group] for slot, group in zip(asset.slots, groups, strict=True)}
    light = prepare_light(load_environment(builtin="white"))
    camera = frame_fill(hull_points(asset), _SIZE, fill=_FILL, arcs=[(_AZIMUTH, 0.0)])
    refined, _ = Refiner("auto", _SIZE[0]).refine(asset, camera)
    setup = make_setup("parts", "white", Scene(refined, looks_by_part, (light,), camera, Film(_SIZE)), _SAMPLING)
    output = cache_dir("portraits", refined.digest[:16])
    plan, result = render_setups([setup], Turns(_TURNTABLES, output), _OUTPUTS, report=report)
    if result.exit_code == 0:
        pixels = to_display(composite(*read_frame(plan.reels[0].files[0]), np.full(3, _BACKGROUND)), _VIEW)
        write_legend(picture, pixels, asset.name, list(zip(names, _colors(), strict=False)), _VIEW)
    return result


def group_names(paths: Sequence[str]) -> list[str]:
    """Return a group name for each path: the path below the common ancestor, cut to at most `_MOST_COLORS` names."""
    split_paths = [path.strip("/").split("/") for path in paths]
    common = 0
    while all(len(path) > common + 1 and path[common] == split_paths[0][common] for path in split_paths):
        common += 1
    for depth in range(max(map(len, split_paths)), common, -1):
        names = ["/".join(path[common:depth]) for path in split_paths]
        if len(set(names)) <= _MOST_COLORS:
            return names
    return [split_paths[0][common - 1] if common else "all"] * len(paths)


def _colors() -> Iterator[Color]:
    """Yield `_MOST_COLORS` linear colours, each unlike the next: hues step by the golden ratio."""
    for i in range(_MOST_COLORS):
        yield colorsys.hsv_to_rgb(i * _GOLDEN_RATIO % 1.0, (0.85, 0.55, 0.35)[i % 3], 0.75)


def _part_look(number: int, color: Color) -> Look:
    return Look(f"part{number}", (Layer("Base", "disney", {"baseColor": color, "roughness": 1.0, "specular": 0.0}),))
