"""The rigs that ship with the program: names and files."""

from __future__ import annotations

from pathlib import Path

from lookdev.errors import EnvironmentMapError, nearest_hint
from lookdev.shipped import shipped_folder

BUILTIN_RIGS: tuple[str, ...] = ("three_point", "softbox_product", "overcast_plus_sun")
"""Names of the rigs, each of which is a file in ``rigs`` and fits an asset of any size."""


def rig_file(name: str) -> Path:
    """Return the file of one of `BUILTIN_RIGS`; raises EnvironmentMapError for another name."""
    if name not in BUILTIN_RIGS:
        raise EnvironmentMapError(f"no built-in rig '{name}' ({nearest_hint(name, BUILTIN_RIGS)})")
    return shipped_folder() / "rigs" / f"{name}.usda"
