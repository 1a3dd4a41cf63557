"""The command line in this process, with the fakes of tests/ and tests/bench."""

import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

sys.path.append(str(Path(__file__).parents[1] / "bench"))

import batch_case as case

from lookdev.cli import run
from lookdev.job import Job, load_job
from lookdev.rendering.backends import BACKENDS


@pytest.fixture
def run_cli(monkeypatch, capsys):
    """Return a function that runs the command line and returns its exit code, stdout and stderr."""

    def run_with(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["lookdev", *map(str, arguments)])
        with pytest.raises(SystemExit) as exit_info:
            run()
        return (int(exit_info.value.code or 0), *capsys.readouterr())

    return run_with


@pytest.fixture
def provide(monkeypatch):
    """Return a function that replaces a module by another one with the given members."""

    def replace_module(name: str, **members: object) -> None:
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)

    return replace_module


@pytest.fixture
def job_file(tmp_path, monkeypatch, provide):
    """Return a job whose preparation and worker are fakes."""
    case.make_job(tmp_path)
    path = tmp_path / "job.toml"
    path.write_text(case.JOB + case.TURNTABLES + case.RENDER)

    def plan_job(job: Job, ahead: object = None) -> SimpleNamespace:
        return SimpleNamespace(job=job, plan=case.make_plan(job), notes=("city: 3 texels repaired",))

    provide("lookdev.plan.prepare", prepare_job=lambda path: plan_job(load_job(path)), plan_job=plan_job)
    monkeypatch.setitem(BACKENDS, "exact", replace(BACKENDS["exact"], command=tuple(case.command(tmp_path))))
    return path


@pytest.fixture
def plant(provide, job_file):
    """Return a function that makes the preparation of a job raise an exception."""

    def fail(error: BaseException) -> None:
        def prepare(job: object, ahead: object = None) -> None:
            raise error

        provide("lookdev.plan.prepare", prepare_job=prepare, plan_job=prepare)

    return fail
