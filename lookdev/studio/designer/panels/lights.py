"""Requests of the panel of lights, which changes the lights of the visible rig."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lookdev.studio.designer.lights import parse_setting
from lookdev.studio.designer.routes import Query, Routes, json_route


class LightRoutes(Routes):
    """Requests that get, set or reset the settings of the visible rig's lights."""

    @json_route("/lights", "GET", "POST")
    def set_light(self, query: Query) -> Mapping[str, Any]:
        """Set a light after a POST, or reset all lights if ``reset`` is true; return all lights with their settings."""
        scene, rig, lights = self.document.scene, self.document.scene_key[1], self.session.lights
        if query.body.get("reset") is True:
            lights.reset(rig)
        elif query.posted:
            lights.set(rig, scene, *parse_setting(query.body))
        return lights.describe(rig, scene)
