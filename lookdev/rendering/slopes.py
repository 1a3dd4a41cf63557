"""Pictures with derivatives: what a fit asks a worker of backend `mitsuba` for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lookdev.codegen import AttributeBinding
from lookdev.material.change import is_live, live_primvar
from lookdev.rendering.task import SceneTask
from lookdev.scene import Pose


@dataclass(frozen=True)
class SlopeTask:
    """Two independent halves of a picture, and of its derivatives.

    `values` are of the live inputs of the scene's looks, by the parameters of their attributes; `symbols` are those of
    their numbers by which the picture is derived. `samples`, a power of two, are of a half's pixel.
    """

    scene: SceneTask
    pose: Pose
    values: Mapping[str, tuple[float, ...]]
    symbols: tuple[str, ...]
    samples: int
    seeds: tuple[int, int]
    digest: str

    @property
    def files(self) -> tuple[Path, ...]:
        """It is written to none."""
        return ()


def live_inputs(scene: SceneTask) -> dict[str, AttributeBinding]:
    """Return the live inputs that the looks of a scene read, by their keys."""
    prefix = len(live_primvar(""))
    found = (each for source in scene.shaders for each in source.attributes if is_live(each.attribute))
    return {each.attribute[prefix:]: each for each in found}
