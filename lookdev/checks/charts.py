"""Whether reference props show what they should: the grey ball and the patches of a frame, measured and predicted.

A reading is the mean over a square of whole pixels. Its prediction is the published reflectance times what the float64
reference finds for a white surface in the same square, under the lights of the job at their exposure: neither the
renderer's colours, nor its light, nor its exposure are in it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from lookdev.material import Layer, Look
from lookdev.reference.mesh import MeshScene
from lookdev.reference.render import frame_pixels
from lookdev.rendering.results import Rendered
from lookdev.rendering.task import FrameTask
from lookdev.scene.charts import GREY, PATCHES, Box, Strip, asset_of_props, patch_colors
from lookdev.scene.charts.props import cropped
from lookdev.space import to_space

Floats = NDArray[np.float64]

_WHITE = Look("white", (Layer("White", "lambert", {"reflectance": (1.0, 1.0, 1.0)}),))
_SCRAMBLES = 16
_SAMPLES = 2048, 256
"""Of each scramble: where all lights are infinitely far, one patch is predicted for all, else each."""

_CHANCE = 1e-3
"""That any reading of a frame is reported by noise alone, where it is Student's."""

SYSTEMATIC = 1e-3
"""Relative: what both halves of a frame have in common, twice the error of a dome's points (docs/accuracy.md)."""

_NAMED = 4  # readings in a message


@dataclass(frozen=True)
class Reading:
    """A square of a frame of props: measured and predicted means (3,), and the standard error of their difference."""

    name: str
    measured: Floats
    predicted: Floats
    error: Floats
    freedom: float  # degrees of freedom of the error

    @property
    def deviation(self) -> float:
        """The difference relative to the prediction, in the channel where it is largest in errors."""
        return float(self._relative[self._channel])

    @property
    def excess(self) -> float:
        """The largest difference in terms of what noise and `SYSTEMATIC` explain; above 1 it is reported."""
        return float(self._ratios[self._channel])

    @property
    def _relative(self) -> Floats:
        return np.asarray((self.measured - self.predicted) / np.maximum(self.predicted, 1e-30))

    @property
    def _ratios(self) -> Floats:
        explained = _quantile(self.freedom) * self.error + SYSTEMATIC * self.predicted
        return np.asarray(np.abs(self.measured - self.predicted) / np.maximum(explained, 1e-30))

    @property
    def _channel(self) -> int:
        return int(self._ratios.argmax())


@cache
def _quantile(freedom: float) -> float:
    from scipy.stats import t as student

    return float(student.isf(0.5 * _CHANCE / (3 * (1 + len(PATCHES))), freedom))


def check_charts(task: FrameTask, strip: Strip, rendered: Rendered) -> tuple[Reading, ...]:
    """Measure and predict the readings of a frame of props, in the order of `Strip.measured`.

    Only channels are compared whose reflectance is not 0: of cyan, red is.
    """
    halves = [np.asarray(each, np.float64) * 2.0**task.exposure for each in (rendered.a, rendered.b)]
    colors = {
        "grey ball": np.full(3, GREY),
        **dict(zip(PATCHES, to_space(patch_colors(), task.scene.space), strict=True)),
    }
    squares = {name: _whole_pixels(box) for name, box in strip.measured.items()}
    light = _predicted_white(task, strip, squares)
    readings = []
    for name, square in squares.items():
        a, b = (half[square.top_row : square.bottom_row, square.left_column : square.right_column] for half in halves)
        count = a[..., 0].size
        # The pixels of a frame are independent, and so are the halves of each.
        measured, noise = 0.5 * (a + b).mean(axis=(0, 1)), (0.5 * (a - b)) ** 2
        squared = noise.sum(axis=(0, 1)) / count**2
        white, error = light[name]
        predicted = colors[name] * white
        of_prediction = (colors[name] * error) ** 2
        # Welch and Satterthwaite: the noisier of both decides.
        freedom = float(min(count, _SCRAMBLES - 1))
        readings.append(Reading(name, measured, predicted, np.sqrt(squared + of_prediction), freedom))
    return tuple(readings)


def charts_doubts(readings: Sequence[Reading]) -> Iterator[str]:
    """Yield what is to be doubted in a frame of props, as a sentence without its name."""
    off = sorted((each for each in readings if each.excess > 1.0), key=lambda each: -each.excess)
    if not off:
        return
    named = ", ".join(f"{each.name} {_factor(each)}" for each in off[:_NAMED])
    more = f" and {len(off) - _NAMED} more" if len(off) > _NAMED else ""
    ratios = [_ratio(each) for each in off]
    alike = len(off) == len(readings) and max(ratios) < 1.02 * min(ratios)
    why = f"; all are {math.log2(ratios[0]):+.2f} stops off: the exposure is wrong" if alike and ratios[0] > 0.0 else ""
    yield f"the reference props do not show what their light predicts: {named}{more}{why}"


def charts_header(readings: Sequence[Reading]) -> Mapping[str, str]:
    """Return the entries of the header of a frame of props: what deviates most, and what is to be doubted."""
    worst = max(readings, key=lambda each: each.excess)
    header = {"charts.worst": f"{worst.name} {100.0 * worst.deviation:+.3f} %", "charts.excess": repr(worst.excess)}
    doubts = list(charts_doubts(readings))
    return header | ({"charts.doubt": doubts[0]} if doubts else {})


def _ratio(reading: Reading) -> float:
    return 1.0 + reading.deviation


def _factor(reading: Reading) -> str:
    far = abs(reading.deviation) >= 1.0
    return f"x {_ratio(reading):.2g}" if far else f"{100.0 * reading.deviation:+.2g} %"


@dataclass(frozen=True)
class _Square:
    """Whole pixels of a frame, as many across as down."""

    left_column: int
    top_row: int
    side: int

    @property
    def right_column(self) -> int:
        return self.left_column + self.side

    @property
    def bottom_row(self) -> int:
        return self.top_row + self.side

    @property
    def box(self) -> Box:
        return Box(self.left_column, self.top_row, self.side, self.side)


def _whole_pixels(box: Box) -> _Square:
    left, top = math.ceil(box.left - 1e-9), math.ceil(box.top - 1e-9)
    right, bottom = math.floor(box.left + box.width + 1e-9), math.floor(box.top + box.height + 1e-9)
    return _Square(left, top, min(right - left, bottom - top))


def _predicted_white(task: FrameTask, strip: Strip, squares: Mapping[str, _Square]) -> dict[str, tuple[Floats, Floats]]:
    """Return the radiance of a white surface in place of each prop, exposed, and its standard error, (3,) each."""
    scene, gain = task.scene, 2.0**task.exposure
    lights = scene.lights_of(scene.worn[-1])
    far = all(light.far for light in lights)
    first = next(iter(PATCHES))
    found: dict[str, tuple[Floats, Floats]] = {}
    for prop, names in (("grey", ["grey ball"]), ("chart", [first] if far else list(PATCHES))):
        surface = MeshScene(asset_of_props(strip, scene.camera, [prop]), [_WHITE])
        for number, name in enumerate(names):
            camera = cropped(scene.camera, scene.resolution, squares[name].box)
            estimate = frame_pixels(
                surface,
                lights,
                camera,
                task.pose,
                (1, 1),
                np.zeros((1, 2), np.int64),
                samples=_SAMPLES[not far],
                scrambles=_SCRAMBLES,
                seed=number,
            )
            found[name] = gain * estimate.value[0], gain * estimate.error[0]
    return dict.fromkeys(PATCHES, found[first]) | found
