"""Compares the versions of packages between the machines of a run.

Frames are the same on each machine only if these versions are equal.
"""

from __future__ import annotations

import platform
from collections.abc import Mapping

import numpy as np

import lookdev
from lookdev.cache import package_digest
from lookdev.errors import RenderError
from lookdev.rendering.backends import BACKENDS


def package_versions(backend: str) -> dict[str, str]:
    """Return the versions of the packages that render frames of a backend on this machine, by name."""
    try:
        renderer = BACKENDS[backend].version()
    except RenderError as error:  # the renderer is not installed
        renderer = f"none ({error})"
    return {
        "lookdev": lookdev.__version__,
        "code of lookdev": package_digest()[:12],
        "Python": ".".join(platform.python_version_tuple()[:2]),
        "NumPy": np.__version__,
        f"backend '{backend}'": renderer,
    }


def version_mismatch(local: Mapping[str, str], remote: Mapping[str, str], worker: str) -> str:
    """Return a message about differences of a worker's `remote` versions from the `local` versions, or ""."""
    differences = [
        f"{name} {remote.get(name, 'none')}, here {value}" for name, value in local.items() if remote.get(name) != value
    ]
    if not differences:
        return ""
    return (
        f"{worker} has {'; '.join(differences)}: its frames would differ. Install the same versions in the environment "
        "of all workers, or start the run from theirs"
    )
