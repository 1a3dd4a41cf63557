"""The folder of the jobs, looks, presets and rigs that come with the program, and the names of these rigs."""

from pathlib import Path

from lookdev.errors import EnvironmentMapError, nearest_hint

_WHEEL_DATA = Path(__file__).with_name("data")

BUILTIN_RIGS: tuple[str, ...] = ("three_point", "softbox_product", "overcast_plus_sun")
"""Names of the rigs that come with the program. Each is a file in ``rigs``, and fits an asset of any size."""


def shipped_folder() -> Path:
    """Return the folder that contains the program's ``jobs``, ``materials`` and ``rigs``.

    It is ``lookdev/data`` in an installed wheel, and the checkout itself otherwise, for an editable install too.
    """
    return _WHEEL_DATA if _WHEEL_DATA.is_dir() else Path(__file__).parents[1]


def rig_file(name: str) -> Path:
    """Return the file of one of `BUILTIN_RIGS`; raises EnvironmentMapError for another name."""
    if name not in BUILTIN_RIGS:
        raise EnvironmentMapError(f"no built-in rig '{name}' ({nearest_hint(name, BUILTIN_RIGS)})")
    return shipped_folder() / "rigs" / f"{name}.usda"
