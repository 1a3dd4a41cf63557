"""The panels of the Designer's page, in their order on it: `PANELS`.

A panel is a JavaScript module, `static/<name>.js`, which exports the panel's HTML and behaviour as `panel`. A panel
that sends requests to the server also has a class of `Routes`, in a module of this package.
`lookdev.studio.designer.app` serves both.
"""

from __future__ import annotations

from dataclasses import dataclass

from lookdev.studio.designer.panels.assign import AssignRoutes
from lookdev.studio.designer.panels.exact import ExactRoutes
from lookdev.studio.designer.panels.files import FileRoutes
from lookdev.studio.designer.panels.history import HistoryRoutes
from lookdev.studio.designer.panels.layers import LayerRoutes
from lookdev.studio.designer.panels.lights import LightRoutes
from lookdev.studio.designer.panels.presets import PresetRoutes
from lookdev.studio.designer.panels.snapshots import SnapshotRoutes
from lookdev.studio.designer.panels.turntable import TurntableRoutes
from lookdev.studio.designer.routes import Routes


@dataclass(frozen=True)
class Panel:
    """A panel of the page: the name of its JavaScript module, and the class of its routes, if it has any."""

    name: str
    routes: type[Routes] | None = None


PANELS = (
    Panel("history", HistoryRoutes),
    Panel("snapshots", SnapshotRoutes),
    Panel("files", FileRoutes),
    Panel("exact", ExactRoutes),
    Panel("assign", AssignRoutes),
    Panel("layers", LayerRoutes),
    Panel("view"),
    Panel("lights", LightRoutes),
    Panel("turntable", TurntableRoutes),
    Panel("left_out"),
    Panel("presets", PresetRoutes),
)
"""The panels of the page, in their order on it."""
