"""Compile a shader that the compiler refuses, and print the error: ``python refused_probe.py ANSWER.txt``."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy  # noqa: F401  (brings the modules of Cycles)

from lookdev.codegen import ShaderSource
from lookdev.cycles.shaders import compile_osl
from lookdev.errors import RenderError
from lookdev.lifetime import leaving

if __name__ == "__main__":
    with leaving():
        try:
            compile_osl(ShaderSource("paint", "surface s(output color c = 0)\n{\n    c = nope;\n}\n", (), (), ""))
        except RenderError as error:
            Path(sys.argv[1]).write_text(str(error))
