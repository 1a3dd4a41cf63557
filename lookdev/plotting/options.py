"""The options of plots, as `lookdev plot` takes them, and their valid values."""

from __future__ import annotations

from dataclasses import dataclass

from lookdev.errors import LookdevError, nearest_hint

SCALES = ("linear", "sqrt", "log")
AXES = ("theta_h", "theta_d", "theta_i")
CHANNELS = ("luminance", "rgb")


@dataclass(frozen=True)
class PlotOptions:
    """Options of a plot; each kind uses some of them (`lookdev.plotting.kinds.PlotKind.option_names`).

    theta
        The angle of the view to the normal, in degrees. In a cartesian plot over theta_h or theta_d, it is the other of
        these two angles, which is fixed. For spheres, it is the angle between the view and the light.
    phi
        The azimuth of the view, in degrees. In plots of f over theta_h or theta_d, it is phi_d, the azimuth of the
        difference vector. For spheres, it is the azimuth of the light.
    exposure
        Stops by which pictures are brightened.
    scale, angles
        The scale of the axis of values, one of `SCALES`, and of the axis of angles, ``"linear"`` or ``"sqrt"``.
    axis
        The angle that varies in a cartesian plot, one of `AXES`.
    limit
        The largest angle that is plotted, in degrees.
    channels
        ``"luminance"`` for one curve of each surface, or ``"rgb"`` for three.
    cosine
        Whether f, the BSDF, is multiplied by the cosine of the light's angle.
    chroma
        Whether pictures are divided by their largest channel (Burley 2012, figure 14).
    size
        Samples along an axis, or pixels along a side of a picture; 0 is the default of the kind.
    """

    theta: float = 45.0
    phi: float = 90.0
    exposure: float = 0.0
    scale: str = "linear"
    angles: str = "linear"
    axis: str = "theta_h"
    limit: float = 90.0
    channels: str = "luminance"
    cosine: bool = False
    chroma: bool = False
    size: int = 0

    def __post_init__(self) -> None:
        for name, choices in (("scale", SCALES), ("angles", SCALES[:2]), ("axis", AXES), ("channels", CHANNELS)):
            value = getattr(self, name)
            if value not in choices:
                raise LookdevError(f"--{name} {value}: {nearest_hint(str(value), choices)}")
        ranges = (("theta", 0.0, 89.9), ("phi", -360, 360.0), ("exposure", -32.0, 32.0), ("limit", 0.01, 90.0))
        for name, low, high in (*ranges, ("size", 0, 2048)):
            value = getattr(self, name)
            if not low <= value <= high:
                raise LookdevError(f"--{name} {value:g}: {low:g} to {high:g} would be right")
        if 0 < self.size < 4:
            raise LookdevError(f"--size {self.size}: 4 to 2048 would be right")

    def changed_options(self) -> dict[str, str | float]:
        """Return the options that are not at their defaults, by name."""
        return {name: value for name, value in vars(self).items() if value != getattr(PlotOptions, name)}
