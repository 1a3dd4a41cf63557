"""A picture of an asset with a colour for each part, or for each group of parts where there are many, and a legend."""

from __future__ import annotations

import colorsys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from lookdev.asset import Asset
from lookdev.asset.silhouette import outline
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
_BEHIND = 0.02  # linear
_SAMPLING = Sampling(samples=64, bounces=1)
_TURN = -30.0  # degrees: two sides are seen
_FILL = 0.85
_TURNTABLES = (JobTurntable(kind="element", frames=1, start=_TURN),)
_OUTPUTS = JobOutputs.model_validate({"ocio": SHIPPED, **dict.fromkeys(OUTPUTS, False)})
_VIEW = _OUTPUTS.shown()
_MOST = 24  # colours that can be told apart
_GOLDEN_RATIO = 0.6180339887498949

Color = tuple[float, float, float]


def write_portrait(asset: Asset, picture: Path, report: Report = lambda event: None) -> RunResult:
    """Render an asset, from its cages on, in uniform light, and write it as PNG with a legend of its parts.

    The frame is kept in the cache. Raises LookdevError where the picture cannot be written, or as `render_setups`.
    """
    groups = group_names([slot.path for slot in asset.slots])
    names = list(dict.fromkeys(groups))
    looks = {name: _look(number, color) for number, (name, color) in enumerate(zip(names, _colors(), strict=False))}
    wears = {slot.path: looks[group] for slot, group in zip(asset.slots, groups, strict=True)}
    light = prepare_light(load_environment(builtin="white"))
    camera = frame_fill(outline(asset), _SIZE, fill=_FILL, arcs=[(_TURN, 0.0)])
    refined, _ = Refiner("auto", _SIZE[0]).refine(asset, camera)
    setup = make_setup("parts", "white", Scene(refined, wears, (light,), camera, Film(_SIZE)), _SAMPLING)
    output = cache_dir("portraits", refined.digest[:16])
    plan, result = render_setups([setup], Turns(_TURNTABLES, output), _OUTPUTS, report=report)
    if result.exit_code == 0:
        shown = to_display(composite(*read_frame(plan.reels[0].files[0]), np.full(3, _BEHIND)), _VIEW)
        write_legend(picture, shown, asset.name, list(zip(names, _colors(), strict=False)), _VIEW)
    return result


def group_names(paths: Sequence[str]) -> list[str]:
    """Return the name of each part: its path below what all share, shortened until there are at most `_MOST`."""
    split = [path.strip("/").split("/") for path in paths]
    shared = 0
    while all(len(each) > shared + 1 and each[shared] == split[0][shared] for each in split):
        shared += 1
    for depth in range(max(map(len, split)), shared, -1):
        names = ["/".join(each[shared:depth]) for each in split]
        if len(set(names)) <= _MOST:
            return names
    return [split[0][shared - 1] if shared else "all"] * len(paths)


def _colors() -> Iterator[Color]:
    """Yield `_MOST` linear colours, hues by the golden ratio, that differ from their neighbours."""
    for i in range(_MOST):
        yield colorsys.hsv_to_rgb(i * _GOLDEN_RATIO % 1.0, (0.85, 0.55, 0.35)[i % 3], 0.75)


def _look(number: int, color: Color) -> Look:
    return Look(f"part{number}", (Layer("Base", "disney", {"baseColor": color, "roughness": 1.0, "specular": 0.0}),))
