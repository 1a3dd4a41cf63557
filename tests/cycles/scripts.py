"""Programs of this folder, run in processes of their own: they import bpy."""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lookdev.codegen import NodeSource


def run_script(name: str, *arguments: object) -> None:
    command = [sys.executable, str(Path(__file__).with_name(name)), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]


def tree_pictures(sources: Mapping[str, NodeSource], folder: Path) -> dict[str, Any]:
    """Return the pictures of node trees that `tree_probe.py` renders."""
    request, out = folder / "sources.pickle", folder / "pictures.npz"
    request.write_bytes(pickle.dumps(sources))
    run_script("tree_probe.py", request, out)
    with np.load(out, allow_pickle=False) as stored:
        return dict(stored)
