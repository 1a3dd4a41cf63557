"""Exports a job for a render farm, for `lookdev export openjd`.

It writes a template of Open Job Description, or a job bundle of AWS Deadline Cloud, which is a folder with a template.

- Open Job Description, template schemas 2023-09: https://github.com/OpenJobDescription/openjd-specifications/wiki
- AWS Deadline Cloud, "Open Job Description templates: job bundles"

A template has two steps. The first step renders chunks, which are parts of the job's frames. On each host, one render
worker is kept for all chunks of the host. The second step writes the outputs that need several frames. The paths of the
job file and of its output are parameters of the template, so that a farm can map them.
"""

from __future__ import annotations

import json
import math
import os
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lookdev.cache import output_errors, write_file
from lookdev.errors import LookdevError
from lookdev.export import ExportResult
from lookdev.job import Job
from lookdev.plan.chunks import MAX_CHUNKS, Division
from lookdev.plan.costs import estimate_costs
from lookdev.plan.prepare import prepare_job
from lookdev.run.manifest import input_files

TEMPLATE_SUFFIXES = (".yaml", ".yml", ".json")
"""The suffixes of a template's file; an output path without one of them is the folder of a job bundle."""

_CHUNK_SECONDS = 300.0  # much longer than the start and the preparation of a chunk, which take some seconds
_TEMPLATE = Path(__file__).with_name("openjd.yaml")
_MAX_NAME_LENGTH = 64  # characters of the job's name
_GPUS = {"cuda", "optix", "hip", "oneapi"}  # the values of `render.device` that need a GPU


@dataclass(frozen=True)
class HostRequirements:
    """Requirements of a host: cores, MiB of memory, and the command, which is the name or path of `lookdev` on it."""

    cores: int = 2
    memory: int = 4096
    command: str = "lookdev"


def export_openjd(
    path: Path, out: Path, chunks: Division | None = None, requirements: HostRequirements = HostRequirements()
) -> ExportResult:
    """Write a job as a template or, if `out` has no suffix of a template, as a job bundle in the folder `out`.

    `chunks` is the division of the frames into chunks. By default, each chunk takes about five minutes, by an estimate.

    Raises
    ------
    LookdevError
        `openjd-model` is not installed, or refuses the template, or there are more chunks than frames.
    JobError
        As in `prepare_job`.
    OutputError
        A file cannot be written.
    """
    try:
        import yaml
        from openjd.model import DecodeValidationError, decode_job_template
    except ImportError:
        raise LookdevError("exports for farms are checked by openjd-model: pip install 'lookdev[farm]'") from None

    prepared = prepare_job(path)
    job, tasks = prepared.job, [frame.task for frame in prepared.plan.frames]
    costs = estimate_costs(prepared.plan)
    division = chunks or Division(min(max(math.ceil(sum(costs.frames) / _CHUNK_SECONDS), 1), len(tasks)))
    if division.count > max(len(tasks), 1):
        raise LookdevError(f"--chunks: a job of {len(tasks)} frames has at most as many chunks, not {division.count}")
    bundle = out.suffix.lower() not in TEMPLATE_SUFFIXES
    template_file = out / "template.yaml" if bundle else out
    folder = template_file.parent.absolute()
    template = job_template(job, folder, division, requirements)
    try:
        decode_job_template(template=template)
    except DecodeValidationError as error:
        raise LookdevError(f"openjd-model refuses the template: {error}") from error

    # The values of the template's path parameters.
    values = {"Job": str(job.file), "Output": str(job.output)}
    documents: dict[Path, object] = {template_file: template}
    if bundle:
        documents |= _bundle_files(job, out, values)

    def encode(data: object, file: Path) -> str:
        """Return a document as JSON or YAML, by the suffix of its file."""
        if file.suffix.lower() == ".json":
            return json.dumps(data, indent=2) + "\n"
        return str(yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=120))

    for file, data in documents.items():
        with output_errors(file, name_file=True):
            write_file(file, encode(data, file))
    if bundle:
        run = f"deadline bundle submit {shlex.quote(str(out))}"
    else:
        run = f"openjd run {shlex.quote(str(out))} --step Outputs --run-dependencies"
        required = (f"{name}={value}" for name, value in values.items() if not Path(value).is_relative_to(folder))
        run += "".join(f" -p {shlex.quote(parameter)}" for parameter in required)
    text = f"{template_file}: {len(tasks)} frames in {division.count} chunks; to run it: {run}"
    return ExportResult(tuple(documents), text, (*prepared.notes, *_path_notes(job)))


def job_template(job: Job, folder: Path, chunks: Division, requirements: HostRequirements) -> dict[str, Any]:
    """Return the template of a job, as a document of the specification that will be a file in `folder`.

    Paths below this folder are default values of parameters, relative to the folder. Other paths have no default.
    """
    import yaml

    template: dict[str, Any] = yaml.safe_load(_TEMPLATE.read_text("utf-8"))
    template["name"] = f"lookdev {job.file.stem}"[:_MAX_NAME_LENGTH]
    template["description"] = f"Turntables of {job.file.name}, by lookdev"
    parameters = {parameter["name"]: parameter for parameter in template["parameterDefinitions"]}
    for name, path in (("Job", job.file), ("Output", job.output)):
        if path.is_relative_to(folder):
            parameters[name]["default"] = path.relative_to(folder).as_posix()
        else:
            del parameters[name]["default"]
    for name, count in (("Chunks", chunks.count), ("Machines", chunks.machines or chunks.count)):
        parameters[name] |= {"default": count, "maxValue": MAX_CHUNKS}
    parameters["Command"]["default"] = requirements.command
    # The first step renders. The last argument of the command that starts its worker is the backend.
    render = template["steps"][0]
    render["stepEnvironments"][0]["script"]["actions"]["onEnter"]["args"][-1] = job.render.backend
    cores, memory, gpu = amounts = render["hostRequirements"]["amounts"]
    cores["min"], memory["min"] = requirements.cores, requirements.memory
    if job.render.device not in _GPUS:
        amounts.remove(gpu)
    return template


def _bundle_files(job: Job, out: Path, values: Mapping[str, str]) -> dict[Path, object]:
    """Return the contents of a bundle's files other than the template, by path.

    One file has the values of the template's parameters. The other has the paths of the files that the job reads, and
    of its output.
    """
    inputs = [str(file) for file in input_files(job) if file != job.file]
    references = {
        "inputs": {"filenames": inputs, "directories": []},
        "outputs": {"directories": [str(job.output)]},
        "referencedPaths": [],
    }
    parameters = [{"name": name, "value": value} for name, value in values.items()]
    return {
        out / "parameter_values.yaml": {"parameterValues": parameters},
        out / "asset_references.yaml": {"assetReferences": references},
    }


def _path_notes(job: Job) -> list[str]:
    """Return notes about files that a farm without a shared file system cannot find."""
    folder = job.file.parent
    outside = [file for file in input_files(job) if not file.is_relative_to(folder)]
    if outside and os.path.commonpath([folder, *outside]) == "/":
        return [f"{outside[0]} has no folder in common with {job.file}: a farm that maps paths may not find it"]
    return []
