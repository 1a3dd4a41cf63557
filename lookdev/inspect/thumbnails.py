"""A contact sheet of a preset library: each preset on a sphere in studio light."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lookdev.asset import load_asset
from lookdev.cache import cache_dir
from lookdev.job import JobOutputs, JobTurntable
from lookdev.light import load_environment, prepare_light
from lookdev.material.library import Preset
from lookdev.material.library.edit import preset_look
from lookdev.output import OUTPUTS
from lookdev.output.color import SHIPPED
from lookdev.output.display import composite, to_display
from lookdev.output.exr import read_frame
from lookdev.output.sheet import write_sheet
from lookdev.plan import Turns, make_setup
from lookdev.run.events import Report, SheetWritten
from lookdev.run.frames import RunResult
from lookdev.run.render import render_setups
from lookdev.scene import Sampling, Scene

SIZE = 128
"""Pixels of a thumbnail's side."""

_BACKGROUND = 0.05  # linear: metals are brighter, black looks darker
_LIGHT = "studio"
_SAMPLING = Sampling(samples=128, error=0.01)
_TURNTABLES = (JobTurntable(kind="element", frames=1),)
_OUTPUTS = JobOutputs.model_validate({"ocio": SHIPPED, **dict.fromkeys(OUTPUTS, False)})
_VIEW = _OUTPUTS.shown()


def write_library_sheet(presets: Sequence[Preset], sheet: Path, report: Report = lambda event: None) -> RunResult:
    """Render presets, at least one, and write a contact sheet as PNG unless a frame fails.

    The frames are stored in the cache. Raises LookdevError if a preset is wrong or the sheet cannot be written, and as
    `render_setups` does.
    """
    folders = "\n".join(sorted({str(preset.file.parent) for preset in presets}))
    output = cache_dir("library", hashlib.sha256(folders.encode()).hexdigest()[:16])
    asset, light = load_asset(builtin="sphere"), prepare_light(load_environment(builtin=_LIGHT))
    setups = []
    for preset in presets:
        # A look's name is the name of a folder; a preset may have any name.
        look = preset_look(preset, re.sub(r"[^A-Za-z0-9._-]", "_", preset.name))
        scene = Scene.of_look(asset, look, light, (SIZE, SIZE))
        setups.append(make_setup(look.name, _LIGHT, scene, _SAMPLING))
    plan, result = render_setups(setups, Turns(_TURNTABLES, output), _OUTPUTS, report=report)
    if result.exit_code == 0:
        background = np.full(3, _BACKGROUND)
        files = [reel.files[0] for reel in plan.reels]
        images = [to_display(composite(*read_frame(file), background), _VIEW) for file in files]
        labels = [f"{preset.name} ({preset.category})" for preset in presets]
        write_sheet(sheet, images, labels, "materials", cell=SIZE)
        report(SheetWritten(sheet))
    return result
