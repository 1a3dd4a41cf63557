"""Writes a rendered frame as an EXR with layers and a header, and reports signs that something is wrong with it."""

from __future__ import annotations

import math
import platform
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime

import numpy as np
from numpy.typing import ArrayLike

import lookdev
from lookdev.arrays import Floats32
from lookdev.metrics import standard_error
from lookdev.output.exr import write_frame
from lookdev.output.frame_name import FrameName
from lookdev.rendering.cryptomatte import matte_header
from lookdev.rendering.executors.protocol import StoredFrame
from lookdev.rendering.passes import CATCHER_ARRAYS, light_parts
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.task import FrameTask
from lookdev.run.pictures import link_to_first
from lookdev.scene.charts.props import PROPS_STRIP_KEY, Strip
from lookdev.space import REC709


def store_frame(task: FrameTask, rendered: WorkerFrame) -> StoredFrame:
    """Write the files of a frame, and return its figures and notes for the user; raises OutputError.

    The notes include the results of `frame_doubts`. In a frame of reference props, such as a colour chart, the colours
    of the props are measured. The notes state deviations from the colours that follow from the light.
    """
    beauty, constant = exposed_beauty(task, rendered), all(light.constant for light in task.scene.lights)
    # A strip of props that is too small in the picture to be measured has a size note.
    doubts, header = list(frame_doubts(rendered, beauty, constant_light=constant)), {}
    if (
        PROPS_STRIP_KEY in task.labels
        and not (strip := Strip.of_label(task.labels[PROPS_STRIP_KEY], task.scene.resolution)).size_note()
    ):
        # Not at the top: Embree takes long to import, and few jobs need it.
        from lookdev.checks.charts import charts_doubts, charts_header, check_charts

        readings = check_charts(task, strip, rendered)
        doubts += charts_doubts(readings)
        header = dict(charts_header(readings))
    _write_frame_file(task, rendered, beauty, header)
    notes = (f"{FrameName.of(task.files[0])}: {doubt}" for doubt in doubts)
    return StoredFrame(rendered.samples, rendered.relmse, (*rendered.notes, *notes))


def frame_doubts(rendered: WorkerFrame, beauty: ArrayLike, *, constant_light: bool = False) -> Iterator[str]:
    """Yield signs that something is wrong with a frame, each as a sentence without its subject, the frame.

    Parameters
    ----------
    rendered
        The frame: its halves and its alpha are examined.
    beauty : (H, W, 3)
        The mean of the halves, exposed, as in the file.
    constant_light
        Whether the radiance is the same from all directions. Equal halves are then no sign of a fault.
    """
    overflowed = ~np.isfinite(beauty).all(axis=-1)
    if overflowed.any():
        y, x = np.argwhere(overflowed)[0]
        yield (
            f"has pixels brighter than 32-bit floats ({overflowed.sum()}, the first in column {x}, row {y}); a lower"
            " exposure of its light would be right"
        )
    covered = rendered.alpha > 0.0
    if not covered.any():
        yield "is empty: no part of the asset is in the picture"
        return
    is_black = not ((rendered.a[covered] != 0.0).any() or (rendered.b[covered] != 0.0).any())
    if is_black:
        yield "is black: no light reaches the viewer from the asset"
    elif not constant_light and np.array_equal(rendered.a, rendered.b):
        yield "has two equal halves: its error is unknown, though it is stated as 0"


def exposed_beauty(task: FrameTask, rendered: WorkerFrame) -> Floats32:
    """Return the mean of the halves of a frame, (H, W, 3), with the exposure of the frame applied."""
    with np.errstate(over="ignore"):
        return np.asarray((rendered.a + rendered.b) * np.float32(0.5 * 2.0**task.exposure))


def _write_frame_file(task: FrameTask, rendered: WorkerFrame, beauty: Floats32, extra: Mapping[str, str]) -> None:
    """Write a frame to its first file, and link its other files to the first.

    beauty : from `exposed_beauty`; extra : further entries of the header. The layer ``raw`` is the picture before
    denoising. The layer ``error`` is the standard error of each pixel and channel, from the difference of the halves.
    """
    header = task.labels | {
        "digest": task.digest,
        "samples": str(rendered.samples),
        "seconds": repr(rendered.seconds),
        "relmse": repr(rendered.relmse),
        "version.blender": rendered.blender,
        "version.lookdev": lookdev.__version__,
        "version.python": platform.python_version(),
        "version.numpy": np.__version__,
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    header |= extra
    exposure, layers = np.float32(2.0**task.exposure), {}
    if rendered.raw is not None:
        layers["raw"] = rendered.raw * exposure
        header["raw.relmse"] = repr(rendered.raw_relmse)
    if not math.isnan(rendered.relmse):  # it is nan where both halves are the same render
        layers["error"] = standard_error(rendered.a, rendered.b) * exposure
    passes, groups = task.scene.sampling.passes, task.scene.light_group_names
    arrays, light = task.scene.channels_by_array, {*light_parts(passes, groups), *CATCHER_ARRAYS}
    planes = {
        channel: rendered.passes[name][..., i] * (exposure if name in light else np.float32(1.0))
        for name, channels in arrays.items()
        for i, channel in enumerate(channels)
    }
    space = task.scene.space
    if space != REC709:
        header["space"] = space
    attributes = {
        key: text for matte, names in rendered.names.items() for key, text in matte_header(matte, names).items()
    }
    write_frame(
        task.files[0], beauty, rendered.alpha, header, layers, planes=planes, attributes=attributes, space=space
    )
    link_to_first(task.files)
