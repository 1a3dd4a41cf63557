"""Files of rigs, written for a test."""

from pathlib import Path

import numpy as np

from lookdev.arrays import Floats32
from lookdev.light.dome.environment import write_exr
from lookdev.light.rig import LightRig, load_rig

Z_UP = 'upAxis = "Z"\nmetersPerUnit = 1'
Y_UP_CM = 'upAxis = "Y"\nmetersPerUnit = 0.01'

DIM = 'def SphereLight "Dim"\n{\n    float inputs:radius = 1\n}\n'
"""A light with default values, except for its radius."""


def write_rig(file: Path, lights: str, stage: str = Z_UP) -> Path:
    """Write a file whose default prim, /Rig, holds lights."""
    file.write_text(f'#usda 1.0\n(\n    defaultPrim = "Rig"\n{stage}\n)\ndef Xform "Rig"\n{{\n{lights}\n}}\n')
    return file


def rig(folder: Path, lights: str, stage: str = Z_UP) -> LightRig:
    """Return a rig of lights, below the default prim of a file."""
    return load_rig(write_rig(folder / "rig.usda", lights, stage), sampled=False)


def light(kind: str, attributes: str, schemas: str = "", name: str = "Lamp") -> str:
    """Return the text of a light with attributes, separated by semicolons."""
    applied = f" (prepend apiSchemas = [{schemas}])" if schemas else ""
    return (
        f'def {kind} "{name}"{applied}\n{{\n'
        + "".join(f"{attribute.strip()}\n" for attribute in attributes.split(";"))
        + "}\n"
    )


def write_image(file: Path, pixels: Floats32) -> Path:
    """Write an EXR of R, G, B."""
    write_exr(file, "RGB", pixels.astype(np.float32))
    return file
