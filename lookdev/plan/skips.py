"""What the scenes of a job leave out because no pixel would show it, and why."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lookdev.brdf import MODELS
from lookdev.codegen import NodeSource, PrincipledSource, ShaderSource, Source
from lookdev.job import Job, JobIbl, JobRender
from lookdev.material import Bump, Formula, Layer, Look, Texture
from lookdev.plan.poses import turntable_poses, unturned
from lookdev.render.task import SceneTask


@dataclass(frozen=True)
class Skip:
    """Something that is not rendered, read or computed for a look under a light, and why nobody misses it."""

    look: str
    ibl: str
    what: str
    why: str

    def __str__(self) -> str:
        return f"{self.what} ({self.why})"


def same_all_around(looks: Iterable[Look], shaders: Iterable[Source]) -> bool:
    """Tell whether a surface of revolution shows the same picture however it is turned about its axis.

    It does where its shaders read nothing that differs over it, and no layer of its looks knows one direction along
    the surface from another. Nothing is said of a layer that turned out not to matter: its directions count.
    """
    uniform = not any(_reads_what_differs(shader) for shader in shaders)
    return uniform and not any(_is_directed(layer) for look in looks for layer in look.layers)


def find_skips(
    job: Job,
    scenes: Mapping[tuple[str, str], SceneTask],
    looks: Mapping[str, Sequence[Look]],
    around: Collection[tuple[str, str]] = (),
) -> Iterator[Skip]:
    """Tell what a job's scenes leave out.

    Parameters
    ----------
    job : Job
        The job.
    scenes, around
        As `lookdev.plan.build_plan` takes them.
    looks : mapping
        Name of a look to what each slot of the asset wears, in the order of a scene's shaders.

    Yields
    ------
    Skip
        Look by look, and within a look light by light. What the job itself turned off is not among them.
    """
    for look in job.look:
        for ibl in job.ibl:
            key = look.name, ibl.name
            for what, why in (
                *scene_skips(scenes[key], looks[look.name], job.render),
                *_frame_skips(job, ibl, key in around, scenes[key].light.constant),
            ):
                yield Skip(*key, what, why)


def scene_skips(scene: SceneTask, looks: Sequence[Look], render: JobRender) -> Iterator[tuple[str, str]]:
    """Tell what a scene leaves out, and why; `looks` has what each slot wears, `render` what was asked for."""
    if scene.sampling.bounces < render.bounces:
        yield "bounces", "convex asset"
    ours = [shader for shader in scene.shaders if isinstance(shader, ShaderSource)]
    if ours and not any(shader.shadows for shader in ours):
        yield "shadow rays", "convex asset"
    if not any(_transmits(shader) for shader in scene.shaders):
        yield "light from behind", "nothing transmits"
    if ours:
        brdf, light = (max(each) for each in zip(*(shader.directions for shader in ours), strict=True))
        if not light and scene.light.constant and render.ibl_samples != 0:
            yield "light samples", "constant light"
        if not brdf:
            yield "BRDF samples", "every lobe is broad"
    unread = _unread_textures(looks, scene.shaders)
    if unread:
        yield ("1 texture", "reaches no pixel") if unread == 1 else (f"{unread} textures", "reach no pixel")


def _frame_skips(job: Job, ibl: JobIbl, around: bool, constant: bool) -> Iterator[tuple[str, str]]:
    poses = {pose for each in job.turntable for pose in turntable_poses(each, ibl.rotation, job.camera.azimuth)}
    left = {unturned(pose, around, constant) for pose in poses}
    if len(left) < len(poses):
        causes = ["same all around"] * around + ["constant light"] * constant
        yield f"{len(poses) - len(left)} of {len(poses)} frames", ", ".join(causes)


def _reads_what_differs(source: Source) -> bool:
    match source:
        case ShaderSource():
            return bool(source.textures or source.attributes)
        case NodeSource():
            images = any(node.image for tree in source.trees for node in tree.nodes)
            return images or bool(source.attributes)
        case PrincipledSource():
            return False


def _transmits(source: Source) -> bool:
    return not isinstance(source, PrincipledSource) and source.transmits


def _unread_textures(looks: Sequence[Look], shaders: Sequence[Source]) -> int:
    """Count the look-ups of looks that their shaders do without; slots that share a look share its shader."""
    unread = 0
    for look, shader in {id(look): (look, shader) for look, shader in zip(looks, shaders, strict=True)}.values():
        sources = (source for layer in look.layers for source in (*layer.inputs.values(), layer.mask))
        named = {lookup for source in sources for lookup in _lookups(source)}
        if isinstance(shader, ShaderSource):
            # Tiles of one look-up share the first part of their parameters' names.
            unread += len(named) - len({binding.parameter.partition("_")[0] for binding in shader.textures})
        elif isinstance(shader, NodeSource):
            # A node that reads an image is labelled by its file; of a set, all tiles by the set's.
            read = {node.label for tree in shader.trees for node in tree.nodes if node.image is not None}
            unread += sum(_file(lookup).stem not in read for lookup in named)
    return unread


def _file(lookup: Texture | Bump) -> Path:
    return lookup.height.file if isinstance(lookup, Bump) else lookup.file


def _lookups(source: object) -> Iterator[Texture | Bump]:
    """Yield the look-ups of a layer's input; those that a shader makes only once are equal."""
    if isinstance(source, Texture):
        yield replace(source, channel="rgb", scale=(1.0,) * 4, bias=(0.0,) * 4)
    elif isinstance(source, Bump):
        yield Bump(replace(source.height, bias=(0.0,) * 4))
    elif isinstance(source, Formula):
        for each in source.inputs.values():
            yield from _lookups(each)


def _is_directed(layer: Layer) -> bool:
    return any(_has_direction(layer.model, name, value) for name, value in layer.inputs.items())


def _has_direction(model: str, name: str, value: Any) -> bool:
    parameter = MODELS[model].parameters[name]
    if parameter.kind == "normal":
        return not isinstance(value, tuple) or any(value[:2])
    return parameter.directed and value != 0.0
