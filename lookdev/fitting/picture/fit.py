"""`lookdev fit --picture`: parameters of a look of a job, found in a picture of it, by derivatives of renders."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from lookdev.build.scenes import job_scenes
from lookdev.errors import LookdevError, ModelError
from lookdev.fitting.picture import Found, Photo, Search, Settings, Target, Unknown, read_photo, unknowns_of
from lookdev.fitting.picture.live_frame import BACKEND, JobFrame, LiveFrame, live_frame
from lookdev.fitting.picture.page import Pictures, Row, numbers, rows_of, write_page
from lookdev.fitting.picture.search import Point
from lookdev.fitting.picture.target import block_of, blocks
from lookdev.fitting.picture.unknowns import exposure_unknown
from lookdev.job import load_job
from lookdev.material import Look
from lookdev.material.library.constants import check_writable, write_changed
from lookdev.material.library.edit import check_suffix
from lookdev.rendering.backends import BACKENDS
from lookdev.scene import Scene

Floats = NDArray[np.float64]

_PAGE_PIXELS = 1 << 18
_PAGE_SAMPLES = 1 << 19
"""Of a picture of the page, over all of its pixels."""


@dataclass(frozen=True)
class Wish:
    """What is to be found, and where it goes.

    parameters
        Names of constants, ``Layer.`` before them where several layers have one, ``=low..high`` behind them for bounds.
    frame
        ``look/light/turntable.0001`` of the job, or its beginning; "": the first.
    look, page
        The files to write; None: neither. A look that cannot be written is an error if it was `look_named`, or a note.
    exposure
        Whether the picture's exposure is found, too.
    pixels, settings
        At least so many pixels are rendered, where blocks of the picture's can be as large; how much is searched.
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
    settings: Settings = field(default_factory=Settings)


@dataclass(frozen=True, eq=False)
class PictureFit:
    """What was found for a frame of a job, and what was written; notes for the user."""

    wish: Wish
    frame: str
    found: Found
    rows: tuple[Row, ...]
    block: int
    noise_from: str
    written: tuple[Path, ...]
    notes: tuple[str, ...]

    def data(self) -> dict[str, Any]:
        """Return the fit as plain data."""
        found = self.found
        return {
            "picture": str(self.wish.picture), "job": str(self.wish.job), "frame": self.frame,
            "parameters": {
                row.name: {"before": _plain(row.before), "after": _plain(row.after), "error": _plain(row.error),
                           "remark": row.remark}
                for row in self.rows
            },
            "without_effect": list(found.without_effect), "undetermined": list(found.undetermined),
            "alike": [{"parameters": [a, b], "correlation": value} for a, b, value in found.alike],
            "loss": {"before": found.before, "after": found.after, "noise": found.noise},
            "misfit": found.misfit, "noise_from": self.noise_from,
            "starts": [{"loss": loss, "near_the_result": near} for loss, near in found.starts],
            "curve": [{"stage": p.stage, "start": p.start, "loss": p.loss, "accepted": p.accepted}
                      for p in found.curve],
            "block": self.block, "converged": found.converged, "interrupted": found.interrupted,
            "seconds": found.seconds, "written": [str(each) for each in self.written],
        }  # fmt: skip

    @property
    def _state(self) -> str:
        return "interrupted" if self.found.interrupted else "converged" if self.found.converged else "not converged"

    def lines(self) -> list[str]:
        """Return what the page says below its title."""
        found, wish = self.found, self.wish
        return [
            f"{wish.picture.name}, as frame {self.frame} of {wish.job.name}; {self._state} in {found.seconds:.0f} s.",
            f"Difference {_percent(found.before)} before, {_percent(found.after)} after, of which the picture's noise "
            f"is {_percent(found.noise)}. Noise: by {self.noise_from}.",
        ]

    def text(self) -> str:
        """Return the fit as lines of text."""
        found = self.found
        lines = [f"{self.wish.picture}: {self.frame}"]
        width = max(len(row.name) for row in self.rows)
        for row in self.rows:
            error = "" if np.isnan(row.error).all() else f" ± {numbers(row.error, 2)}"
            remark = f"  ({row.remark})" if row.remark else ""
            lines.append(f"  {row.name:<{width}} = {numbers(row.after)}{error}  (was {numbers(row.before)}){remark}")
        lines += [f"  {a} and {b} change the picture alike: correlation {value:.3f}" for a, b, value in found.alike]
        lines.append(
            f"{self._state}: difference {_percent(found.before)} before, {_percent(found.after)} after, of which the "
            f"picture's noise is {_percent(found.noise)}; {found.seconds:.0f} s"
        )
        lines += [f"wrote {each}" for each in self.written]
        return "\n".join(lines)


def fit_picture(wish: Wish, report: Callable[[Point], None] = lambda point: None) -> PictureFit:
    """Find parameters of a look in a picture of it; `report` is called with every render that is tried.

    After a KeyboardInterrupt the best so far is written and returned, if there is one.

    Raises
    ------
    LookdevError
        The picture, the job or a parameter is wrong, or they do not belong together: before anything is rendered.
    WorkerError, RenderError
        The renderer fails; pip names the extra where it is not installed.
    """
    BACKENDS[BACKEND].version()  # raises where it is not installed
    photo = read_photo(wish.picture, wish.mask)
    job = load_job(wish.job).model_copy(update={"wedge": ()})
    scenes = job_scenes(job)
    frame = JobFrame.named(wish.frame, scenes.job, scenes.scenes)
    look, unknowns = _searched(frame.scene, wish.parameters)
    wish, notes = _checked(wish, photo, frame, look)
    if wish.exposure:
        unknowns = (*unknowns, exposure_unknown())
    block = block_of(photo.size, wish.pixels)
    with live_frame(job, frame, look, unknowns) as shown:
        wide = shown.scene_of(photo.size, block)
        first = shown.render(wide, shown.given, False, wish.settings.samples, (0, 1))
        see_through = any(source.see_through for source in wide.shaders)
        target = Target.of(photo, block, first[:, 0, ..., 3].min(axis=0), frame.gain, see_through=see_through)

        def render(values: Mapping[str, tuple[float, ...]], slopes: bool, samples: int, seeds: tuple[int, int]) -> Any:
            return shown.render(wide, values, slopes, samples, seeds)

        found = Search(render, target, unknowns, wish.settings, report).run()
        before = {each.name: each.constant.value for each in unknowns}
        result = PictureFit(
            wish,
            frame.name,
            found,
            tuple(rows_of(found, before)),
            block,
            photo.noise_from,
            tuple(_written_look(wish, frame, unknowns, found)),
            (*scenes.notes, *photo.notes, *notes),
        )
        if wish.page is not None:
            pictures = _pictures(photo, shown, target, result, before, frame.gain)
            write_page(
                wish.page, f"Fit of {', '.join(each.name for each in result.rows)}", result.lines(), pictures,
                result.rows, found,
            )  # fmt: skip
            result = replace(result, written=(*result.written, wish.page))
    return result


def _written_look(wish: Wish, frame: JobFrame, unknowns: tuple[Unknown, ...], found: Found) -> Iterator[Path]:
    """Write the look that was found, if one is wanted; yield its file."""
    if wish.look is not None and frame.table.material is not None:
        changed = [replace(each.constant, value=found.values[each.name]) for each in unknowns if not each.is_exposure]
        write_changed(frame.table.material, wish.look, changed, frame.table.prim, frame.table.variants)
        yield wish.look


def _searched(scene: Scene, parameters: tuple[str, ...]) -> tuple[Look, tuple[Unknown, ...]]:
    """Return the look of a scene that has all parameters, and these; raises LookdevError of the last where none has."""
    different = list({id(look): look for look in scene.looks}.values())
    failed: LookdevError | None = None
    found = []
    for look in different:
        try:
            found.append((look, unknowns_of(look, parameters)))
        except ModelError as error:
            failed = error
    if len(found) > 1:
        names = ", ".join(f"'{look.name}'" for look, _ in found)
        raise LookdevError(
            f"the parts wear several looks with {', '.join(parameters)}: {names}; a job whose frame shows one of them "
            "would be right"
        )
    if not found:
        assert failed is not None, "a scene has a look"
        raise failed
    return found[0]


def _checked(wish: Wish, photo: Photo, frame: JobFrame, look: Look) -> tuple[Wish, tuple[str, ...]]:
    """Return the wish, without a look that cannot be written unless it was named, and notes.

    Raises LookdevError where picture and job do not belong together, or a file cannot be written.
    """
    width, height = photo.size
    if frame.scene.film.resolution != photo.size:
        have = " x ".join(map(str, frame.scene.film.resolution))
        raise LookdevError(
            f"{photo.file}: is {width} x {height} pixels large, the job renders {have}: in [render], resolution = "
            f"[{width}, {height}] would be right, with the camera of the picture"
        )
    notes = list[str]()
    try:
        _check_look(wish.look, frame, look)
    except LookdevError as error:
        if wish.look_named:
            raise
        notes.append(f"no look is written: {error}")
        wish = replace(wish, look=None)
    for file in (wish.look, wish.page):
        if file is not None and file.exists() and not wish.force:
            raise LookdevError(f"{file}: exists already; another name, or --force, would be right")
        if file is not None and not file.absolute().parent.is_dir():
            raise LookdevError(f"{file}: its folder does not exist")
    return wish, tuple(notes)


def _check_look(file: Path | None, frame: JobFrame, look: Look) -> None:
    """Raise LookdevError where a look with other parameters cannot be written."""
    material = frame.table.material
    if material is None or look.name != frame.table.name:
        raise LookdevError(
            f"look '{frame.table.name}': the parameters are of '{look.name}', which is no 'material' of the look's own"
        )
    if file is not None:
        check_suffix(file)
    check_writable(material, frame.table.prim, frame.table.variants)


def _pictures(
    photo: Photo,
    shown: LiveFrame,
    target: Target,
    result: PictureFit,
    before: Mapping[str, tuple[float, ...]],
    gain: float,
) -> Pictures:
    """Return what the page shows: renders as large as the photo, if that is not huge, or those of the search."""
    found, block = result.found, result.block
    if found.interrupted:
        renders = [gain * each[..., :3] for each in found.pictures]
        side, errors = block, [np.zeros_like(each) for each in renders]
    else:
        side = block_of(photo.size, _PAGE_PIXELS) if photo.size[0] * photo.size[1] > _PAGE_PIXELS else 1
        scene = shown.scene_of(photo.size, side)
        width, height = scene.resolution
        samples = 1 << max(2, (_PAGE_SAMPLES // (2 * width * height)).bit_length() - 1)
        renders, errors = [], []
        for values in (before, found.values):
            a, b = gain * shown.render(scene, values, False, samples, (1000, 1001))[:, 0, ..., :3]
            exposed = 2.0 ** values["exposure"][0] if "exposure" in values else 1.0
            renders.append(exposed * 0.5 * (a + b))
            errors.append(exposed * 0.5 * (a - b))
    noise = blocks(photo.noise**2, side) / side**2
    # One difference of halves knows little of a variance: that of neighbours is like it.
    near = [uniform_filter(noise + each**2, (5, 5, 1)) for each in errors]
    one, other = (np.sqrt(np.maximum(each, 0.0)) for each in near)  # running sums are 0 but for their rounding
    rows, columns = (np.arange(each // side) * side // block for each in photo.color.shape[:2])
    used = (target.weight.max(axis=-1) > 0.0)[rows][:, columns]
    return Pictures(blocks(photo.color, side), renders[0], renders[1], one, other, used)


def _percent(loss: float) -> str:
    """Return a loss as the root mean square of relative differences."""
    return f"{100.0 * max(loss, 0.0) ** 0.5:.3g} %"


def _plain(values: tuple[float, ...]) -> float | list[float]:
    return values[0] if len(values) == 1 else list(values)
