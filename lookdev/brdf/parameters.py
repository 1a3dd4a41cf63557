"""Parameters of a model: type, default, ranges and help.

The one source of truth: `shaders/shaderDefs.usda`, the generated OSL and every error message follow it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Value = float | tuple[float, float, float] | str


@dataclass(frozen=True)
class Parameter:
    """One input of a reflectance model.

    `hard` is the range outside which the model has no meaning: a value outside it is an error at load time.
    `soft` is what a slider offers. A ``"token"`` chooses between forms of the model at code-generation time, so
    it must be constant; `choices` lists its values. Colours are linear Rec.709 and the ranges hold per channel. A
    ``"normal"`` is a vector in the frame of tangent, bitangent and shading normal, of any length but zero. A `directed`
    number distinguishes a direction along the surface unless it is 0.
    """

    name: str
    kind: Literal["float", "color", "normal", "token"]
    default: Value
    hard: tuple[float, float] = (0.0, 1.0)
    soft: tuple[float, float] = (0.0, 1.0)
    choices: tuple[str, ...] = ()
    help: str = ""
    directed: bool = False


MASK = Parameter("mask", "float", 1.0, help="How much of a layer there is.")
"""The mask of a layer, of whatever model."""
