"""Parameters of a model: type, default, ranges and help.

`shaders/shaderDefs.usda`, the generated OSL and every message about a parameter follow these records.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Value = float | tuple[float, float, float] | str


@dataclass(frozen=True)
class Parameter:
    """One input of a reflectance model.

    `hard` is the range outside which the model has no meaning: a constant outside it is an error at load time. `soft`
    is the range of a slider. Colours are linear Rec.709 and their ranges hold per channel. A ``"token"`` is one of
    `choices`, forms of the model between which code generation chooses: it must be constant. A ``"normal"`` is a vector
    in the frame of tangent, bitangent and shading normal, of any length but zero. A `directed` number makes the model
    anisotropic unless it is 0.
    """

    name: str
    kind: Literal["float", "color", "normal", "token"]
    default: Value
    hard: tuple[float, float] = (0.0, 1.0)
    soft: tuple[float, float] = (0.0, 1.0)
    choices: tuple[str, ...] = ()
    help: str = ""
    directed: bool = False


def normal_parameter(name: str, help: str) -> Parameter:
    """Return a normal, by default the shading normal."""
    return Parameter(name, "normal", (0.0, 0.0, 1.0), hard=(-1.0, 1.0), soft=(-1.0, 1.0), help=help)


MASK = Parameter("mask", "float", 1.0, help="How much of a layer there is.")
"""The mask of a layer, of whatever model."""
