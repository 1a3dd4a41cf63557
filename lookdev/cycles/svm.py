"""Check that the shaders of a scene fit Cycles' node machine (SVM), which only logs one that is too big."""

from __future__ import annotations

import re
from typing import Any

from lookdev.cycles import engine
from lookdev.cycles.streams import captured
from lookdev.errors import RenderError

_OVERFLOW = re.compile(r"out of SVM stack space, shader \"(?P<material>[^\"]*)\"", re.IGNORECASE)
# Blender renders nothing smaller.
_SIDE = 4


def check_stack(scene: Any) -> None:
    """Render a tiny picture of a scene to compile its shaders, which persistent data keeps for the frames.

    Raises
    ------
    RenderError
        A shader needs more stack than SVM has: parts of it would be missing.
    """
    render = scene.render
    size = render.resolution_x, render.resolution_y
    render.resolution_x = render.resolution_y = _SIDE
    try:
        _, log = captured(lambda: engine.render_whole(scene, samples=1))
    finally:
        render.resolution_x, render.resolution_y = size
    names = list(dict.fromkeys(found["material"] for found in _OVERFLOW.finditer(log)))
    if names:
        looks = ", ".join(f"'{name}'" for name in names)
        raise RenderError(
            f"look {looks}: its nodes need more numbers at once than Cycles' node machine has room for; "
            'give it fewer layers, masks or textures, or render it with backend = "exact"'
        )
