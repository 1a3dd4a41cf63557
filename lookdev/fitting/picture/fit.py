"""Runs `lookdev fit --picture`: fits parameters of a job's look to a picture of it, and writes look and report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.ndimage import uniform_filter

from lookdev.build.scenes import build_scenes
from lookdev.errors import LookdevError, ModelError
from lookdev.fitting.picture.live_frame import BACKEND, JobFrame, LiveFrame, live_frame
from lookdev.fitting.picture.page import FitPictures, TableRow, format_numbers, table_rows, write_page
from lookdev.fitting.picture.photo import Photo, read_photo
from lookdev.fitting.picture.search import LossPoint, Search, SearchResult, SearchSettings
from lookdev.fitting.picture.target import Target, block_means, block_side
from lookdev.fitting.picture.unknowns import EXPOSURE, Unknown, parse_unknowns
from lookdev.job import load_job
from lookdev.material import Look
from lookdev.material.library.constants import check_writable, write_changed
from lookdev.material.library.edit import check_suffix
from lookdev.rendering.backends import BACKENDS
from lookdev.scene import Scene

_PAGE_PIXELS = 1 << 18
"""A photo with more pixels is shown at a lower resolution, with at least this number of pixels if possible."""

_PAGE_SAMPLES = 1 << 19
"""The number of samples of a render for the page, over all of its pixels."""


@dataclass(frozen=True)
class PictureFitRequest:
    """A request to fit a job's look to a picture.

    Attributes
    ----------
    picture, job
        The files of the picture and of the job.
    parameters
        Names of constants of the look. ``Layer.`` precedes a name that several layers have. ``=low..high`` after a name
        sets the bounds of the search.
    frame
        The name of the job's frame that the picture shows, ``look/light/turntable.0001``, or the beginning of the name.
        If it is empty, the picture shows the first frame.
    look, page
        The files to write: the look with the result, and the report. A file that is None is not written.
    look_named
        Whether the user has named the file `look`. If the look cannot be written, this is then an error, otherwise a
        note.
    mask
        An image whose last channel is the weight of each pixel in the comparison.
    exposure
        Whether the exposure of the picture is fitted, too.
    force
        Whether files may be replaced.
    pixels
        The least number of pixels to render. A larger picture is divided into square blocks of pixels, if its size
        permits, and a block is compared with one pixel of a render.
    settings
        The extent of the search.
    """

    picture: Path
    job: Path
    parameters: tuple[str, ...]
    frame: str = ""
    look: Path | None = None
    page: Path | None = None
    mask: Path | None = None
    exposure: bool = False
    look_named: bool = True
    force: bool = False
    pixels: int = 4096
    settings: SearchSettings = field(default_factory=SearchSettings)


@dataclass(frozen=True, eq=False)
class PictureFit:
    """The result of a fit to a picture.

    Attributes
    ----------
    frame
        The full name of the job's frame.
    rows
        The parameters for the table of the report.
    block
        The side, in pixels, of a block of the picture. A block was compared with one pixel of a render.
    noise_from
        A text that states how the noise of the picture is known.
    written, notes
        The files that were written, and notes for the user.
    """

    request: PictureFitRequest
    frame: str
    result: SearchResult
    rows: tuple[TableRow, ...]
    block: int
    noise_from: str
    written: tuple[Path, ...]
    notes: tuple[str, ...]

    def data(self) -> dict[str, object]:
        """Return the fit as plain data for JSON."""
        result = self.result
        return {
            "picture": str(self.request.picture), "job": str(self.request.job), "frame": self.frame,
            "parameters": {
                row.name: {"before": _to_json(row.before), "after": _to_json(row.after), "error": _to_json(row.error),
                           "remark": row.remark}
                for row in self.rows
            },
            "without_effect": list(result.without_effect), "undetermined": list(result.undetermined),
            "alike": [{"parameters": [a, b], "correlation": value} for a, b, value in result.correlated_pairs],
            "loss": {"before": result.before, "after": result.after, "noise": result.noise},
            "misfit": result.misfit, "noise_from": self.noise_from,
            "starts": [{"loss": loss, "near_the_result": near} for loss, near in result.starts],
            "curve": [{"stage": point.stage, "start": point.start, "loss": point.loss, "accepted": point.accepted}
                      for point in result.curve],
            "block": self.block, "converged": result.converged, "interrupted": result.interrupted,
            "seconds": result.seconds, "written": [str(file) for file in self.written],
        }  # fmt: skip

    @property
    def _state(self) -> str:
        return "interrupted" if self.result.interrupted else "converged" if self.result.converged else "not converged"

    def lines(self) -> list[str]:
        """Return the lines of text below the title of the page."""
        fit, request = self.result, self.request
        return [
            f"{request.picture.name}, as frame {self.frame} of {request.job.name}; "
            f"{self._state} in {fit.seconds:.0f} s.",
            f"Difference {_percent(fit.before)} before, {_percent(fit.after)} after, of which the picture's noise "
            f"is {_percent(fit.noise)}. Noise: by {self.noise_from}.",
        ]

    def text(self) -> str:
        """Return the fit as lines of text."""
        result = self.result
        lines = [f"{self.request.picture}: {self.frame}"]
        width = max(len(row.name) for row in self.rows)
        for row in self.rows:
            error = "" if np.isnan(row.error).all() else f" ± {format_numbers(row.error, 2)}"
            remark = f"  ({row.remark})" if row.remark else ""
            before, after = format_numbers(row.before), format_numbers(row.after)
            lines.append(f"  {row.name:<{width}} = {after}{error}  (was {before}){remark}")
        pairs = result.correlated_pairs
        lines += [f"  {a} and {b} change the picture alike: correlation {value:.3f}" for a, b, value in pairs]
        lines.append(
            f"{self._state}: difference {_percent(result.before)} before, {_percent(result.after)} after, of which the "
            f"picture's noise is {_percent(result.noise)}; {result.seconds:.0f} s"
        )
        lines += [f"wrote {file}" for file in self.written]
        return "\n".join(lines)


def fit_picture(request: PictureFitRequest, report: Callable[[LossPoint], None] = lambda point: None) -> PictureFit:
    """Fit parameters of a look to a picture of it; `report` is called with the loss of every render.

    After a KeyboardInterrupt the best result so far is written and returned, if there is one.

    Raises
    ------
    LookdevError
        The picture, the job or a parameter is wrong, or they do not match. This error is raised before any render.
    WorkerError, RenderError
        The renderer fails, or is not installed; the message then names the extra for pip.
    """
    BACKENDS[BACKEND].version()  # raises if it is not installed
    photo = read_photo(request.picture, request.mask)
    job = load_job(request.job).model_copy(update={"wedge": ()})
    scenes = build_scenes(job)
    frame = JobFrame.from_name(request.frame, scenes.job, scenes.scenes)
    look, unknowns = _find_look(frame.scene, request.parameters)
    request, notes = _check_request(request, photo, frame, look)
    if request.exposure:
        unknowns = (*unknowns, EXPOSURE)
    block = block_side(photo.size, request.pixels)
    with live_frame(job, frame, look, unknowns) as live:
        scene = live.scene_at(photo.size, block)
        first_halves = live.render(scene, live.initial_values, False, request.settings.samples, (0, 1))
        see_through = any(source.see_through for source in scene.shaders)
        # The asset covers a pixel if it does so in both halves: the last channel is alpha.
        target = Target.from_photo(
            photo, block, first_halves[:, 0, ..., 3].min(axis=0), frame.gain, see_through=see_through
        )
        result = Search(partial(live.render, scene), target, unknowns, request.settings, report).run()
        before = {unknown.name: unknown.constant.value for unknown in unknowns}
        picture_fit = PictureFit(
            request,
            frame.name,
            result,
            tuple(table_rows(result, before)),
            block,
            photo.noise_from,
            tuple(_write_look(request, frame, unknowns, result)),
            (*scenes.notes, *photo.notes, *notes),
        )
        if request.page is not None:
            pictures = _page_pictures(photo, live, target, picture_fit, before, frame.gain)
            write_page(
                request.page, f"Fit of {', '.join(row.name for row in picture_fit.rows)}", picture_fit.lines(),
                pictures, picture_fit.rows, result,
            )  # fmt: skip
            picture_fit = replace(picture_fit, written=(*picture_fit.written, request.page))
    return picture_fit


def _write_look(
    request: PictureFitRequest, frame: JobFrame, unknowns: tuple[Unknown, ...], result: SearchResult
) -> Iterator[Path]:
    """Write the fitted look, if it is requested, and yield the path of its file."""
    if request.look is not None and frame.job_look.material is not None:
        constants = [
            replace(unknown.constant, value=result.values[unknown.name])
            for unknown in unknowns
            if not unknown.is_exposure
        ]
        write_changed(frame.job_look.material, request.look, constants, frame.job_look.prim, frame.job_look.variants)
        yield request.look


def _find_look(scene: Scene, parameters: tuple[str, ...]) -> tuple[Look, tuple[Unknown, ...]]:
    """Return the only look of a scene that has all parameters, and these parameters as unknowns.

    Raises LookdevError if several looks have all parameters. If no look has them, raises the error about the last look.
    """
    looks = list({id(look): look for look in scene.looks}.values())
    candidates, errors = [], []
    for look in looks:
        try:
            candidates.append((look, parse_unknowns(look, parameters)))
        except ModelError as error:
            errors.append(error)
    if len(candidates) > 1:
        names = ", ".join(f"'{look.name}'" for look, _ in candidates)
        raise LookdevError(
            f"several looks of the parts have {', '.join(parameters)}: {names}; a job whose frame shows one of them "
            "would be right"
        )
    if not candidates:
        raise errors[-1]
    return candidates[0]


def _check_request(
    request: PictureFitRequest, photo: Photo, frame: JobFrame, look: Look
) -> tuple[PictureFitRequest, tuple[str, ...]]:
    """Check that picture and job match and that the files can be written; return the request and notes.

    If the look cannot be written and the user did not name its file, the returned request has no look, and a note says
    why. In all other cases a fault raises LookdevError.
    """
    width, height = photo.size
    if frame.scene.film.resolution != photo.size:
        job_size = " x ".join(map(str, frame.scene.film.resolution))
        raise LookdevError(
            f"{photo.file}: is {width} x {height} pixels large, the job renders {job_size}: in [render], resolution = "
            f"[{width}, {height}] would be right, with the camera of the picture"
        )
    notes = list[str]()
    try:
        _check_look(request.look, frame, look)
    except LookdevError as error:
        if request.look_named:
            raise
        notes.append(f"no look is written: {error}")
        request = replace(request, look=None)
    for file in (request.look, request.page):
        if file is not None and file.exists() and not request.force:
            raise LookdevError(f"{file}: exists already; another name, or --force, would be right")
        if file is not None and not file.absolute().parent.is_dir():
            raise LookdevError(f"{file}: its folder does not exist")
    return request, tuple(notes)


def _check_look(file: Path | None, frame: JobFrame, look: Look) -> None:
    """Raise LookdevError if the look cannot be written with changed parameters."""
    material = frame.job_look.material
    if material is None or look.name != frame.job_look.name:
        raise LookdevError(
            f"look '{frame.job_look.name}': the parameters are of '{look.name}', which is not the look's own 'material'"
        )
    if file is not None:
        check_suffix(file)
    check_writable(material, frame.job_look.prim, frame.job_look.variants)


def _page_pictures(
    photo: Photo,
    live: LiveFrame,
    target: Target,
    picture_fit: PictureFit,
    before: Mapping[str, tuple[float, ...]],
    gain: float,
) -> FitPictures:
    """Return the pictures of the report.

    The look is rendered before and after the fit, as large as the photo, or with fewer pixels if the photo is large.
    After an interruption nothing is rendered: the report then shows renders of the search. `before` has the original
    values of the unknowns by name. `gain` is the factor of the light's exposure, which renders do not include.
    """
    result, block = picture_fit.result, picture_fit.block
    if result.interrupted:
        renders = [gain * render[..., :3] for render in result.pictures]
        side, errors = block, [np.zeros_like(render) for render in renders]
    else:
        side = block_side(photo.size, _PAGE_PIXELS) if photo.size[0] * photo.size[1] > _PAGE_PIXELS else 1
        scene = live.scene_at(photo.size, side)
        width, height = scene.resolution
        # The samples per pixel of a half are a power of two. All pixels of both halves together have about
        # `_PAGE_SAMPLES` samples.
        samples = 1 << max(2, (_PAGE_SAMPLES // (2 * width * height)).bit_length() - 1)
        renders, errors = [], []
        for values in (before, result.values):
            # These seeds are far above the seeds of the search, which counts from 0.
            a, b = gain * live.render(scene, values, False, samples, (1000, 1001))[:, 0, ..., :3]
            exposure = 2.0 ** values["exposure"][0] if "exposure" in values else 1.0
            renders.append(exposure * 0.5 * (a + b))
            errors.append(exposure * 0.5 * (a - b))
    noise = block_means(photo.noise**2, side) / side**2
    # The difference of two halves is a poor estimate of a variance: it is averaged over neighbours.
    variances = [uniform_filter(noise + error**2, (5, 5, 1)) for error in errors]
    # Rounding of the filter's running sums may make variances negative.
    noise_before, noise_after = (np.sqrt(np.maximum(variance, 0.0)) for variance in variances)
    rows, columns = (np.arange(length // side) * side // block for length in photo.color.shape[:2])
    is_compared = (target.weight.max(axis=-1) > 0.0)[rows][:, columns]
    return FitPictures(block_means(photo.color, side), renders[0], renders[1], noise_before, noise_after, is_compared)


def _percent(loss: float) -> str:
    """Return the root of a loss, which is the root mean square of relative differences, as text in percent."""
    return f"{100.0 * max(loss, 0.0) ** 0.5:.3g} %"


def _to_json(values: tuple[float, ...]) -> float | list[float]:
    return values[0] if len(values) == 1 else list(values)
