"""A dome light of finite size, for a part of a scene: not physical, nor part of UsdLux."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lookdev.light.dome import Dome
from lookdev.light.placement import Vector


@dataclass(frozen=True, kw_only=True)
class LocalDome:
    """A dome light whose image is on a sphere about `position` of a `radius`, in metres, which it lights from inside.

    Places see it from where they are. Its light fades over the outer part `edge` (0: none, 1: all) of the radius, and
    none arrives outside. `dome.axes` and `dome.emission` are its own.
    """

    kind: ClassVar[str] = "local_dome"
    constant: ClassVar[bool] = False

    dome: Dome
    position: Vector
    radius: float
    edge: float = 0.0
