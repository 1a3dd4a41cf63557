"""The table of reference props, and the camera that leaves room for them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from lookdev.job.keys import Table, wrong
from lookdev.rendering.backends import BACKENDS, job_backends
from lookdev.scene import Camera
from lookdev.scene.charts import FOLDER, Strip
from lookdev.scene.charts.props import Place
from lookdev.scene.framing import Arc

Floats = NDArray[np.float64]

_LARGEST = 0.5
_STEP = 5.0  # degrees between the angles at which an outline is looked at


class JobCharts(Table):
    """A chrome ball, a grey ball and a colour chart beside the asset."""

    place: Place = Field(default="bottom", description="The edge of the frame that they stand along.")
    size: Annotated[float, Field(ge=0.02, le=_LARGEST)] = Field(
        default=0.12, description="The part of the frame's height, or at its sides of its width, that they take."
    )

    def strip(self, resolution: tuple[int, int]) -> Strip:
        """Return the strip of a frame that shows them."""
        return Strip(self.place, self.size, resolution)

    def check(self, resolution: tuple[int, int], backend: str, looks: Iterable[str]) -> None:
        """Raise the fault of a job, by its resolution, backend and names of looks."""
        what, hint = self.strip(resolution).misfit()
        if what:
            raise wrong(what, hint)
        if backend in BACKENDS and not BACKENDS[backend].apart:
            others = " or ".join(f'"{name}"' for name, each in job_backends().items() if each.apart)
            raise wrong(f"backend '{backend}' lets the props shadow one another", f"backend = {others}")
        if FOLDER in {name.casefold() for name in looks}:
            raise wrong(f"a look of the job is called '{FOLDER}', the name of the frames of [charts]", "rename it")

    def hidden(self, camera: Camera, points: Floats, arcs: Iterable[Arc], resolution: tuple[int, int]) -> Iterator[str]:
        """Yield a note where an asset reaches into the strip, by its outline (n, 3) and the angles that show it."""
        (width, height), box = resolution, self.strip(resolution).box
        for start, sweep in arcs:
            for angle in np.linspace(start, start + sweep, 1 + math.ceil(abs(sweep) / _STEP)):
                seen = camera.orbited(-angle)
                right, up, back = ((points - seen.position) @ seen.frame.T).T
                depth = np.where(back < 0.0, -back, np.inf)
                x = 0.5 * width * (1.0 + right / depth / camera.reach - 2.0 * camera.shift[0])
                y = 0.5 * height - 0.5 * width * (up / depth / camera.reach - 2.0 * camera.shift[1])
                across = x.max() > box.left and x.min() < box.left + box.width
                if across and y.max() > box.top and y.min() < box.top + box.height:
                    yield (
                        f"[charts] hides a part of the asset at the {self.place} edge of the frame, where the camera "
                        "of 'usd' leaves no room; another place or a smaller size would be right"
                    )
                    return

    def framed(
        self,
        resolution: tuple[int, int],
        fov: float,
        share: Callable[[float], float],
        frame: Callable[[tuple[float, float], float], Camera],
    ) -> Camera:
        """Return a camera whose asset does not reach into the strip.

        Parameters
        ----------
        resolution, fov
            Of the frame.
        share
            From half an angle of view, radians, to the most of it that the asset covers, as part of its tangent.
        frame
            From a resolution and a horizontal angle of view to a camera that frames the asset.
        """
        strip = self.strip(resolution)
        width, height = resolution
        reach = math.tan(math.radians(0.5 * fov))
        whole = width if strip.upright else height
        covered = share(math.atan(reach * whole / width))
        if 0.5 * (1.0 - covered) * whole >= strip.thickness:
            return frame(resolution, fov)
        narrow = math.degrees(2.0 * math.atan(reach * strip.rest[0] / width))
        camera = frame(strip.rest, narrow)
        return replace(camera, fov=fov, shift=strip.shift)
