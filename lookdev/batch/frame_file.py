"""A rendered frame as an EXR: its layers and its header."""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

import lookdev
from lookdev.batch.pictures import write_shared
from lookdev.metrics import standard_error
from lookdev.output.exr import write_frame
from lookdev.render.cryptomatte import matte_header
from lookdev.render.passes import LIGHT
from lookdev.render.task import FrameTask
from lookdev.render.worker import Rendered


def write_rendered(
    task: FrameTask, rendered: Rendered, beauty: NDArray[np.float32], more: Mapping[str, str] = MappingProxyType({})
) -> None:
    """Write the file of a frame, `beauty` (H, W, 3) being the mean of its halves, exposed; raises OutputError.

    `more` are further entries of the header.

    The layer ``raw`` is the picture before it was denoised, ``error`` the standard error of what halves have.
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
    header |= more
    exposure, layers = np.float32(2.0**task.exposure), {}
    if rendered.raw is not None:
        layers["raw"] = rendered.raw * exposure
        header["raw.relmse"] = repr(rendered.raw_relmse)
    if not math.isnan(rendered.relmse):  # else the halves are one render
        layers["error"] = standard_error(rendered.a, rendered.b) * exposure
    channels = task.scene.arrays
    planes = {
        channel: rendered.passes[name][..., i] * (exposure if name in LIGHT else np.float32(1.0))
        for name, each in channels.items()
        for i, channel in enumerate(each)
    }
    attributes = {
        key: text for matte, names in rendered.names.items() for key, text in matte_header(matte, names).items()
    }
    write_shared(
        task.files,
        lambda path: write_frame(path, beauty, rendered.alpha, header, layers, planes=planes, attributes=attributes),
    )
