"""Exports the scenes of a job as a .blend, for `lookdev export blend`; it is written completely or not at all.

A separate process, the exporter, writes the .blend with Blender. It gets a task, as JSON in a file, and answers on
standard output.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from pydantic import BaseModel, ValidationError

from lookdev.cache import Content, atomic_path, output_errors
from lookdev.errors import LookdevError, OutputError, RenderError, TextureError, WorkerError
from lookdev.export import ExportResult
from lookdev.light import native_images
from lookdev.light.native import are_domes_still
from lookdev.material import Bump, Look, Texture, leaf_sources
from lookdev.material.textures import image_file, udim_tiles
from lookdev.plan import turntable_poses
from lookdev.plan.prepare import JobSetups, read_setups
from lookdev.rendering.blend import BLEND_TASK, BlendImage, BlendRig, BlendTask, BlendTurntable
from lookdev.rendering.worker import ANSWER_TIMEOUT, kill_group, last_line

EXPORT_COMMAND: tuple[str, ...] = (sys.executable, "-m", "lookdev.cycles", "--export-blend")


class ExportAnswer(BaseModel):
    """The answer of the exporter: notes for the user, or an error."""

    notes: tuple[str, ...] = ()
    error: str = ""


def export_blend(
    job: Path,
    out: Path,
    *,
    pack: bool = False,
    command: Sequence[str] = EXPORT_COMMAND,
    timeout: float = ANSWER_TIMEOUT,
) -> ExportResult:
    """Write the scenes of a job as a .blend, with looks as Cycles' own closures; the job's backend is ignored.

    Parameters
    ----------
    job
        The job file.
    out
        The path of the .blend. An existing file is replaced only by a complete one. The folder is created if it does
        not exist.
    pack
        Pack images into the .blend; otherwise they are copied to the folder ``<stem>_files`` next to it.
    command
        The command that starts the exporter; the path of a file with the task is appended as its last argument.
    timeout
        The time that the exporter may take, in seconds for each look.

    Raises
    ------
    LookdevError
        `out` is not the name of a .blend, or the job is wrong.
    OutputError
        A file cannot be written.
    RenderError, WorkerError
        Blender cannot write the .blend.
    """
    out = out.absolute()
    if out.suffix != ".blend":
        raise LookdevError(f"{out}: an exported scene is a .blend; -o {out.stem or 'look'}.blend would be right")
    if out.is_dir():
        raise OutputError(f"{out}: is a folder; name a file")
    prepared = read_setups(job, backend="nodes")
    images = tuple(BlendImage(image, f"{out.stem}_files/{name}") for image, name in image_names(prepared).items())
    with output_errors(out, name_file=True), ExitStack() as stack:
        out.parent.mkdir(parents=True, exist_ok=True)
        copies = stack.enter_context(_copy_images(() if pack else images, out.parent))
        # The .blend is written in a folder of its own, because Blender first writes a file with another name.
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix=f".{out.stem}-", dir=out.parent))
        temporary = Path(folder, out.name)
        notes = _run_exporter(blend_task(prepared, temporary, images, pack=pack), command, timeout)
        temporary.replace(out)
    looks, rigs = (", ".join(item.name for item in items) for items in (prepared.job.look, prepared.job.rigs))
    closures = "looks are Cycles' own closures, as backend 'nodes' renders them"
    text = f"{out}: {_size_text([out])}, scenes {looks}, rigs {rigs}; {closures}"
    if copies:
        text += f"\n{copies[0].parent}: {len(copies)} images, {_size_text(copies)}; keep them together"
    return ExportResult((out, *copies), text, (*prepared.notes, *notes))


def blend_task(prepared: JobSetups, file: Path, images: Sequence[BlendImage], *, pack: bool) -> BlendTask:
    """Return the task that makes the exporter write a job, which was prepared with backend ``"nodes"``, to `file`.

    The turntables have the poses under the job's first rig. Every other rig is rotated by the difference between its
    rotation and the first rig's rotation. All rigs share one timeline. RenderError is therefore raised if the domes of
    one rig rotate with the light and the domes of another rig do not.
    """
    # `scenes` has the scenes by the names of the look and the rig.
    job = prepared.job
    scenes = {(setup.look, setup.ibl): setup.task for setup in prepared.setups}
    first, looks = job.rigs[0], [look.name for look in job.look]
    rigs = tuple(
        BlendRig(rig.name, scenes[looks[0], rig.name].lights, 2.0**rig.exposure, rig.rotation - first.rotation)
        for rig in job.rigs
    )
    for other in rigs:
        if are_domes_still(other.lights) != are_domes_still(rigs[0].lights):
            raise RenderError(
                f"the domes of one of the rigs '{rigs[0].name}' and '{other.name}' turn and those of the other do not; "
                "a job for each rig would be right"
            )
    return BlendTask(
        file=file,
        scenes={look: scenes[look, first.name] for look in looks},
        rigs=rigs,
        turntables=tuple(
            BlendTurntable(turntable.name, turntable_poses(turntable, first.rotation, job.camera.azimuth))
            for turntable in job.turntable
        ),
        images=tuple(images),
        pack=pack,
        view=job.outputs.display_view().view,
        show_light=job.render.background == "ibl",
    )


def image_names(prepared: JobSetups) -> dict[Content, str]:
    """Return all images that looks and lights read, with unique file names.

    A file name consists of the name of the original image and a digest of the content, so that an export does not
    replace images of an earlier .blend.
    """
    # The first part of each image's name: for an image of a light, the name of the light; for an image of a look, the
    # name of the original file. `originals` has the images of looks, also those that no shader reads.
    names: dict[Content, str] = {}
    for setup in prepared.setups:
        for image in native_images(setup.task.lights):
            names.setdefault(image, setup.ibl)
    originals: dict[Content, str] = {}
    for source in {source: None for setup in prepared.setups for source in _image_sources(setup.scene.looks)}:
        texture, suffix = (source.height, "_slopes") if isinstance(source, Bump) else (source, "")
        with suppress(TextureError):  # `read_setups` ignores a missing image only if it affects no pixel
            for tile in udim_tiles(texture).values() or [texture]:
                image = Content.store_copy(image_file(Bump(tile) if isinstance(source, Bump) else tile))
                originals[image] = re.sub(r"[^\w.-]", "_", tile.file.stem + suffix)[:100]
    for setup in prepared.setups:
        names |= {image: originals[image] for source in setup.task.shaders for image in source.images}
    return {image: f"{name}-{image.digest[:8]}{image.suffix}" for image, name in names.items()}


def _image_sources(looks: Sequence[Look]) -> Iterator[Texture | Bump]:
    """Yield the textures and bumps that inputs and masks of looks read."""
    layers = [layer for look in {id(look): look for look in looks}.values() for layer in look.layers]
    for source in leaf_sources(source for layer in layers for source in (*layer.inputs.values(), layer.mask)):
        if isinstance(source, Texture | Bump):
            yield source


@contextmanager
def _copy_images(images: Sequence[BlendImage], folder: Path) -> Iterator[tuple[Path, ...]]:
    """Copy images into a folder, and yield the paths of the copies; remove new copies if the block fails."""
    copies = {folder / image.path: image.content for image in images}
    created: list[Path] = []
    try:
        for copy, content in copies.items():
            if not copy.exists():  # a file of the same name has the same content
                with atomic_path(copy) as temporary:
                    shutil.copyfile(content.path, temporary)
                created.append(copy)
        yield tuple(copies)
    except BaseException:
        for copy in created:
            copy.unlink(missing_ok=True)
        for parent in {copy.parent for copy in copies}:
            with suppress(OSError):  # the folder is missing or not empty
                parent.rmdir()
        raise


def _run_exporter(task: BlendTask, command: Sequence[str], timeout: float) -> tuple[str, ...]:
    """Run the exporter, which is killed if this call fails; return its notes. `timeout` is in seconds for each look."""
    seconds = timeout * len(task.scenes)
    with tempfile.TemporaryDirectory(prefix="lookdev-export-") as scratch:
        request, log = Path(scratch, "task.json"), Path(scratch, "log")
        request.write_bytes(BLEND_TASK.dump_json(task))
        with log.open("wb") as stream:
            try:
                # The exporter has its own session, so that Ctrl-C in the terminal interrupts only the present process.
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
                kill_group(process)
                if isinstance(error, subprocess.TimeoutExpired):
                    raise WorkerError(f"the exporter was silent for {seconds:g} s and was killed") from None
                raise
        try:
            answer = ExportAnswer.model_validate_json(output)
        except ValidationError:
            line = last_line(log)
            raise WorkerError(f"the exporter ended with exit code {process.returncode}: {line}") from None
    if answer.error:
        raise RenderError(f"{task.file.name}: {answer.error}")
    if not task.file.is_file():
        raise WorkerError(f"the exporter ended without an error, and without {task.file.name}")
    return answer.notes


def _size_text(files: Sequence[Path]) -> str:
    """Return the total size of files as text, in MB."""
    return f"{sum(file.stat().st_size for file in files) / 1e6:.1f} MB"
