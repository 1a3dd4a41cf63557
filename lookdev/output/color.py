"""Views: the transforms of OpenColorIO from linear light to code values of a display.

A view is defined in an OpenColorIO config: the one that ships with this program (`lookdev.output.config`), a file, or a
config that is built into OpenColorIO.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

from lookdev.errors import OutputError, nearest_hint, shorten
from lookdev.output.config import FILE, NAME
from lookdev.space import OCIO_CONFIG, OCIO_NAMES, REC709

if TYPE_CHECKING:
    import PyOpenColorIO as ocio

SOURCE = OCIO_NAMES[REC709]
"""The colour space of the light that views take, linear Rec.709, by its name in OpenColorIO's built-in configs."""

SHIPPED = NAME
"""The name of the config that ships."""

DISPLAY = "sRGB - Display"
"""The default display of the config that ships."""

VIEWS: tuple[str, ...] = (NAME, "ACES 1.0 - SDR Video", "Un-tone-mapped", "Raw")
"""The views of `DISPLAY` in the config that ships, the default first."""

BUILT_IN = "ocio://"
"""Prefix of the name of a config that is built into OpenColorIO."""


@dataclass(frozen=True)
class DisplayView:
    """A view of a display: the names of both, and the config that defines them.

    config
        `SHIPPED`, the path of a config, or ``ocio://`` and the name of a config in OpenColorIO.
    space
        The config's name of linear Rec.709. If it is empty, OpenColorIO identifies the space by the interchange roles
        of the config.
    """

    view: str = VIEWS[0]
    display: str = DISPLAY
    config: str = SHIPPED
    space: str = ""

    @cached_property
    def processor(self) -> ocio.CPUProcessor:
        """The transform from linear Rec.709 to code values, on the CPU.

        Raises OutputError where the config does not define such a transform.
        """
        return self.transform.getDefaultCPUProcessor()

    @property
    def transform(self) -> ocio.Processor:
        """The transform of `processor`, from which OpenColorIO also makes shaders; raises what `processor` raises."""
        return _processor(self)

    @property
    def digest(self) -> str:
        """A digest of the transform with its tables; pictures in this view change only if the digest changes."""
        if self._is_shipped:
            return ", ".join((hashlib.sha256(FILE.read_bytes()).hexdigest(), self.display, self.view))
        return str(self.processor.getCacheID())

    @property
    def _is_shipped(self) -> bool:
        """Whether the view is one of `VIEWS` in the config that ships.

        Such a view needs no check, so that OpenColorIO need not be imported.
        """
        return self == DisplayView(self.view) and self.view in VIEWS

    def check(self) -> None:
        """Raise OutputError where the view cannot be used: a name is unknown, or the config is broken."""
        if not self._is_shipped:
            _ = self.processor

    def __str__(self) -> str:
        return f"{self.view} ({self.display})"


def default_display(config: str) -> str:
    """Return the name of the default display of a config; raises OutputError where the config cannot be read."""
    return DISPLAY if config == SHIPPED else str(_config(config).getDefaultDisplay())


def default_view(config: str, display: str) -> str:
    """Return the name of a display's default view; raises OutputError where there is no such display."""
    if (config, display) == (SHIPPED, DISPLAY):
        return VIEWS[0]
    _require_name(config, "display", display, tuple(_config(config).getDisplays()))
    return str(_config(config).getDefaultView(display))


@lru_cache(maxsize=8)
def _config(name: str) -> ocio.Config:
    """Return the config that `DisplayView.config` names; raises OutputError where it cannot be read."""
    import PyOpenColorIO as ocio  # not at the top: most jobs do not write a picture until late

    try:
        if name.startswith(BUILT_IN):
            return ocio.Config.CreateFromBuiltinConfig(name.removeprefix(BUILT_IN))
        config = ocio.Config.CreateFromFile(str(FILE) if name == SHIPPED else name)
        config.validate()
    except (ocio.Exception, ocio.ExceptionMissingFile) as error:
        builtin_names = ", ".join(BUILT_IN + entry[0] for entry in ocio.BuiltinConfigRegistry().getBuiltinConfigs())
        also = f"; built-in ones are {builtin_names}" if name.startswith(BUILT_IN) else ""
        raise OutputError(f"OpenColorIO cannot read the config {name}: {_first_line(error)}{also}") from error
    return config


@lru_cache(maxsize=32)
def _processor(view: DisplayView) -> ocio.Processor:
    """Return the transform of a view; raises OutputError where a name is unknown or the config is broken."""
    import PyOpenColorIO as ocio

    config = _config(view.config)
    _require_name(view.config, "display", view.display, tuple(config.getDisplays()))
    _require_name(view.config, f"view of {view.display}", view.view, tuple(config.getViews(view.display)))
    display_arguments = (view.display, view.view, ocio.TRANSFORM_DIR_FORWARD)
    source = view.space or (SOURCE if view.config == SHIPPED else "")
    try:
        if view.space and config.getColorSpace(view.space) is None:
            _require_name(view.config, "colour space", view.space, tuple(config.getColorSpaceNames()))
        if not source:
            base = ocio.Config.CreateFromBuiltinConfig(OCIO_CONFIG)
            with suppress(ocio.Exception, ocio.ExceptionMissingFile):
                source = ocio.Config.IdentifyBuiltinColorSpace(config, base, SOURCE)
        if source:
            return config.getProcessor(source, *display_arguments)
        return ocio.Config.GetProcessorFromConfigs(base, SOURCE, config, *display_arguments)
    except (ocio.Exception, ocio.ExceptionMissingFile) as error:
        hint = "" if source else "; name its colour space of linear Rec.709 by 'ocio_space'"
        raise OutputError(f"{view.config}: cannot show '{view}': {_first_line(error)}{hint}") from error


def _require_name(config: str, kind: str, name: str, names: Sequence[str]) -> None:
    """Raise OutputError unless `name` is one of `names`, which are all names of objects of a kind in a config."""
    if name not in names:
        hint, all_names = nearest_hint(name, names), f"known: {', '.join(names)}"
        also = f"; {all_names}" if hint != all_names and len(names) <= 20 else ""
        raise OutputError(f"{config} has no {kind} called '{name}' ({hint}{also})")


def _first_line(error: Exception) -> str:
    """Return the first line of an error's message, for another message."""
    return shorten(next(iter(str(error).splitlines()), type(error).__name__)).rstrip(".")
