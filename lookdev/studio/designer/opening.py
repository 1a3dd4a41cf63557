"""From a job or an asset to the document that is edited."""

from __future__ import annotations

from pathlib import Path

from lookdev.job import load_job
from lookdev.studio.designer.document import Document
from lookdev.studio.designer.dressing import Dressing, stated_path
from lookdev.studio.designer.recovery import Recovery
from lookdev.text import TextError, read_bytes

ASSET = """# Made by 'lookdev design'.
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


def open_document(
    file: Path | None, builtin: str | None = None, material: Path | None = None, *, recovers: bool = False
) -> Document:
    """Open a job (.toml), or an asset in its own materials or in one; keep and offer unsaved work if it `recovers`.

    An asset's job is one that is not on disk, of the working folder.

    Raises
    ------
    JobError
        The job has faults.
    FaultsError
        The files of a job have, or the asset has.
    """
    opened = "|".join(
        str(each.absolute()) if isinstance(each, Path) else str(each) for each in (file, builtin, material)
    )
    recovery = Recovery(opened) if recovers else None
    if file is not None and file.suffix == ".toml":
        return Document(Dressing(file.absolute(), _content(file)), recovery)
    stem = str(builtin) if file is None else file.stem
    job = _kept(recovery) or _free(Path.cwd() / f"{stem}.toml")
    if job.exists():  # saved by the Designer whose unsaved work is offered
        return Document(Dressing(job, _content(job)), recovery)
    asset = f"builtin = {_quoted(str(builtin))}" if file is None else f"usd = {_quoted(_stated(file, job))}"
    worn = f"material = {_quoted(_stated(material, job))}\n" if material else ""
    text = ASSET.format(name=stem, asset=asset, material=worn)
    return Document(Dressing(job, text.encode()), recovery)


def _content(file: Path) -> bytes:
    """Return the content of a job's file; raises JobError as `load_job` does where there is none."""
    try:
        return read_bytes(file)
    except TextError:
        load_job(file)
        raise


def _stated(file: Path, job: Path) -> str:
    return stated_path(file.absolute(), job.parent)


def _kept(recovery: Recovery | None) -> Path | None:
    """Return the job of unsaved work that is offered."""
    work = recovery.work if recovery else None
    return next((file for file in (work.files if work else ()) if file.suffix == ".toml"), None)


def _free(file: Path) -> Path:
    """Return a path at which there is no file: this, or one with a number."""
    others = (file.with_stem(f"{file.stem}_{number}") for number in range(2, 1000))
    return next(each for each in (file, *others) if not each.exists())


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
