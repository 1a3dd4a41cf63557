"""A check that shaders fit into Cycles' node machine (SVM), which only logs a shader that is too big."""

from __future__ import annotations

import re

import bpy

from lookdev.cycles import engine
from lookdev.cycles.streams import capture_output
from lookdev.errors import RenderError

_OVERFLOW = re.compile(r"out of SVM stack space, shader \"(?P<material>[^\"]*)\"", re.IGNORECASE)


def check_stack(scene: bpy.types.Scene) -> None:
    """Compile the shaders of a scene, and check that each fits into the stack of SVM.

    Raises
    ------
    RenderError
        A shader needs more stack than SVM has, so that parts of it would be missing.
    """
    _, log = capture_output(lambda: engine.compile_shaders(scene))
    names = list(dict.fromkeys(match["material"] for match in _OVERFLOW.finditer(log)))
    if names:
        looks = ", ".join(f"'{name}'" for name in names)
        raise RenderError(
            f"look {looks}: its nodes need more numbers at once than Cycles' node machine has room for; "
            'give it fewer layers, masks or textures, or render it with backend = "exact"'
        )
