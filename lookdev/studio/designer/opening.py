"""From a job or an asset to the document that is edited."""

from __future__ import annotations

from pathlib import Path

from lookdev.job import load_job, parse_job
from lookdev.job.scenes import job_scenes
from lookdev.studio.designer.document import Document
from lookdev.studio.designer.recovery import Recovery

ASSET = """output = "."
asset = {{ {asset} }}
look = [{{ name = "own"{material} }}]
ibl = [{{ name = "courtyard", builtin = "courtyard" }}, {{ name = "studio", builtin = "studio" }}]
turntable = [{{ kind = "element", frames = 1 }}]
render = {{ resolution = [960, 720], background = "ibl" }}
"""


def open_document(
    file: Path | None, builtin: str | None = None, material: Path | None = None, *, recovers: bool = False
) -> Document:
    """Open a job (.toml), or an asset in its own materials or in one; keep and offer unsaved work if it `recovers`.

    Raises
    ------
    JobError
        The job has faults.
    FaultsError
        The files of a job have, or the asset has.
    """
    if file is not None and file.suffix == ".toml":
        job = load_job(file)
    else:
        asset = f"builtin = {_quoted(str(builtin))}" if file is None else f"usd = {_quoted(str(file.absolute()))}"
        worn = f", material = {_quoted(str(material.absolute()))}" if material else ""
        text = ASSET.format(asset=asset, material=worn)
        job = parse_job(text, file.absolute() if file else Path.cwd() / str(builtin))
    scenes = job_scenes(job)
    opened = "|".join(
        str(each.absolute()) if isinstance(each, Path) else str(each) for each in (file, builtin, material)
    )
    return Document(job, scenes, Recovery(opened) if recovers else None)


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
