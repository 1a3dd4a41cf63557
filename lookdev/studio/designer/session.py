"""The state that the panels of a page share: the document, the settings of lights, and the library of presets."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lookdev.material.library import Library, library_folders, read_library
from lookdev.scene import Scene
from lookdev.studio.designer.document import Document
from lookdev.studio.designer.lights import LightSettings


class Session:
    """The document of a page, and the state of the page that is not saved. Methods are thread-safe."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.lights = LightSettings()
        self._library: Library | None = None

    def scene_with_lights(self) -> Scene:
        """Return the visible scene, with the page's settings of its lights."""
        return self.lights.apply(self.document.scene_key[1], self.document.scene)

    def library(self) -> Library:
        """Return the library of presets, which is read at the first use."""
        library = self._library = self._library or read_library(library_folders())
        return library

    def forget_library(self) -> None:
        """Drop the library, so that the next use reads it anew."""
        self._library = None

    def answer_to_change(self, compiles: bool = False) -> Mapping[str, Any]:
        """Return the answer to a request that changes the document: its status, and whether shaders change.

        If `compiles` is true, the page must get the scene with its shaders anew, and compile them.
        """
        return {"compiles": compiles, **self.document.status()}
