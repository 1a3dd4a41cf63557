"""What has to be the same on the machines of a run, so that a frame is the same on each."""

from __future__ import annotations

import platform
from collections.abc import Mapping

import numpy as np

import lookdev
from lookdev.cache import package_digest
from lookdev.errors import RenderError
from lookdev.rendering.backends import BACKENDS


def versions(backend: str) -> dict[str, str]:
    """Return the versions of what renders frames of a backend here, by name."""
    try:
        renderer = BACKENDS[backend].version()
    except RenderError as error:  # it is not installed
        renderer = f"none ({error})"
    return {
        "lookdev": lookdev.__version__,
        "code of lookdev": package_digest()[:12],
        "Python": ".".join(platform.python_version_tuple()[:2]),
        "NumPy": np.__version__,
        f"backend '{backend}'": renderer,
    }


def mismatch(here: Mapping[str, str], there: Mapping[str, str], worker: str) -> str:
    """Return how a worker's versions differ from those here, and what to do; "" where they do not."""
    differing = [
        f"{name} {there.get(name, 'none')}, here {value}" for name, value in here.items() if there.get(name) != value
    ]
    if not differing:
        return ""
    return (
        f"{worker} has {'; '.join(differing)}: its frames would differ. Install the same versions in the environment "
        "of all workers, or start the run from theirs"
    )
