"""Sections of the light integral's template for scenes with a shadow catcher.

A frame is three renders, by the number in ``caught``, in each of which what is left out holds a hole in the picture:
1 is the asset, 2 the ground with the asset, 3 the ground without it. They concern what the camera sees; what paths find
later is always all.
"""

from __future__ import annotations

from lookdev.codegen.source import Catching

ASSET, GROUND, BARE = 1, 2, 3
"""What the renders of a frame show."""

_TRACE = "        if (trace(start, wi)) {"

# A ray of the camera also reaches what is behind surfaces that it passed through.
_HOLE = """
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
    """Return the lines of each section; those of a scene without a catcher leave the text as it is."""
    if not catching:
        return {"catching_parameter": [], "catching": [], "trace": [_TRACE]}
    condition = f"== {ASSET}" if catching == "ground" else f">= {GROUND}"
    alone = catching == "ground"
    return {
        "catching_parameter": ["    color caught = 0,"],
        "catching": _HOLE.replace("CONDITION", condition).splitlines(),
        "trace": [f"        if (int(caught[0]) != {BARE} && trace(start, wi)) {{" if alone else _TRACE],
    }
