"""Batch look-dev turntables: film reflectance models rendered exactly as published, on Blender's Cycles.

`docs/architecture.md` describes the packages and the order in which they import each other.
"""

__version__: str


def __getattr__(name: str) -> str:
    """Return the version of the package as ``__version__``.

    `importlib.metadata` is not imported at the top: it takes a quarter of the time of ``lookdev --help``.
    """
    if name != "__version__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib.metadata import version

    return version("lookdev")
