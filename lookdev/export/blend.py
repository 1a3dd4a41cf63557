"""`lookdev export blend`: a job's scenes as a .blend, written whole or not at all."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ValidationError

from lookdev.cache import Content, atomic_path
from lookdev.errors import LookdevError, OutputError, RenderError, TextureError, WorkerError
from lookdev.light import native_images
from lookdev.light.native import still_domes
from lookdev.material import Bump, Look, Texture
from lookdev.material.look import leaves
from lookdev.material.textures import image_file, udim_tiles
from lookdev.plan import turntable_poses
from lookdev.plan.prepare import JobSetups, read_setups
from lookdev.rendering.blend import BLEND_TASK, BlendImage, BlendRig, BlendTask, BlendTurntable
from lookdev.rendering.worker import PATIENCE, last_line

EXPORT_COMMAND: tuple[str, ...] = (sys.executable, "-m", "lookdev.cycles", "--export-blend")


class Answer(BaseModel):
    """The answer of the exporting process: notes for the user, or why it failed."""

    notes: tuple[str, ...] = ()
    error: str = ""


@dataclass(frozen=True)
class Exported:
    """The written .blend, its images (none if they are packed), scenes, rigs, and notes for the user."""

    file: Path
    images: tuple[Path, ...]
    scenes: tuple[str, ...]
    rigs: tuple[str, ...]
    notes: tuple[str, ...]

    def summary(self) -> str:
        """Return the files and their sizes as text."""
        text = (
            f"{self.file}: {_size([self.file])}, scenes {', '.join(self.scenes)}, rigs {', '.join(self.rigs)}; "
            "looks are Cycles' own closures, as backend 'nodes' renders them"
        )
        if self.images:
            text += f"\n{self.images[0].parent}: {len(self.images)} images, {_size(self.images)}; keep them together"
        return text


def export_blend(
    job: Path, out: Path, *, pack: bool = False, command: Sequence[str] = EXPORT_COMMAND, patience: float = PATIENCE
) -> Exported:
    """Write the scenes of a job as a .blend with looks as Cycles' own closures; the job's backend is ignored.

    Parameters
    ----------
    job, out
        The job file; the .blend, which is replaced only by a whole one. Its folder is made if it does not exist.
    pack
        Put images into the .blend; otherwise they are copied to the folder ``<stem>_files`` beside it.
    command, patience
        The exporter, which takes a file with the task, and its patience in seconds for each look.

    Raises
    ------
    LookdevError
        `out` is not the name of a .blend, or the job is wrong.
    OutputError
        A file cannot be written.
    RenderError, WorkerError
        Blender cannot write it.
    """
    out = out.absolute()
    if out.suffix != ".blend":
        raise LookdevError(f"{out}: an exported scene is a .blend; -o {out.stem or 'look'}.blend would be right")
    if out.is_dir():
        raise OutputError(f"{out}: is a folder; name a file")
    made = read_setups(job, backend="nodes")
    images = tuple(BlendImage(each, f"{out.stem}_files/{name}") for each, name in image_names(made).items())
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with (
            _placed(() if pack else images, out.parent) as placed,
            # A folder, because Blender first writes a file of another name.
            tempfile.TemporaryDirectory(prefix=f".{out.stem}-", dir=out.parent) as beside,
        ):
            temporary = Path(beside, out.name)
            notes = _run(blend_task(made, temporary, images, pack=pack), command, patience)
            temporary.replace(out)
    except OSError as error:
        raise OutputError(f"{error.filename or out}: cannot be written: {error.strerror or error}") from error
    looks, rigs = (tuple(each.name for each in named) for named in (made.job.look, made.job.rigs))
    return Exported(out, placed, looks, rigs, (*made.notes, *notes))


def blend_task(made: JobSetups, file: Path, images: Sequence[BlendImage], *, pack: bool) -> BlendTask:
    """Return the task of a job with backend ``"nodes"``.

    Its poses are those under the job's first rig; other rigs are turned by their difference in rotation. Raises
    RenderError where the domes of one rig turn and those of another do not: they have one timeline.
    """
    job = made.job
    scenes = {(each.look, each.ibl): each.task for each in made.setups}
    first, looks = job.rigs[0], [look.name for look in job.look]
    rigs = tuple(
        BlendRig(each.name, scenes[looks[0], each.name].lights, 2.0**each.exposure, each.rotation - first.rotation)
        for each in job.rigs
    )
    for other in rigs:
        if still_domes(other.lights) != still_domes(rigs[0].lights):
            raise RenderError(
                f"the domes of one of the rigs '{rigs[0].name}' and '{other.name}' turn and those of the other stand "
                "still; a job for each would be right"
            )
    return BlendTask(
        file=file,
        scenes={look: scenes[look, first.name] for look in looks},
        rigs=rigs,
        turntables=tuple(
            BlendTurntable(each.name, turntable_poses(each, first.rotation, job.camera.azimuth))
            for each in job.turntable
        ),
        images=tuple(images),
        pack=pack,
        view=job.outputs.shown().view,
        show_light=job.render.background == "ibl",
    )


def image_names(made: JobSetups) -> dict[Content, str]:
    """Return every image that looks and lights read, and a unique file name, from its original and its digest.

    So an export does not replace images of an earlier .blend.
    """
    called: dict[Content, str] = {}
    for setup in made.setups:
        for image in native_images(setup.task.lights):
            called.setdefault(image, setup.ibl)
    originals: dict[Content, str] = {}
    for texture in {each: None for setup in made.setups for each in _textures(setup.scene.looks)}:
        with suppress(TextureError):  # of an image that reaches no pixel: others are faults of `read_setups`
            for tile in _tiles(texture):
                originals[Content.of(image_file(tile))] = _stem(tile)
    for setup in made.setups:
        called |= {image: originals[image] for source in setup.task.shaders for image in source.images}
    return {image: f"{name}-{image.digest[:8]}{image.suffix}" for image, name in called.items()}


def _textures(looks: Sequence[Look]) -> Iterator[Texture | Bump]:
    """Yield each look-up of an image in looks."""
    layers = [layer for look in {id(look): look for look in looks}.values() for layer in look.layers]
    for source in leaves(source for layer in layers for source in (*layer.inputs.values(), layer.mask)):
        if isinstance(source, Texture | Bump):
            yield source


def _tiles(source: Texture | Bump) -> Sequence[Texture | Bump]:
    if isinstance(source, Bump):
        return [Bump(tile) for tile in udim_tiles(source.height).values()] or [source]
    return list(udim_tiles(source).values()) or [source]


def _stem(source: Texture | Bump) -> str:
    stem = source.height.file.stem + "_slopes" if isinstance(source, Bump) else source.file.stem
    return re.sub(r"[^\w.-]", "_", stem)[:100]


@contextmanager
def _placed(images: Sequence[BlendImage], folder: Path) -> Iterator[tuple[Path, ...]]:
    """Copy images to their paths relative to a folder; new copies are removed if the block fails."""
    copies = {folder / each.path: each.content for each in images}
    made: list[Path] = []
    try:
        for copy, content in copies.items():
            if not copy.exists():  # its name depends on its content
                with atomic_path(copy) as temporary:
                    shutil.copyfile(content.path, temporary)
                made.append(copy)
        yield tuple(copies)
    except BaseException:
        for copy in made:
            copy.unlink(missing_ok=True)
        for parent in {copy.parent for copy in copies}:
            with suppress(OSError):  # not there, or not empty
                parent.rmdir()
        raise


def _run(task: BlendTask, command: Sequence[str], patience: float) -> tuple[str, ...]:
    """Write a .blend in a separate process, which is killed if this call fails; return its notes."""
    seconds = patience * len(task.scenes)
    with tempfile.TemporaryDirectory(prefix="lookdev-export-") as scratch:
        request, log = Path(scratch, "task.json"), Path(scratch, "log")
        request.write_bytes(BLEND_TASK.dump_json(task))
        with log.open("wb") as stream:
            try:
                # In a session of its own, Ctrl-C in the terminal interrupts this process only.
                process = subprocess.Popen(
                    (*command, str(request)),
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=stream,
                    env=os.environ | {"TMPDIR": scratch},
                    start_new_session=True,
                )
            except OSError as error:
                raise WorkerError(f"the exporter {command[0]} cannot be started: {error}") from error
        with process:
            try:
                output, _ = process.communicate(timeout=seconds)
            except BaseException as error:
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                if isinstance(error, subprocess.TimeoutExpired):
                    raise WorkerError(f"the exporter was silent for {seconds:g} s and was killed") from None
                raise
        try:
            answer = Answer.model_validate_json(output)
        except ValidationError:
            line = last_line(log)
            raise WorkerError(f"the exporter ended with exit code {process.returncode}: {line}") from None
    if answer.error:
        raise RenderError(f"{task.file.name}: {answer.error}")
    if not task.file.is_file():
        raise WorkerError(f"the exporter ended without an error, and without {task.file.name}")
    return answer.notes


def _size(files: Sequence[Path]) -> str:
    return f"{sum(file.stat().st_size for file in files) / 1e6:.1f} MB"
