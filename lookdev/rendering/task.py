"""The tasks of a worker as plain data: a scene, and frames of it; files are named by their content."""

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
    return TypeAdapter(kind)


def _read_sources(values: list[object], info: ValidationInfo) -> tuple[GeneratedSource, ...]:
    name = info.data.get("backend")
    if name not in BACKENDS:
        raise ValueError(f"no backend '{name}' is registered here")
    return tuple(_adapter(BACKENDS[name].source).validate_python(value) for value in values)


# JSON has no types: the backend determines the type of the sources.
LookSources = Annotated[tuple[GeneratedSource, ...], PlainValidator(_read_sources)]


@dataclass(frozen=True)
class SceneTask:
    """The data that all frames of a sequence share: geometry, sources, lights, resolution.

    `shaders` has each source once; `slot_shaders` has the number of the source of each slot. The sources may have
    `brdf_samples` and `ibl_samples` of the sampling built in. Raises ValueError where there is no source, where one is
    not of the backend's type, and where a number of `slot_shaders` is not that of a source.
    """

    asset: Content
    backend: str
    shaders: LookSources
    slot_shaders: tuple[int, ...]
    lights: tuple[AnyLight, ...]
    resolution: tuple[int, int]
    sampling: Sampling
    camera: Camera
    device: str = "cpu"
    shader_lights: tuple[
        tuple[int, ...], ...
    ] = ()  # the numbers of the lights that reach each source; () if all lights reach all sources
    groups: tuple[int, ...] = ()  # the group of each slot, as in `Emission.shadow_excluded`; () if all are 0
    prims: tuple[str, ...] = ()  # the path of each instance, if a pass needs them
    space: Space = REC709  # the colour space of the light
    # The group of each of `lights`, then the groups of the lights that reach nothing; () if no pass needs them.
    light_groups: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        record = BACKENDS[self.backend]
        # Both backends of nodes have the same type of source, whose field `exact` tells them apart.
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
        """Return the lights that reach the slots of a source, by the number of the source."""
        return (
            tuple(self.lights[number] for number in self.shader_lights[shader]) if self.shader_lights else self.lights
        )

    @property
    def has_catcher(self) -> bool:
        """Whether the scene has a shadow catcher."""
        return any(isinstance(source, ShaderSource) and bool(source.catching) for source in self.shaders)

    @property
    def channels_by_array(self) -> dict[str, tuple[str, ...]]:
        """The channels of each array that a frame has besides colour and alpha, by the array's name."""
        arrays = channels_of_passes(self.sampling.passes, self.light_group_names)
        return {**arrays, **CATCHER_ARRAYS} if self.has_catcher else arrays

    @cached_property
    def part_sets(self) -> list[list[str]]:
        """The sets of arrays with parts of the light, each of which sums up to the beauty."""
        sources = (source for source in self.shaders if isinstance(source, ShaderSource | ProgramSource))
        lobes = {lobe for source in sources for lobe in source.recorded}
        sets = {
            "lobes": [group for group in LOBE_GROUPS if group in lobes],
            "direct": [*PASSES["direct"].arrays],
            LIGHTS_PASS: [light_layer(name) for name in dict.fromkeys(self.light_groups[: len(self.lights)])],
        }
        return [parts for name, parts in sets.items() if name in self.sampling.passes and parts]

    def complete_parts(self, parts: Mapping[str, NDArray[_Real]], beauty: NDArray[_Real]) -> dict[str, NDArray[_Real]]:
        """Return `parts` completed by the last array of each set, and by black for parts without light.

        `parts` has all other arrays of each set; the last is the beauty minus these. Parts without light are those of
        lobes that no look has, and of lights that reach nothing.
        """
        complete: dict[str, NDArray[_Real]] = dict(parts)
        for *others, last in self.part_sets:
            complete[last] = beauty - sum(complete[name] for name in others)
        for name in light_parts(self.sampling.passes, self.light_group_names) - {*complete}:
            complete[name] = np.zeros_like(beauty)
        return complete

    @property
    def light_group_names(self) -> tuple[str, ...]:
        """The names of the groups of lights, each once; () if no pass needs them."""
        return tuple(dict.fromkeys(self.light_groups))

    @property
    def is_light_constant(self) -> bool:
        """Whether the radiance of every light is the same in all directions and at all positions."""
        return all(light.constant for light in self.lights)

    @property
    def is_light_fixed(self) -> bool:
        """Whether the lighting rotation changes no light."""
        return all(light.constant or not light.emission.turns for light in self.lights)


@dataclass(frozen=True)
class FrameTask:
    """One frame. `files` are all its paths on disk: turntables with the same pose share a frame."""

    scene: SceneTask
    pose: Pose
    exposure: float
    digest: str
    files: tuple[Path, ...]
    labels: dict[str, str]


class SamplingFields(TypedDict, total=False):
    """Fields of `Sampling` that differ between frames of a scene."""

    samples: int
    error: float | None
    seed: int
    denoise: Literal["off", "measured"]


def frame_task(scene: SceneTask, pose: Pose, name: str, **sampling: Unpack[SamplingFields]) -> FrameTask:
    """Return a frame without files; `name` is its digest, `sampling` replaces fields of the scene's sampling."""
    return FrameTask(replace(scene, sampling=replace(scene.sampling, **sampling)), pose, 0.0, name, (), {})


def files_of_task(task: object) -> set[Content]:
    """Return the files of a task: all that another machine needs besides the task itself."""
    return set(_contents(task))


def _contents(value: object) -> Iterator[Content]:
    if isinstance(value, Content):
        yield value
    elif is_dataclass(value):
        for field in fields(value):
            yield from _contents(getattr(value, field.name))
    elif isinstance(value, tuple | Mapping):
        for element in value.values() if isinstance(value, Mapping) else value:
            yield from _contents(element)
