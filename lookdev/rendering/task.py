"""What a worker renders: one scene, then frames of it. Plain data that names its files by their content."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import PlainValidator, TypeAdapter, ValidationInfo

from lookdev.cache import Content
from lookdev.codegen import ShaderSource, Source
from lookdev.light import AnyLight, Light
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.passes import CATCHER, arrays_of
from lookdev.scene import Camera, Pose, Sampling
from lookdev.space import REC709, Space


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def _read_sources(given: list[Any], info: ValidationInfo) -> tuple[Source, ...]:
    name = info.data.get("backend")
    if name not in BACKENDS:
        raise ValueError(f"no backend '{name}' is registered here")
    return tuple(_adapter(BACKENDS[name].source).validate_python(each) for each in given)


# JSON has no types: those of sources are found by the backend's record.
Sources = Annotated[tuple[Source, ...], PlainValidator(_read_sources)]


@dataclass(frozen=True)
class SceneTask:
    """All that stays the same over a sequence: geometry, sources, lights, resolution.

    `shaders` are the different sources, and `worn` is the number of each slot's among them. Of the sampling,
    `brdf_samples` and `ibl_samples` may be in the sources already. Raises ValueError where there is no source, one of
    another type than the backend's, or a number of none.
    """

    asset: Content
    backend: str
    shaders: Sources
    worn: tuple[int, ...]
    lights: tuple[AnyLight, ...]
    resolution: tuple[int, int]
    sampling: Sampling
    camera: Camera
    device: str = "cpu"
    lit: tuple[tuple[int, ...], ...] = ()  # the numbers of the lights of each source; (): of each all
    groups: tuple[int, ...] = ()  # the group of each slot, as `Emission.spared` has them; (): of each 0

    prims: tuple[str, ...] = ()  # the path of each instance, where a pass has them
    space: Space = REC709  # of the light
    # The group of each light, where a pass has them, and then those of lights that reach nothing.
    light_groups: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        record = BACKENDS[self.backend]
        # Both backends of nodes have one type of source, with a field for whether it is exact.
        if not self.shaders or not all(
            isinstance(source, record.source) and getattr(source, "exact", record.exact) == record.exact
            for source in self.shaders
        ):
            kinds = {type(each).__name__ + " that is exact" * getattr(each, "exact", False) for each in self.shaders}
            found = ", ".join(sorted(kinds)) or "none"
            raise ValueError(
                f"backend '{self.backend}' takes a {record.source.__name__} for every slot, found: {found}"
            )
        if not self.worn or min(self.worn) < 0 or max(self.worn) >= len(self.shaders):
            raise ValueError(f"every slot wears one of {len(self.shaders)} sources, found: {sorted(set(self.worn))}")

    def lights_of(self, shader: int) -> tuple[Light, ...]:
        """Return the lights that light what wears a source, by its number."""
        return tuple(self.lights[number] for number in self.lit[shader]) if self.lit else self.lights

    @property
    def catches(self) -> bool:
        """Whether it has a shadow catcher."""
        return any(isinstance(each, ShaderSource) and bool(each.catching) for each in self.shaders)

    @property
    def arrays(self) -> dict[str, tuple[str, ...]]:
        """What its frames have besides colour and alpha: the channels of each array by its name."""
        return {**arrays_of(self.sampling.passes, self.names_of_light), **(CATCHER if self.catches else {})}

    @property
    def names_of_light(self) -> tuple[str, ...]:
        """The names of the groups of lights, each once, where a pass has them."""
        return tuple(dict.fromkeys(self.light_groups))

    @property
    def constant_light(self) -> bool:
        """Whether all lights are the same from every direction at every place."""
        return all(light.constant for light in self.lights)

    @property
    def light_stays(self) -> bool:
        """Whether no light changes in the lighting rotation."""
        return all(light.constant or not light.emission.turns for light in self.lights)


@dataclass(frozen=True)
class FrameTask:
    """One frame. `files` are all its paths on disk; turntables may share a pose."""

    scene: SceneTask
    pose: Pose
    exposure: float
    digest: str
    files: tuple[Path, ...]
    labels: dict[str, str]


def one_frame(scene: SceneTask, pose: Pose, name: str, **sampling: Any) -> FrameTask:
    """Return a frame that is written to no file; `name` stands for its digest, `sampling` replaces the scene's."""
    return FrameTask(replace(scene, sampling=replace(scene.sampling, **sampling)), pose, 0.0, name, (), {})


def contents(task: object) -> set[Content]:
    """Return the files that a task names: all that another machine needs besides the task itself."""
    return set(_contents(task))


def _contents(value: object) -> Iterator[Content]:
    if isinstance(value, Content):
        yield value
    elif is_dataclass(value):
        for field in fields(value):
            yield from _contents(getattr(value, field.name))
    elif isinstance(value, tuple | Mapping):
        for each in value.values() if isinstance(value, Mapping) else value:
            yield from _contents(each)
