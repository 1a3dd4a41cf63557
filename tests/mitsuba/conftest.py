"""A warm worker of Mitsuba; tests are skipped where it, or an LLVM that compiles its kernels, is not installed."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from frames import RenderScene, frames_of

from lookdev.errors import RenderError
from lookdev.render.backends import BACKENDS
from lookdev.render.llvm import VARIABLE, find_llvm
from lookdev.render.worker import Worker


@pytest.fixture(scope="session")
def llvm() -> str:
    try:
        return find_llvm()
    except RenderError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def drjit(llvm: str):
    """Return Dr.Jit, in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(VARIABLE, llvm)
        yield pytest.importorskip("drjit")


@pytest.fixture(scope="session")
def worker(llvm: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Worker]:
    folder = tmp_path_factory.mktemp("worker")
    with Worker(BACKENDS["mitsuba"].command, folder / "worker.log", folder, 300.0) as process:
        yield process


@pytest.fixture(scope="session")
def render(worker: Worker) -> RenderScene:
    return frames_of(worker, "mitsuba")
