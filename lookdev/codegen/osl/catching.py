"""Sections of the light integral's template for scenes with a shadow catcher.

A frame is three renders, which the number in ``caught`` selects: 1 shows the asset, 2 the ground with the asset, 3 the
ground without it. Surfaces that a render does not show are holdouts, but only for camera rays: later in a path, rays
meet all surfaces.
"""

from __future__ import annotations

from lookdev.codegen.source import Catching

ASSET, GROUND, BARE = 1, 2, 3
"""The numbers of the renders: of the asset, of the ground with it, and of the ground without it."""

_TRACE = "        if (trace(start, wi)) {"

# A ray that passes through surfaces is still a camera ray at the surfaces behind them.
_HOLDOUT = """
    int held_out = int(caught[0]) CONDITION;
    if (held_out && depth > 0) {
        float clip_of_camera = 0;
        getattribute("object:alpha", clip_of_camera);
        float passed = 0;
        getattribute("path:ray_length", passed);
        point begun = transform("camera", P + passed * I);
        held_out = abs(abs(begun[2]) - clip_of_camera) < 0.5 * clip_of_camera;
    }
    if (held_out) {
#if SEE_THROUGH
        surface = presence * holdout();
        if (!trace(P, -I) || depth < BOUNCES)
            surface += (1 - presence) * transparent();
#else
        surface = holdout();
#endif
        return;
    }"""


def catching_sections(catching: Catching) -> dict[str, list[str]]:
    """Return the lines of each section; without a catcher, the sections do not change the shader."""
    if not catching:
        return {"catching_parameter": [], "catching": [], "trace": [_TRACE]}
    condition = f"== {ASSET}" if catching == "ground" else f">= {GROUND}"
    is_ground = catching == "ground"
    return {
        "catching_parameter": ["    color caught = 0,"],
        "catching": _HOLDOUT.replace("CONDITION", condition).splitlines(),
        "trace": [f"        if (int(caught[0]) != {BARE} && trace(start, wi)) {{" if is_ground else _TRACE],
    }
