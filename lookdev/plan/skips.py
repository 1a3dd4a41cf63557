"""Skips: work that is left out of a render because no pixel depends on it, for a report with the causes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from lookdev.codegen.source import GeneratedSource, NodeSource, ProgramSource, ShaderSource
from lookdev.material import Bump, Look, Texture, leaf_sources
from lookdev.rendering.task import SceneTask
from lookdev.scene import Sampling


@dataclass(frozen=True)
class Skip:
    """Work (`what`) that is left out for a look under a light, and the reason (`why`) why no pixel changes."""

    look: str
    ibl: str
    what: str
    why: str

    def __str__(self) -> str:
        return f"{self.what} ({self.why})"


def is_rotation_invariant(shaders: Iterable[GeneratedSource]) -> bool:
    """Return whether a surface of revolution with these shaders looks the same after any turn about its axis.

    It does if the shaders read no image and no attribute. A shader that depends on a direction along the surface reads
    the tangents, which are an attribute, too.
    """
    return not any(shader.images or shader.attributes for shader in shaders)


def scene_skips(
    scene: SceneTask, looks: Sequence[Look], requested: Sampling, lights: int | None = None
) -> Iterator[tuple[str, str]]:
    """Yield the work that a scene leaves out, each with its cause.

    `looks` has the look of each slot, and `requested` is the sampling of the job. `lights` is the number of lights
    before lights that reach no part were dropped; None if none were dropped.
    """
    if lights is not None and (idle := lights - len(scene.lights)):
        yield ("1 light", "reaches no part") if idle == 1 else (f"{idle} lights", "reach no part")
    if scene.sampling.bounces < requested.bounces:
        yield "bounces", "convex asset"
    osl_shaders = [shader for shader in scene.shaders if isinstance(shader, ShaderSource)]
    if osl_shaders and not any(shader.shadows for shader in osl_shaders):
        yield "shadow rays", "convex asset"
    if not any(shader.transmits for shader in scene.shaders):
        yield "light from behind", "nothing transmits"
    if osl_shaders:
        brdf, light = (max(counts) for counts in zip(*(shader.directions for shader in osl_shaders), strict=True))
        if not light and scene.is_light_constant and requested.ibl_samples != 0:
            yield "light samples", "constant light"
        if not brdf:
            yield "BRDF samples", "every lobe is broad"
    if folded := sum(shader.folded for shader in scene.shaders if isinstance(shader, ShaderSource | ProgramSource)):
        yield ("1 lobe", "is 0 by constants") if folded == 1 else (f"{folded} lobes", "are 0 by constants")
    if unread := _count_unread_textures(looks, [scene.shaders[number] for number in scene.slot_shaders]):
        yield ("1 texture", "reaches no pixel") if unread == 1 else (f"{unread} textures", "reach no pixel")


def _count_unread_textures(looks: Sequence[Look], shaders: Sequence[GeneratedSource]) -> int:
    """Return the number of texture look-ups in looks that are not in their shaders.

    `looks` and `shaders` have the look and the shader of each slot. Slots with the same look have the same shader, and
    count once.
    """
    unread = 0
    for look, shader in {id(look): (look, shader) for look, shader in zip(looks, shaders, strict=True)}.values():
        sources = (source for layer in look.layers for source in (*layer.inputs.values(), layer.mask))
        lookups = {lookup for source in leaf_sources(sources) for lookup in _lookups(source)}
        if isinstance(shader, ShaderSource):
            # A look-up has a parameter for each tile of its texture; their names have a common prefix.
            unread += len(lookups) - len({binding.parameter.partition("_")[0] for binding in shader.textures})
        elif isinstance(shader, NodeSource):
            # The label of a node that reads an image is the name of its file, or of the set of tiles with the file.
            labels = {node.label for tree in shader.trees for node in tree.nodes if node.image is not None}
            files = (lookup.height.file if isinstance(lookup, Bump) else lookup.file for lookup in lookups)
            unread += sum(file.stem not in labels for file in files)
    return unread


def _lookups(source: object) -> Iterator[Texture | Bump]:
    """Yield the look-up of a layer's input, without fields that do not change which texels a shader reads.

    Inputs that share a look-up in the shader then give equal look-ups.
    """
    if isinstance(source, Texture):
        yield replace(source, channel="rgb", scale=(1.0,) * 4, bias=(0.0,) * 4)
    elif isinstance(source, Bump):
        yield Bump(replace(source.height, bias=(0.0,) * 4))
