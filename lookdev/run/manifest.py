"""Writes and verifies the manifest of an output folder, which lists its files and inputs with their SHA-256."""

from __future__ import annotations

import json
import platform
import shlex
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

import lookdev
from lookdev.cache import file_digest, write_file
from lookdev.errors import LookError, StageError
from lookdev.job import Job
from lookdev.mtlx import document_layer, is_document
from lookdev.output.exr import read_header
from lookdev.output.manifest import NAME, STATE_FOLDER, Deviation, deviations, read_manifest, write_manifest
from lookdev.plan import Plan
from lookdev.run.ledger import Ledger
from lookdev.safe_text import read_json_object
from lookdev.stage import dependencies

_STATE = f"{STATE_FOLDER}/digests.json"  # stores the digests of files from run to run


def input_files(job: Job) -> list[Path]:
    """Return a job file and all files that the job reads, including those that its USD files compose."""
    composed = [job.asset.usd, job.camera.file, *(rig.usd for rig in job.rig)]
    composed += [job.ground.material] if job.ground else []
    for look in job.look:
        composed += [look.material, look.layer, *(assigned.material for assigned in look.assign)]
    files = {ibl.file for ibl in job.ibl if ibl.file}.union(*(_composed_files(file) for file in composed if file))
    return [job.file, *sorted(files)]


def _composed_files(file: Path) -> set[Path]:
    """Return a USD or MaterialX file and all files that it composes."""
    files = {file}
    with suppress(StageError):  # the file may have been replaced since the run read it
        if not is_document(str(file)):
            files = dependencies(file)
    for document in [path for path in files if is_document(str(path))]:
        with suppress(StageError, LookError):
            layer = document_layer(str(document))
            files |= dependencies(layer) - {layer.resolve()}
    return files


def record_run(job: Job, plan: Plan) -> Path:
    """Write the manifest of an output folder after a run, and return its path.

    Files whose size, time and inode have not changed are not read again. Raises OSError where a file cannot be read or
    written.
    """
    digests = _FileDigests(plan.output / _STATE)
    render = f"lookdev render {shlex.quote(str(job.file))}"
    turntables = (file for reel in plan.reels for file in reel.files)
    planned = list(dict.fromkeys((*turntables, *(file for frame in plan.frames for file in frame.task.files))))

    def frames() -> Iterator[dict[str, Any]]:
        for file in planned:
            if file.is_file():
                name = file.relative_to(plan.output).as_posix()
                again = f"{render} --force --frame {shlex.quote(name.removesuffix('.exr'))}"
                yield digests.entry(file, name) | {"header": read_header(file), "command": again}

    optional = (key for key in ("charts", "ground") if getattr(job, key) is not None)
    pictures = ((plan.output / name, name) for name in Ledger(plan.output / STATE_FOLDER).names)
    manifest = {
        "job": str(job.file),
        "command": render,
        "versions": {"lookdev": lookdev.__version__, "python": platform.python_version(), "numpy": np.__version__},
        "view": asdict(job.outputs.display_view("png")),
        "settings": job.model_dump(mode="json", include={"render", "outputs", *optional}),
        "inputs": (digests.entry(file, str(file)) for file in input_files(job) if file.is_file()),
        "planned": len(planned),
        "frames": frames(),
        "pictures": (digests.entry(file, name) for file, name in pictures if file.is_file()),
    }
    path = write_manifest(plan.output, manifest)
    digests.save()
    return path


class _FileDigests:
    """A cache of the SHA-256 of files. A digest is valid while size, time of change and inode of the file are equal."""

    def __init__(self, file: Path) -> None:
        self._file = file
        # A record has the size, time, inode and digest of a file. The keys are the paths of the files.
        self._old = read_json_object(file)  # the records of the run before; empty if their file is missing
        self._new: dict[str, list[Any]] = {}  # the records of this run

    def entry(self, file: Path, name: str) -> dict[str, Any]:
        """Return the entry of a file for the manifest, with its digest; `name` is the name of the file there."""
        status = file.stat()
        stamp = [status.st_size, status.st_mtime_ns, status.st_ino]
        old = self._old.get(str(file))
        digest = old[-1] if isinstance(old, list) and old[:-1] == stamp else file_digest(file)
        self._new[str(file)] = [*stamp, digest]
        return {"file": name, "sha256": digest}

    def save(self) -> None:
        """Store the digests of the files of this run."""
        if self._new != self._old:
            write_file(self._file, json.dumps(self._new))


def verify_manifest(folder: Path) -> tuple[Mapping[str, Any], tuple[Deviation, ...]]:
    """Return the manifest of an output folder and all deviations from it; raises the errors of `read_manifest`."""
    manifest = read_manifest(folder)
    return manifest, tuple(deviations(folder.absolute(), manifest))


def manifest_text(folder: Path, manifest: Mapping[str, Any], problems: Iterable[Deviation] | None) -> str:
    """Return a summary of a manifest as text.

    `problems` has the deviations of the folder from the manifest. It is None if the manifest was not verified.
    """
    frames = manifest["frames"]
    errors = [float(frame["header"]["relmse"]) for frame in frames if "relmse" in frame.get("header", {})]
    worst = f", largest relMSE {max(errors):.1e}" if errors else ""
    lines = [
        f"{folder / NAME}: {len(frames)} of {manifest['planned']} frames, {len(manifest['pictures'])} pictures, "
        f"{len(manifest['inputs'])} inputs{worst}"
    ]
    if problems is None:
        return lines[0]
    listed = list(problems)
    lines += map(str, listed)
    wrong = sum(deviation.is_failure for deviation in listed)
    lines.append(f"{wrong} files are not as they are listed" if wrong else "all files are as they are listed")
    return "\n".join(lines)
