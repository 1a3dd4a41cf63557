"""A contact sheet of a library: each preset on a sphere in a studio, rendered as frames of any job are."""

from __future__ import annotations

import hashlib
import json
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lookdev.batch.events import Report, SheetWritten
from lookdev.batch.prepare import prepare_job
from lookdev.batch.run import RunResult, render_job
from lookdev.cache import cache_dir
from lookdev.job import load_job
from lookdev.material.library import Preset
from lookdev.material.library.edit import new_look
from lookdev.output.display import composite, to_display
from lookdev.output.exr import read_frame
from lookdev.output.sheet import write_sheet
from lookdev.plan import frame_files

SIZE = 128
"""Pixels of a thumbnail's side."""

_BEHIND = 0.05  # linear: dark enough for metals to shine, light enough for what is black to show
_JOB = f"""output = {{output}}
[asset]
builtin = "sphere"
[[ibl]]
name = "studio"
builtin = "studio"
[[turntable]]
kind = "element"
frames = 1
[render]
resolution = [{SIZE}, {SIZE}]
error = 0.01
samples = 128
background = [{_BEHIND}, {_BEHIND}, {_BEHIND}]
[outputs]
png = false
sheet = false
"""
_LOOK = """[[look]]
name = "{name}"
material = "{name}.usda"
"""


def write_library_sheet(presets: Sequence[Preset], sheet: Path, report: Report = lambda event: None) -> RunResult:
    """Write a contact sheet of presets as PNG, unless a frame fails.

    Frames are kept in the cache: only what is new or has changed is rendered.

    Parameters
    ----------
    presets
        At least one, in the order of the sheet.
    report
        Is told what happens.

    Raises
    ------
    LookdevError
        A preset is wrong, the sheet cannot be written, or as for `render_job`.
    """
    folders = "\n".join(sorted({str(preset.file.parent) for preset in presets}))
    output = cache_dir("library", hashlib.sha256(folders.encode()).hexdigest()[:16])
    # Presets may be called anything; looks become folders.
    names = [re.sub(r"[^A-Za-z0-9._-]", "_", preset.name) for preset in presets]
    with tempfile.TemporaryDirectory() as scratch:
        for name, preset in zip(names, presets, strict=True):
            new_look(Path(scratch, f"{name}.usda"), preset, "Preset")
        path = Path(scratch, "library.toml")
        text = _JOB.format(output=json.dumps(str(output), ensure_ascii=False)) + "".join(
            _LOOK.format(name=name) for name in names
        )
        path.write_text(text, encoding="utf-8")
        job = load_job(path)
        result = render_job(path, prepare_job, report=report)
    if result.exit_code == 0:
        files = [frame_files(job, name, "studio", job.turntable[0])[0] for name in names]
        background = np.full(3, _BEHIND)
        shown = [to_display(composite(*read_frame(file), background), job.outputs.view) for file in files]
        labels = [f"{preset.name} ({preset.category})" for preset in presets]
        write_sheet(sheet, shown, labels, "materials", cell=SIZE)
        report(SheetWritten(sheet))
    return result
