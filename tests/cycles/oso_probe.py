"""Write arrays into the text of a compiled shader: ``python oso_probe.py REQUEST.npz ANSWER.oso``."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy  # noqa: F401  (brings the modules of Cycles)
import numpy as np

from lookdev.cycles.shaders import array_text, with_arrays
from lookdev.lifetime import leaving

if __name__ == "__main__":
    with leaving(), np.load(sys.argv[1]) as stored:
        arrays = {name: array_text(stored[name]) for name in stored.files if name != "oso"}
        Path(sys.argv[2]).write_text(with_arrays(str(stored["oso"]), arrays), encoding="utf-8")
