"""The small job, finished once for all tests, and rendered from its file as the command line does."""

import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import batch_case as case
import pytest

from lookdev.job import Job
from lookdev.output import sheet
from lookdev.rendering.backends import BACKENDS
from lookdev.run.render import RunResult, render_job

RenderFile = Callable[..., RunResult]


@contextmanager
def small_sheets() -> Iterator[None]:
    """Let sheets have cells of 32 pixels: those of 256 would be half of the time of these tests."""
    write = sheet.write_sheet

    def write_small(*frames_and_text: Any, **_: int) -> None:
        write(*frames_and_text[:5], cell=32)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sheet, "write_sheet", write_small)
        yield


@pytest.fixture(scope="module", autouse=True)
def _small_sheets() -> Iterator[None]:
    with small_sheets():
        yield


@pytest.fixture(scope="session")
def finished_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the small job and all that a run of it makes, which is only read."""
    folder = tmp_path_factory.mktemp("finished")
    (folder / "job.toml").write_text(case.JOB + case.TURNTABLES + case.RENDER)
    with small_sheets():
        case.run(folder)
    return folder


@pytest.fixture
def finished(finished_once: Path, tmp_path: Path) -> Path:
    """Return a copy of the finished job's folder, with its hard links and times."""
    subprocess.run(("cp", "-a", f"{finished_once}/.", tmp_path), check=True)
    return tmp_path


@pytest.fixture
def render_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RenderFile:
    """Return a function that renders the file of the small job; `before` is called where the job is prepared."""
    monkeypatch.setitem(BACKENDS, "exact", replace(BACKENDS["exact"], command=case.command(tmp_path)))
    case.make_job(tmp_path)
    (tmp_path / "job.toml").write_text(case.JOB + case.TURNTABLES + case.RENDER)

    def render(before: Callable[[], object] = lambda: None, **options: Any) -> RunResult:
        def prepare(job: Job, ahead: object) -> Any:
            before()
            return SimpleNamespace(job=job, notes=(), plan=case.make_plan(job))

        return render_job(tmp_path / "job.toml", prepare=prepare, **options)

    return render
