"""Lines of the surface shader (`surface.osl`) for a scene with a shadow catcher: a ground that shows only shadows.

A frame needs three renders: of the asset, of the ground with the asset, and of the ground without it. The shader's
parameter ``caught`` has the number of the render. To camera rays, the surfaces that a render does not show are
holdouts. Later in a path, rays meet all surfaces.
"""

from __future__ import annotations

from lookdev.codegen.source import Catching

ASSET, GROUND, BARE = 1, 2, 3
"""The numbers of the renders: of the asset, of the ground with it, and of the ground without it."""

# The line of the template that traces a ray from the surface, and begins the block that runs if the ray hits.
_TRACE = "        if (trace(start, wi)) {"

# The lines of a holdout. CONDITION completes the test whether the render omits the surface. A camera ray that has
# passed see-through surfaces has a depth above 0, as later rays have. It is recognized by the start of its path, which
# is on the camera's near clipping plane: `cycles.scene` passes the distance of this plane as the object's alpha.
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
    """Return the lines of the template's sections for a shadow catcher, by the sections' names.

    `catching` says whether the ground or the asset has the look. Without a catcher, the sections do not change the
    shader.
    """
    if not catching:
        return {"catching_parameter": [], "catching": [], "trace": [_TRACE]}
    condition = f"== {ASSET}" if catching == "ground" else f">= {GROUND}"
    is_ground = catching == "ground"
    return {
        "catching_parameter": ["    color caught = 0,"],
        "catching": _HOLDOUT.replace("CONDITION", condition).splitlines(),
        "trace": [f"        if (int(caught[0]) != {BARE} && trace(start, wi)) {{" if is_ground else _TRACE],
    }
