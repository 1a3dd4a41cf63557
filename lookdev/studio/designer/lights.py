"""Settings of the lights of the visible rig in the Designer: on or off, brightness and colour.

They are settings of the view, like the exposure, and are not saved to a file. The viewport and the exact picture use
them, and so do turntables that are rendered from the page.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from lookdev.errors import LookdevError
from lookdev.light import Light
from lookdev.light.rig.emission import MAX_KELVIN, MIN_KELVIN, black_body
from lookdev.scene import Scene
from lookdev.space import Color
from lookdev.studio.viewport import light_rows

MAX_STOPS = 10.0
"""Largest change of a light's radiance, in stops."""


@dataclass(frozen=True)
class LightSetting:
    """The changes of one light: on or off, brightness in stops, and a colour, linear Rec.709.

    The light's radiance is multiplied by `color` and, unless `kelvin` is None, by the colour of a black body of
    `kelvin` kelvin.
    """

    on: bool = True
    stops: float = 0.0
    color: Color = (1.0, 1.0, 1.0)
    kelvin: float | None = None

    @property
    def factor(self) -> Color:
        """The factor of the radiance of the light, linear Rec.709."""
        scale = 2.0**self.stops if self.on else 0.0
        kelvin_color = (1.0, 1.0, 1.0) if self.kelvin is None else black_body(self.kelvin)
        r, g, b = (scale * tint * component for tint, component in zip(self.color, kelvin_color, strict=True))
        return r, g, b


class LightSettings:
    """The settings of lights, by the name of their rig and their number in it. Methods are thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._settings: dict[str, dict[int, LightSetting]] = {}

    def set(self, rig: str, scene: Scene, number: int, setting: LightSetting) -> None:
        """Set a light; raise LookdevError if the rig has no light of that number."""
        if not 0 <= number < len(scene.lights):
            raise LookdevError(f"rig '{rig}' has {len(scene.lights)} lights, none of number {number}")
        with self._lock:
            self._settings.setdefault(rig, {})[number] = setting

    def reset(self, rig: str) -> None:
        """Remove the settings of all lights of a rig."""
        with self._lock:
            self._settings.pop(rig, None)

    def apply(self, rig: str, scene: Scene) -> Scene:
        """Return a scene of a rig with the settings of its lights applied."""
        with self._lock:
            settings = dict(self._settings.get(rig, {}))
        changed = {number: setting for number, setting in settings.items() if setting != LightSetting()}
        if not changed:
            return scene
        lights = tuple(
            _apply_setting(light, changed[number]) if number in changed else light
            for number, light in enumerate(scene.lights)
        )
        return replace(scene, lights=lights)

    def describe(self, rig: str, scene: Scene) -> dict[str, Any]:
        """Return the ``lights`` of a rig for the page, with their settings, and the limits of settings.

        ``rows`` has the values in the viewport's texture ``rig_numbers`` that describe the lights, with the settings
        applied.
        """
        with self._lock:
            settings = dict(self._settings.get(rig, {}))
        return {
            "lights": [
                {
                    "name": light.emission.path.rsplit("/", 1)[-1] or f"{light.kind.replace('_', ' ')} {number + 1}",
                    "kind": light.kind.replace("_", " "),
                    "path": light.emission.path,
                    "color": list(light.emission.color),
                    **asdict(settings.get(number, LightSetting())),
                }
                for number, light in enumerate(scene.lights)
            ],
            "rows": light_rows(self.apply(rig, scene)).tolist(),
            "kelvin": [MIN_KELVIN, MAX_KELVIN],
            "stops": MAX_STOPS,
        }


def _apply_setting(light: Light, setting: LightSetting) -> Light:
    """Return a light whose radiance is multiplied by the factor of a setting."""
    r, g, b = (a * f for a, f in zip(light.emission.color, setting.factor, strict=True))
    return light.with_emission(replace(light.emission, color=(r, g, b)))


def parse_setting(body: Mapping[str, Any]) -> tuple[int, LightSetting]:
    """Return the light's number and the setting in a request of a page; raise LookdevError if it is not valid."""

    def number(value: Any, low: float, high: float, quantity: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise LookdevError(f"a light's {quantity} is a number from {low:g} to {high:g}")
        return float(value)

    light, on, color, kelvin = (body.get(name) for name in ("light", "on", "color", "kelvin"))
    if isinstance(light, bool) or not isinstance(light, int) or not isinstance(on, bool):
        raise LookdevError("a light has a number, and is on or not")
    if not isinstance(color, list) or len(color) != 3:
        raise LookdevError("a light's colour has three numbers")
    r, g, b = (number(component, 0.0, 100.0, "colour") for component in color)
    temperature = None if kelvin is None else number(kelvin, MIN_KELVIN, MAX_KELVIN, "temperature")
    return light, LightSetting(on, number(body.get("stops"), -MAX_STOPS, MAX_STOPS, "stops"), (r, g, b), temperature)
