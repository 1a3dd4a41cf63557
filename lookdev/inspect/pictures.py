"""Renders a portrait of an asset, with a colour for each part, and a contact sheet of spheres, one for each preset.

These are the pictures of `lookdev inspect --png` and of `lookdev materials`.
"""

from __future__ import annotations

import colorsys
import hashlib
import re
from collections.abc import Iterator, Sequence
from itertools import takewhile
from pathlib import Path

import numpy as np

from lookdev.arrays import Bytes
from lookdev.asset import Asset, load_asset
from lookdev.asset.silhouette import hull_points
from lookdev.build.refine import Refiner
from lookdev.cache import cache_dir
from lookdev.job import JobOutputs, JobTurntable
from lookdev.light import load_environment, prepare_light
from lookdev.material import Layer, Look
from lookdev.material.library import Preset
from lookdev.material.library.edit import preset_look
from lookdev.output import OUTPUTS
from lookdev.output.color import SHIPPED
from lookdev.output.display import composite, to_display
from lookdev.output.exr import read_frame
from lookdev.output.sheet import write_legend, write_sheet
from lookdev.plan import Setup, TurntableFrames, make_setup
from lookdev.run.events import ReportEvent, SheetWritten
from lookdev.run.frames import RunResult
from lookdev.run.render import render_setups
from lookdev.scene import Film, Sampling, Scene, frame_fill
from lookdev.space import Color

_OUTPUTS = JobOutputs.model_validate({"ocio": SHIPPED, **dict.fromkeys(OUTPUTS, False)})
_VIEW = _OUTPUTS.display_view()

_PORTRAIT_SIZE = (768, 576)
_PORTRAIT_SAMPLING = Sampling(samples=64, bounces=1)
_AZIMUTH = -30.0  # degrees: two sides of the asset are visible
_FILL = 0.85  # the fraction of the frame that the asset fills
_MAX_COLORS = 24  # the number of colours that can still be distinguished
_GOLDEN_RATIO = 0.6180339887498949

_THUMBNAIL = 128  # pixels: the width and height of a preset's picture
_THUMBNAIL_SAMPLING = Sampling(samples=128, error=0.01)
_THUMBNAIL_LIGHT = "studio"


def write_portrait(asset: Asset, picture: Path, report: ReportEvent = lambda event: None) -> RunResult:
    """Refine and render an asset in uniform white light, and write the picture as PNG with a legend of the parts.

    If there are many parts, all parts of a group have the same colour (`group_names`). The frame is stored in the
    cache. `report` receives the events of the render. Raises LookdevError if the picture cannot be written, and the
    errors of `render_setups`.
    """
    groups = group_names([slot.path for slot in asset.slots])
    colors = dict(zip(dict.fromkeys(groups), _colors(), strict=False))
    looks = {name: _part_look(number, color) for number, (name, color) in enumerate(colors.items())}
    looks_by_part = {slot.path: looks[group] for slot, group in zip(asset.slots, groups, strict=True)}
    light = prepare_light(load_environment(builtin="white"))
    camera = frame_fill(hull_points(asset.meshes, asset.instances), _PORTRAIT_SIZE, fill=_FILL, arcs=[(_AZIMUTH, 0.0)])
    refined, _ = Refiner("auto", _PORTRAIT_SIZE[0]).refine(asset, camera)
    scene = Scene(refined, looks_by_part, (light,), camera, Film(_PORTRAIT_SIZE))
    setup = make_setup("parts", "white", scene, _PORTRAIT_SAMPLING)
    result, pictures = _render_pictures([setup], _AZIMUTH, cache_dir("portraits", refined.digest[:16]), 0.02, report)
    if pictures:
        write_legend(picture, pictures[0], asset.name, list(colors.items()), _VIEW)
    return result


def write_library_sheet(presets: Sequence[Preset], sheet: Path, report: ReportEvent = lambda event: None) -> RunResult:
    """Render presets, at least one, and write a contact sheet as PNG unless a frame fails.

    The frames are stored in the cache. `report` receives the events of the render. Raises LookdevError if a preset is
    wrong or the sheet cannot be written, and the errors of `render_setups`.
    """
    folders = "\n".join(sorted({str(preset.file.parent) for preset in presets}))
    output = cache_dir("library", hashlib.sha256(folders.encode()).hexdigest()[:16])
    asset, light = load_asset(builtin="sphere"), prepare_light(load_environment(builtin=_THUMBNAIL_LIGHT))
    setups = []
    for preset in presets:
        # A look's name is the name of a folder, but a preset may have any name.
        look = preset_look(preset, re.sub(r"[^A-Za-z0-9._-]", "_", preset.name))
        scene = Scene.of_look(asset, look, light, (_THUMBNAIL, _THUMBNAIL))
        setups.append(make_setup(look.name, _THUMBNAIL_LIGHT, scene, _THUMBNAIL_SAMPLING))
    # The background, 0.05, is darker than metals and brighter than black looks.
    result, pictures = _render_pictures(setups, 0.0, output, 0.05, report)
    if pictures:
        labels = [f"{preset.name} ({preset.category})" for preset in presets]
        write_sheet(sheet, pictures, labels, "materials", cell=_THUMBNAIL)
        report(SheetWritten(sheet))
    return result


def _render_pictures(
    setups: Sequence[Setup], start: float, output: Path, background: float, report: ReportEvent
) -> tuple[RunResult, list[Bytes]]:
    """Render one frame of each setup, with the asset at the angle `start`, in degrees.

    A setup is a scene with one look under one light. `output` is the folder of the frames. Return the result and the
    display pictures (height, width, 3), composited over a linear grey `background`; no pictures if a frame fails.
    """
    turntables = (JobTurntable(kind="element", frames=1, start=start),)
    plan, result = render_setups(setups, TurntableFrames(turntables, output), _OUTPUTS, report=report)
    # A reel is the frames of one setup on one turntable.
    files = [reel.files[0] for reel in plan.reels] if result.exit_code == 0 else []
    return result, [to_display(composite(*read_frame(file), np.full(3, background)), _VIEW) for file in files]


def group_names(paths: Sequence[str]) -> list[str]:
    """Return the group of each prim path.

    The name of a group is the path below the common ancestor of all paths. It is cut to the greatest depth at which
    there are at most `_MAX_COLORS` groups.
    """
    split_paths = [path.strip("/").split("/") for path in paths]
    levels = zip(*(path[:-1] for path in split_paths), strict=False)
    common = len(list(takewhile(lambda names: len(set(names)) == 1, levels)))
    for depth in range(max(map(len, split_paths)), common, -1):
        names = ["/".join(path[common:depth]) for path in split_paths]
        if len(set(names)) <= _MAX_COLORS:
            return names
    return [split_paths[0][common - 1] if common else "all"] * len(paths)


def _colors() -> Iterator[Color]:
    """Yield `_MAX_COLORS` linear colours; consecutive colours differ much, as hues advance by the golden ratio."""
    for i in range(_MAX_COLORS):
        yield colorsys.hsv_to_rgb(i * _GOLDEN_RATIO % 1.0, (0.85, 0.55, 0.35)[i % 3], 0.75)


def _part_look(number: int, color: Color) -> Look:
    """Return a rough look of one colour, without specular reflection, for the parts with that colour."""
    return Look(f"part{number}", (Layer("Base", "disney", {"baseColor": color, "roughness": 1.0, "specular": 0.0}),))
