"""The verbs of job files: render, plan, example, schema."""

import json
import os
import re
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import batch_case as case
import pytest

from lookdev.cli import run
from lookdev.errors import OutputError
from lookdev.export.examples import copy_example, list_examples
from lookdev.job import json_schema, load_job
from lookdev.material.usd import read_look
from lookdev.rendering.backends import BACKENDS
from lookdev.stage import Composition, compose


def test_render_from_nothing_and_again(run_cli, job_file):
    code, output, errors = run_cli("render", job_file)
    assert (code, errors) == (0, "")
    assert "\x1b" not in output
    lines = output.splitlines()
    assert lines[:2] == ["note: city: 3 texels repaired", "6 frames, 6 to render"]
    assert lines[-1] == "6 of 6 frames are done, 6 of them rendered now."
    for options, count in (((), 0), (("--force",), 6)):
        code, output, _ = run_cli("render", job_file, *options)
        assert (code, output.splitlines()[-1]) == (0, f"6 of 6 frames are done, {count} of them rendered now.")


def test_failed_frames_are_exit_code_1_and_a_list_on_stderr(run_cli, job_file, tmp_path):
    case.misbehave(tmp_path, lighting_0002=["failed"])
    code, _, errors = run_cli("render", job_file)
    assert code == 1
    assert errors.startswith("1 of 6 frames failed:\ngold/city/lighting.0002: no such attribute 'st2' (log: ")


def test_a_worker_that_never_starts_is_exit_code_1(run_cli, job_file, monkeypatch):
    broken = replace(BACKENDS["exact"], command=(sys.executable, "-c", "raise ImportError('bpy')"))
    monkeypatch.setitem(BACKENDS, "exact", broken)
    code, _, errors = run_cli("render", job_file)
    assert code == 1
    assert "lookdev doctor" in errors


@pytest.mark.parametrize("arguments", [("plan",), ("render", "--dry-run")])
def test_plan_lists_what_would_be_rendered_and_renders_nothing(run_cli, job_file, arguments):
    code, output, errors = run_cli(*arguments, job_file)
    assert (code, errors) == (0, "note: city: 3 texels repaired\n")
    assert "gold/city/element   0001-0004  new    no file" in output
    assert not (job_file.parent / "out").exists()


def test_a_dry_run_heeds_chunk_and_output(run_cli, job_file, tmp_path):
    dry = "render", "--dry-run", job_file, "--output", tmp_path / "other"
    parts = [run_cli(*dry, "--chunk", f"{number}/2")[1] for number in (1, 2)]
    assert all(part.splitlines()[-1].startswith("3 of 3 frames to render") for part in parts)
    assert parts[0] != parts[1]


def test_a_dry_run_checks_the_options_of_the_run(run_cli, job_file):
    for options, message in (
        (["--chunk", "0/3"], "'0/3' is not a chunk: 2/8 is the second of eight"),
        (["--chunk", "4/3"], "'4/3' is not a chunk"),
        (["--executor", "dsk"], "unknown executor 'dsk' (did you mean 'dask'?"),
        (["--frame", "gold/city/element.0001"], "it goes without --force, --frame, --outputs-only"),
    ):
        code, output, errors = run_cli("render", "--dry-run", job_file, *options)
        assert (code, output, message in errors) == (2, "", True), options


@pytest.mark.parametrize("verb", ["render", "plan"])
def test_a_faulty_job_is_exit_code_2_with_every_fault(run_cli, job_file, verb):
    job_file.write_text(job_file.read_text().replace("samples", "sampels") + "pgn = true\n")
    code, output, errors = run_cli(verb, job_file)
    assert (code, output) == (2, "")
    first, *faults = errors.splitlines()
    assert first == "lookdev: 2 faults:"
    assert [("sampels" in fault, "pgn" in fault) for fault in faults] == [(True, False), (False, True)]


def test_schema_to_stdout_and_to_a_file(run_cli, tmp_path):
    assert json.loads(run_cli("schema")[1]) == json_schema()
    assert run_cli("schema", "--out", tmp_path / "job.schema.json") == (0, "", "")
    assert json.loads((tmp_path / "job.schema.json").read_text()) == json_schema()
    code, _, errors = run_cli("schema", "--out", tmp_path / "job.schema.json" / "job.schema.json")
    assert (code, str(tmp_path) in errors) == (1, True)


@pytest.mark.parametrize("example", list_examples(), ids=lambda example: example.name)
def test_an_example_is_copied_whole_and_once(example, tmp_path):
    copied = copy_example(example.name, tmp_path)
    job = load_job(copied.job)
    assert job.output == tmp_path / "out" / example.name
    for table in (table for look in job.look for table in (look, *look.assign) if table.material):
        assert table.material.is_relative_to(tmp_path)
        variants = {name: choice for name, choice in table.variants.items() if choice != "*"}
        assert read_look(table.material, table.prim, variants).layers
    layers = [look.layer for look in job.look if look.layer]
    for composition in [Composition(job.asset.usd, layer) for layer in (None, *layers) if job.asset.usd]:
        assert compose(composition).notes == ()
    assert copied.written == sum(path.is_file() for path in tmp_path.rglob("*"))
    assert copy_example(example.name, tmp_path).written == 0


def test_an_example_replaces_what_differs_only_by_force(tmp_path):
    copied = copy_example("first", tmp_path)
    text = copied.job.read_text()
    copied.job.write_text("mine")
    look, *_ = tmp_path.joinpath("materials").glob("*.usda")
    look.unlink()
    with pytest.raises(OutputError, match=rf"differ from the example's: {copied.job} \(--force"):
        copy_example("first", tmp_path)
    assert copied.job.read_text() == "mine"
    assert not look.exists()
    assert copy_example("first", tmp_path, force=True).written == 2
    assert copied.job.read_text() == text


def test_example_lists_and_names_the_next_command(run_cli, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, output, _ = run_cli("example")
    assert code == 0
    for example, line in zip(list_examples(), output.splitlines(), strict=False):
        assert re.fullmatch(rf"{example.name} .*{re.escape(example.title)}", line)
        assert f" {re.search(r'# About (.*) on two cores', example.file.read_text())[1]} " in line
    code, output, errors = run_cli("example", "first", "--to", "my jobs")
    assert (code, errors) == (0, "")
    assert output.endswith("next: lookdev render 'my jobs/jobs/first.toml'\n")


def test_what_a_library_prints_is_not_before_the_json(job_file, provide, monkeypatch, capfd):
    prepared = SimpleNamespace(job=load_job(job_file), plan=case.make_plan(load_job(job_file)), notes=())

    def prepare_job(path: Path) -> SimpleNamespace:
        os.write(1, b"Warning: a library\n")
        return prepared

    provide("lookdev.plan.prepare", prepare_job=prepare_job)
    monkeypatch.setattr(sys, "argv", ["lookdev", "plan", str(job_file), "--json"])
    with pytest.raises(SystemExit):
        run()
    output, errors = capfd.readouterr()
    assert json.loads(output)["render"] == 6
    assert "Warning: a library" in errors
