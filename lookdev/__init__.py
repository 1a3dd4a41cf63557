"""Batch look-dev turntables: film reflectance models rendered exactly as published, on Blender's Cycles.

The tree reads in the direction data flows: `job` (what the user asked), `material`, `asset` and `ibl` (what is
turned, and in which light), `brdf` (the models) and `codegen` (model to shader code), `plan` (what to render),
`cycles` (the renderer, in a process of its own), `output` (what the user gets), `batch` (running it).
"""

from importlib.metadata import version

__version__ = version("lookdev")
