"""How linear light is shown: a view of a display of an OpenColorIO config.

The config is the one that ships (`lookdev.output.config`), a file, or one that is built into OpenColorIO.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

from lookdev.errors import OutputError, nearest_hint, shorten
from lookdev.output.config import FILE, NAME
from lookdev.space import BASE, OCIO_NAMES, REC709

if TYPE_CHECKING:
    import PyOpenColorIO as ocio

SOURCE = OCIO_NAMES[REC709]
"""The colour space in which views take light, by its name in OpenColorIO's built-in configs."""

SHIPPED = NAME
"""The name of the config that ships."""

DISPLAY = "sRGB - Display"
VIEWS: tuple[str, ...] = (NAME, "ACES 1.0 - SDR Video", "Un-tone-mapped", "Raw")
"""The views of `DISPLAY` in the config that ships, the default first."""

BUILT_IN = "ocio://"
"""What comes before the name of a config that is built into OpenColorIO."""


@dataclass(frozen=True)
class DisplayView:
    """A view of a display.

    config
        `SHIPPED`, the path of a config, or ``ocio://`` and the name of one that is built into OpenColorIO.
    space
        The config's name of linear Rec.709; "": OpenColorIO finds it by the interchange roles of the config.
    """

    view: str = VIEWS[0]
    display: str = DISPLAY
    config: str = SHIPPED
    space: str = ""

    @cached_property
    def processor(self) -> ocio.CPUProcessor:
        """The transform from linear Rec.709 to code values; raises OutputError where the config has none."""
        return self.transform.getDefaultCPUProcessor()

    @property
    def transform(self) -> ocio.Processor:
        """The same transform for any device; errors as `processor`."""
        return _processor(self)

    @property
    def digest(self) -> str:
        """What the pictures in this view depend on: the operations of the transform, tables included."""
        if self._is_shipped:
            return ", ".join((hashlib.sha256(FILE.read_bytes()).hexdigest(), self.display, self.view))
        return str(self.processor.getCacheID())

    @property
    def _is_shipped(self) -> bool:
        """Whether it is known without OpenColorIO, whose import takes 0.1 s."""
        return self == DisplayView(self.view) and self.view in VIEWS

    def check(self) -> None:
        """Raise OutputError where a picture cannot be shown so: a name is unknown, or the config is broken."""
        if not self._is_shipped:
            _ = self.processor

    def __str__(self) -> str:
        return f"{self.view} ({self.display})"


def default_display(config: str) -> str:
    """Return the default display of a config; raises OutputError where it cannot be read."""
    return DISPLAY if config == SHIPPED else str(_config(config).getDefaultDisplay())


def default_view(config: str, display: str) -> str:
    """Return the default view of a display; raises OutputError where there is no such display."""
    if (config, display) == (SHIPPED, DISPLAY):
        return VIEWS[0]
    _known(config, "display", display, tuple(_config(config).getDisplays()))
    return str(_config(config).getDefaultView(display))


@lru_cache(maxsize=8)
def _config(name: str) -> ocio.Config:
    import PyOpenColorIO as ocio  # not at the top: most jobs write their first picture late

    try:
        if name.startswith(BUILT_IN):
            return ocio.Config.CreateFromBuiltinConfig(name.removeprefix(BUILT_IN))
        config = ocio.Config.CreateFromFile(str(FILE) if name == SHIPPED else name)
        config.validate()
    except (ocio.Exception, ocio.ExceptionMissingFile) as error:
        known = ", ".join(BUILT_IN + each[0] for each in ocio.BuiltinConfigRegistry().getBuiltinConfigs())
        also = f"; built-in ones are {known}" if name.startswith(BUILT_IN) else ""
        raise OutputError(f"OpenColorIO cannot read the config {name}: {_first_line(error)}{also}") from error
    return config


@lru_cache(maxsize=32)
def _processor(wanted: DisplayView) -> ocio.Processor:
    import PyOpenColorIO as ocio

    config = _config(wanted.config)
    _known(wanted.config, "display", wanted.display, tuple(config.getDisplays()))
    _known(wanted.config, f"view of {wanted.display}", wanted.view, tuple(config.getViews(wanted.display)))
    ends = (wanted.display, wanted.view, ocio.TRANSFORM_DIR_FORWARD)
    try:
        if wanted.space:
            if config.getColorSpace(wanted.space) is None:
                _known(wanted.config, "colour space", wanted.space, tuple(config.getColorSpaceNames()))
            return config.getProcessor(wanted.space, *ends)
        if wanted.config == SHIPPED:
            return config.getProcessor(SOURCE, *ends)
        ours = ocio.Config.CreateFromBuiltinConfig(BASE)
        name = ocio.Config.IdentifyBuiltinColorSpace(config, ours, SOURCE)
    except (ocio.Exception, ocio.ExceptionMissingFile) as error:
        if wanted.space or wanted.config == SHIPPED:
            raise OutputError(f"{wanted.config}: cannot show '{wanted}': {_first_line(error)}") from error
        name = ""
    try:
        if name:
            return config.getProcessor(name, *ends)
        return ocio.Config.GetProcessorFromConfigs(ours, SOURCE, config, *ends)
    except (ocio.Exception, ocio.ExceptionMissingFile) as error:
        why = _first_line(error)
        hint = "" if name else "; name its colour space of linear Rec.709 by 'ocio_space'"
        raise OutputError(f"{wanted.config}: cannot show '{wanted}': {why}{hint}") from error


def _known(config: str, what: str, name: str, names: Sequence[str]) -> None:
    if name not in names:
        hint, every = nearest_hint(name, names), f"known: {', '.join(names)}"
        also = f"; {every}" if hint != every and len(names) <= 20 else ""
        raise OutputError(f"{config} has no {what} called '{name}' ({hint}{also})")


def _first_line(error: Exception) -> str:
    return shorten(next(iter(str(error).splitlines()), type(error).__name__)).rstrip(".")
