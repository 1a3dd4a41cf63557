"""What scenes leave out because no pixel would show it, and why."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from lookdev.codegen import NodeSource, ProgramSource, ShaderSource, Source
from lookdev.material import Bump, Look, Texture
from lookdev.material.look import leaf_sources
from lookdev.rendering.task import SceneTask
from lookdev.scene import Sampling


@dataclass(frozen=True)
class Skip:
    """Work that is left out for a look under a light, and why no pixel differs."""

    look: str
    ibl: str
    what: str
    why: str

    def __str__(self) -> str:
        return f"{self.what} ({self.why})"


def same_all_around(shaders: Iterable[Source]) -> bool:
    """Return whether a surface of revolution shows the same picture however it is turned about its axis.

    It does where its sources read no image and no attribute: one that depends on a direction along the surface reads
    the tangents.
    """
    return not any(shader.images or shader.attributes for shader in shaders)


def scene_skips(
    scene: SceneTask, looks: Sequence[Look], requested: Sampling, lights: int | None = None
) -> Iterator[tuple[str, str]]:
    """Yield what a scene leaves out of the sampling `requested`, and why.

    `looks` are those of its slots, `lights` the number of lights that it was to have.
    """
    if lights is not None and (idle := lights - len(scene.lights)):
        yield ("1 light", "reaches no part") if idle == 1 else (f"{idle} lights", "reach no part")
    if scene.sampling.bounces < requested.bounces:
        yield "bounces", "convex asset"
    ours = [shader for shader in scene.shaders if isinstance(shader, ShaderSource)]
    if ours and not any(shader.shadows for shader in ours):
        yield "shadow rays", "convex asset"
    if not any(shader.transmits for shader in scene.shaders):
        yield "light from behind", "nothing transmits"
    if ours:
        brdf, light = (max(each) for each in zip(*(shader.directions for shader in ours), strict=True))
        if not light and scene.constant_light and requested.ibl_samples != 0:
            yield "light samples", "constant light"
        if not brdf:
            yield "BRDF samples", "every lobe is broad"
    if folded := sum(shader.folded for shader in scene.shaders if isinstance(shader, ShaderSource | ProgramSource)):
        yield ("1 lobe", "is 0 by constants") if folded == 1 else (f"{folded} lobes", "are 0 by constants")
    if unread := _unread_textures(looks, [scene.shaders[number] for number in scene.worn]):
        yield ("1 texture", "reaches no pixel") if unread == 1 else (f"{unread} textures", "reach no pixel")


def _unread_textures(looks: Sequence[Look], shaders: Sequence[Source]) -> int:
    """Count the look-ups of looks that are not in their shaders; slots that share a look share its shader."""
    unread = 0
    for look, shader in {id(look): (look, shader) for look, shader in zip(looks, shaders, strict=True)}.values():
        sources = (source for layer in look.layers for source in (*layer.inputs.values(), layer.mask))
        named = {lookup for source in leaf_sources(sources) for lookup in _lookups(source)}
        if isinstance(shader, ShaderSource):
            # The parameters of one look-up's tiles have a common prefix.
            unread += len(named) - len({binding.parameter.partition("_")[0] for binding in shader.textures})
        elif isinstance(shader, NodeSource):
            # A node that reads an image is labelled by its file; tiles, by that of their set.
            read = {node.label for tree in shader.trees for node in tree.nodes if node.image is not None}
            unread += sum(_file(lookup).stem not in read for lookup in named)
    return unread


def _file(lookup: Texture | Bump) -> Path:
    return lookup.height.file if isinstance(lookup, Bump) else lookup.file


def _lookups(source: object) -> Iterator[Texture | Bump]:
    """Yield the look-ups of a layer's input; those that a shader shares are equal."""
    if isinstance(source, Texture):
        yield replace(source, channel="rgb", scale=(1.0,) * 4, bias=(0.0,) * 4)
    elif isinstance(source, Bump):
        yield Bump(replace(source.height, bias=(0.0,) * 4))
