"""The task of a picture with derivatives, which a fit sends to a worker of backend `mitsuba`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lookdev.codegen.source import AttributeBinding
from lookdev.material.change import is_live, live_primvar
from lookdev.rendering.task import SceneTask
from lookdev.scene import Pose


@dataclass(frozen=True)
class DerivativeTask:
    """Two independent halves of a picture, and of its derivatives.

    `values` has the value of each live input of the scene's looks, by `AttributeBinding.parameter`; `symbols` names the
    numbers with respect to which the picture is differentiated. A pixel of a half takes `samples` samples, a power of
    two.
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
        """No file: the worker answers with arrays."""
        return ()


def live_inputs(scene: SceneTask) -> dict[str, AttributeBinding]:
    """Return the live inputs that the looks of a scene read, by their keys."""
    prefix_length = len(live_primvar(""))
    bindings = (binding for source in scene.shaders for binding in source.attributes if is_live(binding.attribute))
    return {binding.attribute[prefix_length:]: binding for binding in bindings}
