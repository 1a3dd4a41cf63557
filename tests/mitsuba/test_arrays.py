"""Arrays of a scene: in memory that kernels do not depend on, and read once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lookdev.cache import Content

pytestmark = pytest.mark.mitsuba


@pytest.mark.parametrize("offset", range(4))
def test_held_numbers_are_aligned_wherever_they_came_from(drjit, offset: int) -> None:
    from lookdev.mitsuba.frozen import held

    numbers = np.arange(1000, dtype=np.float64)[offset:]
    for kind in (drjit.llvm.Float, drjit.llvm.UInt32):
        found = np.asarray(held(kind, numbers))
        np.testing.assert_array_equal(found, numbers)
        assert found.ctypes.data % 16 == 0, "Dr.Jit gathers four numbers at once, or one by one, by this"


def test_a_file_is_read_once_while_its_numbers_are_held(drjit) -> None:
    from lookdev.mitsuba.files import file_array

    reads = []

    def read(path: Path) -> np.ndarray:
        reads.append(path)
        return np.load(path)

    def save(path: Path) -> None:
        np.save(path, np.arange(6, dtype=np.float32).reshape(2, 3))

    content = Content.written(".npy", save)
    first = file_array(drjit.llvm.Float, content, read)
    assert file_array(drjit.llvm.Float, content, read) is first
    assert first.shape == (2, 3)
    assert len(reads) == 1
    del first
    again = file_array(drjit.llvm.Float, content, read)
    np.testing.assert_array_equal(np.asarray(again.array), np.arange(6))
    assert len(reads) == 2
