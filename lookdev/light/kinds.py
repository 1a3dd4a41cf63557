"""The kinds of light, in the order in which messages list them."""

from __future__ import annotations

from lookdev.light.base import Light, LightKind
from lookdev.light.cylinder import CYLINDER
from lookdev.light.disk import DISK
from lookdev.light.distant import DISTANT
from lookdev.light.dome.usd import DOME, LOCAL_DOME
from lookdev.light.rect import RECT
from lookdev.light.sphere import SPHERE

LIGHT_KINDS: dict[str, LightKind] = {
    record.type.kind: record for record in (RECT, DISK, SPHERE, CYLINDER, DISTANT, DOME, LOCAL_DOME)
}


def light_label(light: Light, number: int) -> str:
    """Return the name of a light for messages: the path of its prim, or `number` if it has no prim, and its kind."""
    return f"light {light.emission.path or number} ({light.kind})"
