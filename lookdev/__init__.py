"""Batch look-dev turntables: film reflectance models rendered exactly as published, on Blender's Cycles.

`docs/architecture.md` describes the packages and the order in which they import each other.
"""

from importlib.metadata import version

__version__ = version("lookdev")
