"""Saves the pictures of a failed comparison beside the test's temporary folder, and names them in the failure.

A test puts ``with comparison(shown, expected):`` around its assertions. If one of them fails, both pictures and their
difference are written as EXR, and side by side as PNG. pytest keeps the folders of its last three runs.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from numpy.typing import NDArray
from stored_references import renew_command

from lookdev.arrays import Reals

_LEAST = 256  # pixels: small pictures are enlarged for the PNG, by a whole factor, up to a longer side of this length


@contextmanager
def comparison(shown: Reals, expected: Reals, pixels: NDArray[Any] | None = None) -> Iterator[None]:
    """Save pictures (H, W, 3) or (H, W) if an assertion in the block fails.

    With `pixels` (P, 2), which are columns and rows, `expected` (P, 3) has the values of these pixels only.
    """
    try:
        yield
    except AssertionError as error:
        error.pictures = [*getattr(error, "pictures", ()), _pictures(shown, expected, pixels)]  # type: ignore[attr-defined]
        raise


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Any:
    """Save the pictures of a failed test, and add notes to its failure: their files, and how to renew references."""
    try:
        return (yield)
    except AssertionError as error:
        if hasattr(error, "pictures"):
            name = re.sub(r"\W+", "_", item.name)[:60]
            folder = item.config._tmp_path_factory.mktemp(f"failed_{name}")  # type: ignore[attr-defined]
            for number, pictures in enumerate(error.pictures):
                _save(folder, f"{number}_" if number else "", pictures)
            files = ", ".join(sorted(file.name for file in folder.iterdir()))
            error.add_note(f"The pictures are in {folder}: {files}")
        references = sorted({file for key, file in item.user_properties if key == "reference"})
        if references:
            files = ", ".join(f"tests/references/{file}" for file in references)
            error.add_note(f"The test compares with {files}; if that is out of date:\n{renew_command(item)}")
        raise


def _pictures(shown: Reals, expected: Reals, pixels: NDArray[Any] | None) -> dict[str, Reals]:
    """Return the pictures to save, by name; pixels that are not compared become 0."""
    shown = np.asarray(shown, np.float64)
    if pixels is not None:
        columns, rows = np.asarray(pixels).T
        full = np.zeros(shown.shape)
        full[rows, columns] = expected
        compared = np.zeros(shown.shape[:2], np.bool_)
        compared[rows, columns] = True
        shown, expected = np.where(compared.reshape(compared.shape + (1,) * (shown.ndim - 2)), shown, 0.0), full
    return {"shown": shown, "expected": np.asarray(expected, np.float64), "difference": shown - expected}


def _save(folder: Path, prefix: str, pictures: dict[str, Reals]) -> None:
    """Write each picture as EXR, and all side by side as PNG, in which a difference of 0 is grey."""
    colors = [np.atleast_3d(picture) * np.ones(3) for picture in pictures.values()]
    for name, color in zip(pictures, colors, strict=True):
        oiio.ImageBuf(np.ascontiguousarray(color, np.float32)).write(str(folder / f"{prefix}{name}.exr"))
    white = max(float(np.quantile(np.nan_to_num(colors[1]), 0.99)), 1e-6)
    largest = max(float(np.abs(np.nan_to_num(colors[2])).max()), 1e-6)
    encoded = [np.clip(np.nan_to_num(color) / white, 0.0, 1.0) ** (1.0 / 2.2) for color in colors[:2]]
    side_by_side = np.concatenate([*encoded, 0.5 + 0.5 * np.nan_to_num(colors[2]) / largest], axis=1)
    zoom = max(1, _LEAST // max(colors[0].shape[:2]))
    enlarged = np.kron(side_by_side, np.ones((zoom, zoom, 1)))
    oiio.ImageBuf(np.rint(255.0 * enlarged).astype(np.uint8)).write(str(folder / f"{prefix}compared.png"))
