"""Open the job or the asset that `lookdev design` names as a document of the Designer."""

from __future__ import annotations

from pathlib import Path

from lookdev.job import load_job
from lookdev.safe_text import TextError, read_bytes
from lookdev.studio.designer.document import Document
from lookdev.studio.designer.edited_job import EditedJob, path_in_job
from lookdev.studio.designer.recovery import Recovery

ASSET_JOB = """# Made by 'lookdev design'.
output = "out/{name}"

[asset]
{asset}

[[look]]
name = "own"
{material}
[[ibl]]
name = "courtyard"
builtin = "courtyard"

[[ibl]]
name = "studio"
builtin = "studio"

[[turntable]]
kind = "element"
frames = 24

[render]
resolution = [960, 720]
background = "ibl"
"""
"""The text of the new job for an asset that is opened without a job."""


def open_document(
    file: Path | None, builtin: str | None = None, material: Path | None = None, *, recovers: bool = False
) -> Document:
    """Open a job (.toml), or an asset with its own materials or with `material`.

    With `recovers`, the document stores unsaved work, and offers the work of an earlier Designer. An asset gets a new
    job in the working folder; the job is not on disk until it is saved.

    Raises
    ------
    JobError
        The job has faults.
    FaultsError
        The files of the job, or the asset, have faults.
    """
    # Unsaved work is found again by the arguments with which the document was opened.
    opening_key = "|".join(
        str(part.absolute()) if isinstance(part, Path) else str(part) for part in (file, builtin, material)
    )
    recovery = Recovery(opening_key) if recovers else None
    if file is not None and file.suffix == ".toml":
        return Document(EditedJob(file.absolute(), _content(file)), recovery)
    stem = str(builtin) if file is None else file.stem
    job = _recoverable_job(recovery) or _free_path(Path.cwd() / f"{stem}.toml")
    if job.exists():  # an earlier Designer saved this job, and then left unsaved work, which is offered
        return Document(EditedJob(job, _content(job)), recovery)
    asset = f"builtin = {_quote(str(builtin))}" if file is None else f"usd = {_quote(_path_for_job(file, job))}"
    material_line = f"material = {_quote(_path_for_job(material, job))}\n" if material else ""
    job_text = ASSET_JOB.format(name=stem, asset=asset, material=material_line)
    return Document(EditedJob(job, job_text.encode()), recovery)


def _content(file: Path) -> bytes:
    """Return the content of a job's file; raise JobError, as `load_job` does, if it cannot be read."""
    try:
        return read_bytes(file)
    except TextError:
        load_job(file)  # raises JobError with the same fault
        raise


def _path_for_job(file: Path, job: Path) -> str:
    """Return the path of a file as the job states it."""
    return path_in_job(file.absolute(), job.parent)


def _recoverable_job(recovery: Recovery | None) -> Path | None:
    """Return the job file in the unsaved work that is offered, if there is one."""
    work = recovery.work if recovery else None
    return next((file for file in (work.files if work else ()) if file.suffix == ".toml"), None)


def _free_path(file: Path) -> Path:
    """Return a path at which there is no file: `file`, or else `file` with a number after its stem."""
    numbered = (file.with_stem(f"{file.stem}_{number}") for number in range(2, 1000))
    return next(candidate for candidate in (file, *numbered) if not candidate.exists())


def _quote(text: str) -> str:
    """Return a text as a string of TOML."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
