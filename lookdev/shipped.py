"""The jobs, looks, presets and rigs that come with the program."""

from pathlib import Path

_WHEEL_DATA = Path(__file__).with_name("data")


def shipped_folder() -> Path:
    """Return the folder that contains the program's ``jobs``, ``materials`` and ``rigs``.

    It is ``lookdev/data`` in an installed wheel, and the checkout itself otherwise, for an editable install too.
    """
    return _WHEEL_DATA if _WHEEL_DATA.is_dir() else Path(__file__).parents[1]
