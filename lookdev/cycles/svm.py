"""Check that the shaders of a scene fit Cycles' node machine (SVM), which only logs one that is too big."""

from __future__ import annotations

import re
from typing import Any

from lookdev.cycles import engine
from lookdev.cycles.streams import captured
from lookdev.errors import RenderError

_OVERFLOW = re.compile(r"out of SVM stack space, shader \"(?P<material>[^\"]*)\"", re.IGNORECASE)


def check_stack(scene: Any) -> None:
    """Compile the shaders of a scene.

    Raises
    ------
    RenderError
        A shader needs more stack than SVM has: parts of it would be missing.
    """
    _, log = captured(lambda: engine.compile_shaders(scene))
    names = list(dict.fromkeys(found["material"] for found in _OVERFLOW.finditer(log)))
    if names:
        looks = ", ".join(f"'{name}'" for name in names)
        raise RenderError(
            f"look {looks}: its nodes need more numbers at once than Cycles' node machine has room for; "
            'give it fewer layers, masks or textures, or render it with backend = "exact"'
        )
