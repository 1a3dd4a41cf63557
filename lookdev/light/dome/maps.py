"""Dome lights of image files, cached by the digest of a file's content, so that its pixels are read only once."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass
from pathlib import Path

from lookdev.cache import code_digest, file_digest, load_cached, store_cached
from lookdev.errors import EnvironmentMapError
from lookdev.images import check_file
from lookdev.light.dome import Dome, load_cached_dome, prepare_light
from lookdev.light.dome.environment import Repairs, builtin_file, check_exposed, load_environment

_ROOM = "maps"  # the folder of the cache with the record of each file's dome


@dataclass(frozen=True)
class DomeMap:
    """The dome light of a map, the repairs of the map, and its largest radiance in any channel.

    `where` names the map in messages.
    """

    dome: Dome
    repairs: Repairs
    largest: float
    where: str

    def check_exposed(self, exposure: float) -> None:
        """Raise EnvironmentMapError if shaders cannot compute with the map's radiance times 2^exposure."""
        check_exposed(self.largest, exposure, self.where)


def load_dome(file: Path | None = None, builtin: str | None = None, *, sampled: bool = True) -> DomeMap:
    """Load a map as `load_environment` does, and make its dome as `prepare_light` does; raise the errors of both.

    If the cache has the files of a dome for the same content, the pixels are not read.
    """
    if builtin == "white" or (file is None) == (builtin is None):
        return _read_map(file, builtin, sampled)
    source = builtin_file(builtin or "") if file is None else file
    check_file(source, EnvironmentMapError)
    # The suffix determines how the content is read.
    description = f"{code_digest('light')} {source.suffix.lower()} {file_digest(source)}"
    key = hashlib.sha256(description.encode()).hexdigest()
    match load_cached(_ROOM, key):
        case [str(digest), int(width), int(height), bool(constant), float(largest), dict(repairs)]:
            if dome := load_cached_dome(digest, width, height, constant, sampled):
                return DomeMap(dome, Repairs(**repairs), largest, str(file or builtin))
    dome_map = _read_map(file, builtin, sampled)
    dome = dome_map.dome
    record = [dome.map_digest, dome.width, dome.height, dome.constant, dome_map.largest, asdict(dome_map.repairs)]
    store_cached(_ROOM, key, record)
    return dome_map


def _read_map(file: Path | None, builtin: str | None, sampled: bool) -> DomeMap:
    environment = load_environment(file, builtin)
    dome = prepare_light(environment, sampled=sampled)
    return DomeMap(dome, environment.repairs, float(environment.radiance.max()), environment.where)
