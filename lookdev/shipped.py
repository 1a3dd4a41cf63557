"""The jobs, looks, presets and rigs that come with the program."""

from pathlib import Path

_PACKAGED = Path(__file__).with_name("data")


def shipped_folder() -> Path:
    """Return the folder that contains ``jobs``, ``materials`` and ``rigs``.

    That is ``lookdev/data`` in an installed wheel, and the checkout itself otherwise, for an editable install too.
    """
    return _PACKAGED if _PACKAGED.is_dir() else Path(__file__).parents[1]
