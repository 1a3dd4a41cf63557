"""The task of a picture with its derivatives with respect to parameters of looks.

A fit (`lookdev.fitting`) sends this task to a worker of backend `mitsuba`.
"""

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
    """The request for two independent halves of a picture, and for the derivatives of both.

    A live input is an input of a look whose value is not compiled into the look's source, so that it can change between
    pictures.
    """

    scene: SceneTask
    pose: Pose
    values: Mapping[str, tuple[float, ...]]  # the value of each live input, by `AttributeBinding.parameter`
    symbols: tuple[str, ...]  # the picture is differentiated with respect to these, as in `AttributeBinding.symbols`
    samples: int  # per pixel of a half, a power of two
    seeds: tuple[int, int]  # the seed of each half
    digest: str  # identifies the task in the worker's answers

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that the worker writes: there are none, since it answers with arrays."""
        return ()


def live_inputs(scene: SceneTask) -> dict[str, AttributeBinding]:
    """Return the live inputs that the looks of a scene read, by their keys in `lookdev.material.change`."""
    prefix_length = len(live_primvar(""))
    bindings = (binding for source in scene.shaders for binding in source.attributes if is_live(binding.attribute))
    return {binding.attribute[prefix_length:]: binding for binding in bindings}
