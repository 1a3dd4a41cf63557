"""The lights of the shown rig, as the page has turned them up, coloured them or switched them off.

These are settings of the view, as the exposure is: no file has them. The viewport and the exact picture follow them.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from lookdev.errors import LookdevError
from lookdev.light import Light
from lookdev.light.rig.emission import COLDEST, HOTTEST, black_body
from lookdev.scene import Scene
from lookdev.studio.viewport import light_rows

MOST_STOPS = 10.0
"""By which a light is turned up or down."""

Color = tuple[float, float, float]


@dataclass(frozen=True)
class Setting:
    """What the page changes of a light: its radiance by stops and by a colour, or by that of a black body in kelvin."""

    on: bool = True
    stops: float = 0.0
    color: Color = (1.0, 1.0, 1.0)
    kelvin: float | None = None

    @property
    def factor(self) -> Color:
        """What the light's radiance is multiplied by, linear Rec.709."""
        scale = 2.0**self.stops if self.on else 0.0
        body = (1.0, 1.0, 1.0) if self.kelvin is None else black_body(self.kelvin)
        r, g, b = (scale * tint * part for tint, part in zip(self.color, body, strict=True))
        return r, g, b


class Lights:
    """The settings of each rig's lights, by their numbers. All methods can be called by several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._settings: dict[str, dict[int, Setting]] = {}

    def set(self, rig: str, scene: Scene, number: int, setting: Setting) -> None:
        """Change a light; raises LookdevError where the rig has none of that number."""
        if not 0 <= number < len(scene.lights):
            raise LookdevError(f"rig '{rig}' has {len(scene.lights)} lights, none of number {number}")
        with self._lock:
            self._settings.setdefault(rig, {})[number] = setting

    def reset(self, rig: str) -> None:
        """Have all lights of a rig as its file has them."""
        with self._lock:
            self._settings.pop(rig, None)

    def applied(self, rig: str, scene: Scene) -> Scene:
        """Return a scene of a rig with its lights as they are set."""
        with self._lock:
            settings = dict(self._settings.get(rig, {}))
        changed = {number: each for number, each in settings.items() if each != Setting()}
        if not changed:
            return scene
        lights = tuple(
            _lit(light, changed[number]) if number in changed else light for number, light in enumerate(scene.lights)
        )
        return replace(scene, lights=lights)

    def described(self, rig: str, scene: Scene) -> dict[str, Any]:
        """Return the list of a rig's lights for the page, and the numbers by which the viewport shows them."""
        with self._lock:
            settings = dict(self._settings.get(rig, {}))
        return {
            "lights": [
                {
                    "name": light.emission.path.rsplit("/", 1)[-1] or f"{light.kind.replace('_', ' ')} {number + 1}",
                    "kind": light.kind.replace("_", " "),
                    "path": light.emission.path,
                    "color": list(light.emission.color),
                    **asdict(settings.get(number, Setting())),
                }
                for number, light in enumerate(scene.lights)
            ],
            "rows": light_rows(self.applied(rig, scene)).tolist(),
            "kelvin": [COLDEST, HOTTEST],
            "stops": MOST_STOPS,
        }


def _lit(light: Light, setting: Setting) -> Light:
    r, g, b = (a * f for a, f in zip(light.emission.color, setting.factor, strict=True))
    return light.with_emission(replace(light.emission, color=(r, g, b)))


def setting_of(body: Mapping[str, Any]) -> tuple[int, Setting]:
    """Return the number of a light and its setting of a page's request; raises LookdevError where it is none."""

    def number(value: Any, low: float, high: float, what: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise LookdevError(f"a light's {what} is a number from {low:g} to {high:g}")
        return float(value)

    light, on, color, kelvin = (body.get(name) for name in ("light", "on", "color", "kelvin"))
    if isinstance(light, bool) or not isinstance(light, int) or not isinstance(on, bool):
        raise LookdevError("a light has a number, and is on or not")
    if not isinstance(color, list) or len(color) != 3:
        raise LookdevError("a light's colour has three numbers")
    r, g, b = (number(each, 0.0, 100.0, "colour") for each in color)
    body_of = None if kelvin is None else number(kelvin, COLDEST, HOTTEST, "temperature")
    return light, Setting(on, number(body.get("stops"), -MOST_STOPS, MOST_STOPS, "stops"), (r, g, b), body_of)
