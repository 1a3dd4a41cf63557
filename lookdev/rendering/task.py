"""The tasks of a worker as plain data that fits into JSON: a scene, and frames of the scene.

A task names a file by its content (`Content`), so that it can be sent to other machines. A slot is a part of the asset
to which one look is assigned. A source is the code or the nodes of a look, as generated for a backend.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated, Literal, TypedDict, TypeVar, Unpack

import numpy as np
from numpy.typing import NDArray
from pydantic import PlainValidator, TypeAdapter, ValidationInfo

from lookdev.cache import Content
from lookdev.codegen.source import LOBE_GROUPS, GeneratedSource, ProgramSource, ShaderSource
from lookdev.light import AnyLight, Light
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.passes import CATCHER_ARRAYS, LIGHTS_PASS, PASSES, channels_of_passes, light_layer, light_parts
from lookdev.scene import Camera, Pose, Sampling
from lookdev.space import REC709, Space

_Real = TypeVar("_Real", np.float32, np.float64)


@cache
def _adapter(kind: type[GeneratedSource]) -> TypeAdapter[GeneratedSource]:
    """Return pydantic's reader of a type of source."""
    return TypeAdapter(kind)


def _read_sources(values: list[object], info: ValidationInfo) -> tuple[GeneratedSource, ...]:
    """Return sources from their JSON values; pydantic has read the field `backend` before."""
    name = info.data.get("backend")
    if name not in BACKENDS:
        raise ValueError(f"no backend '{name}' is registered here")
    return tuple(_adapter(BACKENDS[name].source).validate_python(value) for value in values)


# In JSON, the type of a source is not stated. It follows from the name of the backend.
LookSources = Annotated[tuple[GeneratedSource, ...], PlainValidator(_read_sources)]


@dataclass(frozen=True)
class SceneTask:
    """The data that all frames of a sequence share: geometry, sources, lights, resolution.

    The number of a slot, a source or a light is its index. Raises ValueError where there is no source, where a source
    is not of the backend's type, and where a number in `slot_shaders` is not the number of a source.
    """

    asset: Content
    backend: str  # a name in `BACKENDS`
    shaders: LookSources  # each source once; may have `brdf_samples` and `ibl_samples` of the sampling built in
    slot_shaders: tuple[int, ...]  # the number of the source of each slot
    lights: tuple[AnyLight, ...]
    resolution: tuple[int, int]  # width and height in pixels
    sampling: Sampling
    camera: Camera
    device: str = "cpu"
    shader_lights: tuple[
        tuple[int, ...], ...
    ] = ()  # the numbers of the lights that reach each source; () if all lights reach all sources
    # The shadow group of each slot: the shadow of a light leaves out the groups in its `Emission.shadow_excluded`.
    groups: tuple[int, ...] = ()  # () if all are 0
    prims: tuple[str, ...] = ()  # the USD path of each instance of a mesh; () if no pass needs them
    space: Space = REC709  # the colour space of the light
    # The name of the group of each of `lights`, then further groups of lights that reach nothing; () if no pass needs
    # the names.
    light_groups: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        record = BACKENDS[self.backend]
        # Backends `nodes` and `nodes-exact` have the same type of source, whose field `exact` distinguishes them.
        if not self.shaders or not all(
            isinstance(source, record.source) and getattr(source, "exact", record.exact) == record.exact
            for source in self.shaders
        ):
            types = {
                type(source).__name__ + " that is exact" * getattr(source, "exact", False) for source in self.shaders
            }
            names = ", ".join(sorted(types)) or "none"
            raise ValueError(
                f"backend '{self.backend}' takes a {record.source.__name__} for every slot, found: {names}"
            )
        if not self.slot_shaders or min(self.slot_shaders) < 0 or max(self.slot_shaders) >= len(self.shaders):
            raise ValueError(
                f"sources of slots are numbers from 0 to {len(self.shaders) - 1}, "
                f"found: {sorted(set(self.slot_shaders))}"
            )

    def lights_of_shader(self, shader: int) -> tuple[Light, ...]:
        """Return the lights that reach the slots of a source; `shader` is the number of the source."""
        return (
            tuple(self.lights[number] for number in self.shader_lights[shader]) if self.shader_lights else self.lights
        )

    @property
    def has_catcher(self) -> bool:
        """Whether the scene has a shadow catcher."""
        return any(isinstance(source, ShaderSource) and bool(source.catching) for source in self.shaders)

    @property
    def channels_by_array(self) -> dict[str, tuple[str, ...]]:
        """The channels of each array that a frame has besides colour and alpha, by the name of the array."""
        arrays = channels_of_passes(self.sampling.passes, self.light_group_names)
        return {**arrays, **CATCHER_ARRAYS} if self.has_catcher else arrays

    @cached_property
    def part_sets(self) -> list[list[str]]:
        """The names of arrays with parts of the light, in sets. The arrays of a set sum up to the beauty."""
        sources = (source for source in self.shaders if isinstance(source, ShaderSource | ProgramSource))
        lobes = {lobe for source in sources for lobe in source.recorded}
        sets = {
            "lobes": [group for group in LOBE_GROUPS if group in lobes],
            "direct": [*PASSES["direct"].arrays],
            LIGHTS_PASS: [light_layer(name) for name in dict.fromkeys(self.light_groups[: len(self.lights)])],
        }
        return [parts for name, parts in sets.items() if name in self.sampling.passes and parts]

    def complete_parts(self, parts: Mapping[str, NDArray[_Real]], beauty: NDArray[_Real]) -> dict[str, NDArray[_Real]]:
        """Return all arrays with parts of the light, (H, W, 3) by name; `beauty` is (H, W, 3).

        `parts` has the arrays of each set of `part_sets`, except the last array of the set: it is the beauty minus the
        other arrays of the set. Parts of lobes that no look has, and of lights that reach nothing, are black.
        """
        complete: dict[str, NDArray[_Real]] = dict(parts)
        for *others, last in self.part_sets:
            complete[last] = beauty - sum(complete[name] for name in others)
        for name in light_parts(self.sampling.passes, self.light_group_names) - {*complete}:
            complete[name] = np.zeros_like(beauty)
        return complete

    @property
    def light_group_names(self) -> tuple[str, ...]:
        """The name of each group of lights, once; () if no pass needs them."""
        return tuple(dict.fromkeys(self.light_groups))

    @property
    def is_light_constant(self) -> bool:
        """Whether the radiance of every light is the same in all directions and at all positions."""
        return all(light.constant for light in self.lights)

    @property
    def is_light_fixed(self) -> bool:
        """Whether the lighting rotation of a pose changes no light."""
        return all(light.constant or not light.emission.turns for light in self.lights)


@dataclass(frozen=True)
class FrameTask:
    """One frame of a scene."""

    scene: SceneTask
    pose: Pose
    exposure: float  # stops
    digest: str  # identifies everything that the picture depends on
    files: tuple[Path, ...]  # all files of the frame on disk: turntables with the same pose share a frame
    labels: dict[str, str]  # entries of the frame's header, such as the name of the look


class SamplingFields(TypedDict, total=False):
    """Fields of `Sampling` that differ between frames of a scene."""

    samples: int
    error: float | None
    seed: int
    denoise: Literal["off", "measured"]


def frame_task(scene: SceneTask, pose: Pose, name: str, **sampling: Unpack[SamplingFields]) -> FrameTask:
    """Return the task of a frame that is not written to files, without exposure.

    `name` takes the place of the digest. `sampling` replaces fields of the scene's sampling.
    """
    return FrameTask(replace(scene, sampling=replace(scene.sampling, **sampling)), pose, 0.0, name, (), {})


def files_of_task(task: object) -> set[Content]:
    """Return all files that a task names. To render the task, another machine needs these files besides the task."""
    return set(_contents(task))


def _contents(value: object) -> Iterator[Content]:
    """Yield the files in a tree of dataclasses, tuples and mappings."""
    if isinstance(value, Content):
        yield value
    elif is_dataclass(value):
        for field in fields(value):
            yield from _contents(getattr(value, field.name))
    elif isinstance(value, tuple | Mapping):
        for element in value.values() if isinstance(value, Mapping) else value:
            yield from _contents(element)
