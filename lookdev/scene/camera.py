"""Where camera, asset and light stand."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, order=True)
class Pose:
    """Where the asset and the light stand: degrees about the world's z axis, in [0, 360).

    The renderer turns camera, light and asset so that acceleration structures and importance maps stay valid. Generated
    OSL: the asset is fixed, the camera orbits by ``-element``, the light turns by ``lighting - element``. Cycles' own
    light: the light is fixed, the asset turns by ``element - lighting``, the camera orbits by ``-lighting``.
    """

    element: float
    lighting: float


@dataclass(frozen=True)
class Camera:
    """A perspective camera that orbits `target` at `distance`; `fov` is the horizontal angle of view.

    Angles in degrees, lengths in metres. At pose 0 the camera stands at azimuth -90 degrees (on -y, looking
    along +y), raised by `elevation`.
    """

    fov: float
    elevation: float
    target: tuple[float, float, float]
    distance: float
