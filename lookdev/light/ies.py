"""IES profiles: how much light a luminaire sends in each direction."""

from __future__ import annotations

from dataclasses import dataclass

from lookdev.cache import Content


@dataclass(frozen=True)
class Profile:
    """An IES profile of `UsdLuxShapingAPI`, as a table.

    `table` is a ``.npy`` file of float32, (1 + H, 1 + V): the first row has the vertical angles in degrees from the
    light's axis, the first column the horizontal angles from 0 to 360, and the rest the luminous intensity in candela,
    bilinear between them and 0 beyond the vertical angles. `scale` multiplies the intensity: 1, or 1 over the profile's
    power if it is normalized. `angle_scale` is ``shaping:ies:angleScale``.
    """

    table: Content
    scale: float = 1.0
    angle_scale: float = 0.0
