"""Reader of the displacement of a look: a LookdevDisplacement shader, connected to outputs:lookdev:displacement."""

from __future__ import annotations

from math import inf
from typing import Literal, get_args

from pxr import UsdShade

from lookdev.brdf import Parameter
from lookdev.errors import nearest_hint
from lookdev.material.look import Displacement, Formula, Primvar, Texture, depends_on_view
from lookdev.material.usd.inputs import read_input
from lookdev.material.usd.network import Network, Source, shader_id

TERMINAL = "outputs:lookdev:displacement"
SHADER = "LookdevDisplacement"

Units = Literal["object", "world"]

_HEIGHT = Parameter("height", "float", 0.0, (-inf, inf), (-inf, inf))
_INPUTS = ("height", "scale", "midlevel", "units")


def read_displacement(network: Network, material: UsdShade.Material) -> Displacement | None:
    """Return the displacement of a material; None where it has none or, with a fault added, where it is wrong."""
    terminal = material.GetPrim().GetAttribute(TERMINAL)
    if not terminal:
        return None
    source = network.follow(terminal)
    if not isinstance(source, Source):
        if source is not None:
            network.add_fault(terminal, "is not connected", f"connect it to a {SHADER} shader")
        return None
    if (identifier := shader_id(source.shader)) != SHADER:
        message = f"<{source.path}> has the unknown info:id '{identifier}'"
        network.add_fault(terminal, message, nearest_hint(identifier, [SHADER]))
        return None
    network.check_inputs(source.shader, _INPUTS)
    inputs = {name: source.shader.GetPrim().GetAttribute(f"inputs:{name}") for name in _INPUTS}
    fault_count = len(network.faults)
    height = read_input(network, inputs["height"], _HEIGHT) if inputs["height"] else None
    if height is None and len(network.faults) == fault_count:
        network.add_unset_fault(f"{source.path}.inputs:height")
    scale, midlevel = network.read_float(inputs["scale"], 1.0), network.read_float(inputs["midlevel"], 0.0)
    units = network.read_choice(inputs["units"], get_args(Units))
    if not isinstance(height, float | Texture | Primvar | Formula):
        return None
    if depends_on_view(height):
        hint = "a surface has one shape for all views; parameters and masks can depend on the view"
        network.add_fault(f"{source.path}.inputs:height", "depends on the view", hint)
        return None
    return Displacement(height, scale, midlevel, units)
